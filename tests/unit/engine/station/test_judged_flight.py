"""The record of a judged flight: all of it on one clock."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from swarm_ctl.core.model.messages import Outcome
from swarm_ctl.engine.station import judged_flight
from swarm_ctl.engine.station.judged_flight import Accounts, _Flight
from swarm_ctl.engine.station.mesh_clock import MeshClock
from swarm_ctl.recording.mcap_recorder import McapRecorder
from swarm_ctl.runfolder.last_statuses import FINAL
from swarm_ctl.runfolder.tracks import read_tracks
from tests.unit.report.run_folders import manifest
from tests.unit.station.swarm import hexagon_plan, state_of, status_of

PLAN = hexagon_plan()


def test_the_truth_stands_on_the_clock_of_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was 21 s behind when the record began."""
    given: list[Any] = []
    monkeypatch.setattr(judged_flight, "take_truth", lambda *words: given.append(words))
    monkeypatch.setattr(judged_flight.wall, "wall_s", lambda: 100.0)
    swarm: Any = SimpleNamespace(clock=SimpleNamespace(now=lambda: 51.0, speedup=3.0))
    quiet: Any = SimpleNamespace(count=0, again=False)
    flight = _Flight(swarm, Path(), quiet, lambda: None, [], Path("truth.jsonl"))
    flight.folder, flight._manifest = Path(), manifest(epoch_s=90.0, speedup=3.0)
    flight._take_truth(SimpleNamespace())  # type: ignore[arg-type]
    ((_, _, taken, now_s),) = given
    assert (taken.epoch_s, now_s) == (83.0, 51.0)


@pytest.mark.parametrize("ahead_s", [21.0, 3600.0, -3600.0])
def test_all_accounts_and_tracks_stand_on_one_clock(tmp_path: Path, ahead_s: float) -> None:
    """That of the agent that was heard first, wherever the clock of one that is heard later is, or
    of one that was started again."""
    time = SimpleNamespace(s=0.0)
    clock = MeshClock()
    clock._own = SimpleNamespace(now=lambda: time.s)  # type: ignore[assignment]
    with closing(Accounts(tmp_path, McapRecorder(tmp_path, 0, {}))) as accounts:
        for k in range(40):
            time.s = 0.1 * k
            told = {1: time.s + 5.0} | ({2: time.s + 5.0 + ahead_s} if k > 20 else {})
            told[3] = time.s + 55.0 if k < 30 else time.s - 3.0
            for agent, told_s in told.items():
                outcome = Outcome.COMPLETED if k == 39 else Outcome.RUNNING
                clock.hear(agent, told_s)
                accounts.take(status_of(PLAN, agent, told_s, outcome=outcome), clock.now())
                seq = k - 30 if agent == 3 and k >= 30 else k
                accounts.take(state_of(PLAN, agent, told_s, seq=seq), clock.now())
        accounts.write_accounts()
        ends = [
            json.loads((tmp_path / FINAL / f"{i}.json").read_text())["time_s"] for i in (1, 2, 3)
        ]
    assert ends == pytest.approx([8.9, 8.9, 8.9], abs=0.1)
    tracks = read_tracks(tmp_path, [1, 2], elsewhere=True)
    assert [track.time_s[-1] for track in tracks.values()] == pytest.approx([8.9, 8.9], abs=0.1)
    assert [len(track.time_s) for track in tracks.values()] == [40, 19]
