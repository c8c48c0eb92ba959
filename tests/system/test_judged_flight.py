"""A station that flies agents which were started elsewhere records, ends with them, and judges."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from swarm_ctl.mission.compile.loader import LoadedMission, load
from swarm_ctl.mission.compile.plan_file import plan_to_json
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.runfolder.last_statuses import STATUSES
from swarm_ctl.runfolder.manifest import read_manifest, write_manifest
from tests.system.pair import SPEEDUP, agent, ended, pair_mission, simulator
from tests.system.running import SWARM_CTL

pytestmark = pytest.mark.timeout(120)
_APART_S = 600.0
"""Between the agents' clocks: more than this flight can last."""
_TRUTH = "from-the-simulator.jsonl"


@pytest.fixture
def vehicles(tmp_path: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A simulator of two vehicles, which ends by itself once they have flown."""
    mission = pair_mission(tmp_path, spacing=3)
    truth = str(tmp_path / _TRUTH)
    simulated = simulator(mission, time.monotonic(), SPEEDUP, truth_path=truth, once=True)
    with ended([simulated]):
        yield simulated


@pytest.fixture
def station(vehicles: subprocess.Popen[bytes], tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """The station of their two agents, whose clocks began at different times, and before the
    simulator's."""
    mission = load(tmp_path / "pair.yaml")
    now = time.monotonic()
    watching = _station(mission, tmp_path)
    agents = [
        agent(mission.source, i, now - _APART_S / SPEEDUP * i, SPEEDUP, "--expect-station")
        for i in (1, 2)
    ]
    with ended([watching, *agents]):
        yield watching


def _station(mission: LoadedMission, folder: Path) -> subprocess.Popen[str]:
    """It knows the plan alone: no mission lies where it is."""
    plan = folder / "plan.json"
    plan.write_text(plan_to_json(mission.plan, mission.fleet))
    more = ["--headless", "--runs", folder / "runs", "--speedup", f"{SPEEDUP:g}"]
    more += ["--truth", folder / _TRUTH]
    return subprocess.Popen(
        [SWARM_CTL, "station", "--mission", plan, *more],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _summary(folder: Path) -> dict[str, Any]:
    (run,) = (folder / "runs").iterdir()
    assert {path.name for path in run.iterdir()} >= {"run.json", "report.html", "recording.mcap"}
    found: dict[str, Any] = json.loads((run / "summary.json").read_text())
    return found


def test_it_ends_with_the_mission_and_judges_it(
    station: subprocess.Popen[str], vehicles: subprocess.Popen[bytes], tmp_path: Path
) -> None:
    """Exit code 0, and a whole run's folder. Both agents' steps and the truth stand on one clock,
    though their own are far apart; the distance is that of the places where they stood, by the
    truth and by the vehicles' estimates, and the simulator ends, too."""
    out, errors = station.communicate(timeout=90)
    assert station.returncode == 0, out + errors
    summary = _summary(tmp_path)
    assert summary["outcome"] == "completed"
    assert [each["account"] for each in summary["agents"]] == ["final", "final"]
    assert summary["judged_by"] == {"1": "truth", "2": "truth"}
    assert summary["min_distance_m"] == pytest.approx(15.0, abs=2.0)
    ends = [agent["time_s"] for agent in summary["agents"]]
    assert abs(ends[0] - ends[1]) < _APART_S / 2
    takeoff, form, landing = (summary["steps"][k]["start_s"] for k in (1, 2, 3))
    assert takeoff < summary["truth"]["first_liftoff_s"] < form
    assert landing < summary["truth"]["last_touchdown_s"] < max(ends)
    assert vehicles.wait(30) == 0

    (run,) = (tmp_path / "runs").iterdir()
    write_manifest(run, read_manifest(run).model_copy(update={"simulated": ()}))
    by_estimates = summarise(run)
    assert by_estimates.outcome == "completed"
    assert set(by_estimates.judged_by.values()) == {"estimates"}
    assert by_estimates.min_distance_m == pytest.approx(15.0, abs=2.0)


@pytest.mark.long
def test_sigterm_lands_the_swarm(station: subprocess.Popen[str], tmp_path: Path) -> None:
    """As `docker stop` sends it: the agents land, then the station ends with 130."""
    while not _airborne(tmp_path):
        assert station.poll() is None
        time.sleep(0.05)
    station.send_signal(signal.SIGTERM)
    out, errors = station.communicate(timeout=60)
    assert station.returncode == 130, out + errors
    summary = _summary(tmp_path)
    assert summary["outcome"] == "aborted"
    assert not any(agent["armed"] for agent in summary["agents"])


def _airborne(folder: Path) -> bool:
    lines = [
        line
        for path in folder.glob(f"runs/*/{STATUSES}")
        for line in path.read_text().splitlines(True)
    ]
    return any(json.loads(line)["airborne"] for line in lines if line.endswith("\n"))
