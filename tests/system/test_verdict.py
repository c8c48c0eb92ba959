"""`swarm-ctl run` with vehicles that it does not simulate: it has no truth, and judges the flight
by what the vehicles told of themselves."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.mission.compile.plan_file import plan_to_json
from tests.system.pair import SPEEDUP, agent_in_waiting, ended, pair_mission, simulator
from tests.system.running import Running

pytestmark = pytest.mark.timeout(180)


@contextmanager
def flight(
    where: Path, speedup: float, settle_s: int = 1
) -> Iterator[tuple[Running, LoadedMission]]:
    """Two vehicles that stand there already, as real ones do, and `run`, which is told their
    endpoints."""
    mission = pair_mission(where, settle_s=settle_s)
    command = ("run", mission.source, "--speedup", str(speedup), "--headless")
    with (
        ended([simulator(mission, time.monotonic(), speedup)]),
        Running(*command, cwd=where) as running,
    ):
        yield running, mission


def test_a_run_without_truth_completes(tmp_path: Path) -> None:
    """Exit 0, all figures, and whose they are."""
    with flight(tmp_path, SPEEDUP) as (running, _):
        assert running.wait() == 0, running.output
        running.assert_nothing_left()
        summary = running.summary()
        assert (summary["outcome"], summary["reason"], summary["notes"]) == ("completed", "", [])
        assert summary["judged_by"] == {"1": "estimates", "2": "estimates"}
        assert summary["min_true_distance_m"] is None
        assert summary["min_distance_m"] > summary["r_in_m"]
        assert 0.0 < summary["min_distance_doubt_m"] < 2.0
        assert summary["time_to_form_s"] is not None
        assert summary["longest_link_m"] > summary["min_distance_m"]
        assert "judged by the vehicles' own estimates" in " ".join(running.output.split())
        page = (running.folder / "report.html").read_text()
        assert "own estimates" in page
        assert (running.folder / "figures" / "trajectories.png").exists()


@pytest.mark.long
@pytest.mark.timeout(400)
def test_a_takeover_completes(tmp_path: Path) -> None:
    """Agent 1 is killed while they form and started again by hand: it takes its vehicle over, both
    complete, and so does the run. Its vehicle's own failsafe waits for 5 s only, so the process has
    its imports done before, and the clock is slow."""
    plan, speedup = tmp_path / "plan.json", 0.5
    with flight(tmp_path, speedup, settle_s=5) as (running, mission):
        plan.write_text(plan_to_json(mission.plan, mission.fleet))
        running.wait_for(lambda: bool(list(tmp_path.glob("runs/*/processes.json"))))
        epoch_s = json.loads((running.folder / "run.json").read_text())["epoch_s"]
        with ended([again := agent_in_waiting(plan, 1, epoch_s, speedup)]):
            running.wait_for_event("step 2:", 2)
            running.kill("agent-1")
            assert again.stdin is not None
            again.stdin.close()
            assert running.wait(240) == 0, running.output
            assert again.wait(30) == 0
        summary = running.summary()
        assert (summary["outcome"], summary["reason"]) == ("completed", "")
        taken = "agent 1: its process was killed; another took its vehicle over"
        assert taken in summary["warnings"]
