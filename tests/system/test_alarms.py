"""A recording of a ready mission holds no alarm: one that a correct mission raises is a defect.

`tests/scenarios/test_missions.py` has the same on the virtual clock, where no machine is late.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from swarm_ctl.recording import IndexedRecording
from swarm_ctl.report.folder.manifest import read_manifest
from swarm_ctl.station.picture.playback import Film
from tests.scenarios.test_missions import HURT, TRUE_ALARMS
from tests.system.conftest import Whole
from tests.system.running import ROOT, Running

OTHERS = sorted({path.stem for path in (ROOT / "missions").glob("*.yaml")} - {"hexagon"})
SPEEDUP = {"thirtytwo": 0.5}
"""By mission, where two cores cannot fly it at 2."""


LATE = {"slow machine", "silent", "vehicle silent", "old state", "old link", "no station"}
LATE |= {"slow ticks", "late ticks"}
"""The rules that measure how late something is."""


def raised(folder: Path) -> list[tuple[str, tuple[int, ...]]]:
    """(name, agents) of the alarms of the recorded flight, in their order. On a machine that did
    not keep up, by the agents' own figures, those of late processes are true."""
    manifest = read_manifest(folder)
    with IndexedRecording(folder) as recording:
        film = Film(recording, manifest.plan, speedup=manifest.speedup)
        found = dict[tuple[str, tuple[int, ...]], None]()
        for look in range(int((film.end_s - film.start_s) / film.look_s) + 1):
            film.seek(film.start_s + look * film.look_s)
            found |= dict.fromkeys(alarm.key for alarm in film.journal.standing)
    tick = json.loads((folder / "summary.json").read_text())["tick"]
    late_ms = 1000 * manifest.plan.tick_s / manifest.speedup
    kept_up = tick["overruns"] < 0.01 * tick["count"] and tick["late_p99_ms"] < late_ms
    return [key for key in found if kept_up or key[0] not in LATE]


def test_the_hexagon_raises_no_alarm(whole: Whole) -> None:
    assert raised(whole.folder) == []


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", OTHERS)
def test_a_ready_mission_raises_no_alarm(tmp_path: Path, name: str) -> None:
    """But the true ones of a timetable of faults."""
    mission, speedup = ROOT / "missions" / f"{name}.yaml", str(SPEEDUP.get(name, 2))
    run = ("run", mission, "--speedup", speedup, "--headless", "--no-report")
    with Running(*run, cwd=tmp_path) as running:
        assert running.wait(800) == int(name in HURT), running.output
        found = raised(running.folder)
    assert sorted(found) == sorted(TRUE_ALARMS.get(name, []))
