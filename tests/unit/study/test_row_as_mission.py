"""A row as a mission: real agents, drivers and simulated vehicles fly what the row flew."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from swarm_ctl.mission.compile.loader import load
from swarm_ctl.study.executor import run_study
from swarm_ctl.study.parameter_space import Study
from swarm_ctl.study.rerun import Rerun, rerun, write_mission
from swarm_ctl.virtual.scenario import MeshQuality, load_scenario
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm
from tests.on_demand import on_demand

UNLIKE: dict[str, Any] = {
    "missions": 2,
    "start": "crossing",
    "slots": "given",
    "h": 0.2,
    "limit_s": 25.0,
    "model_dead_time_s": 0.4,
}


def never_asked(mission: Path) -> float:
    """A row in which no agent dies does not ask when its form step begins."""
    raise AssertionError(mission)


def flown(folder: Path, **settings: Any) -> Rerun:
    """The second row of a small study."""
    run_study(
        Study.model_validate(UNLIKE | settings), folder / "a.csv", 1, Console(file=io.StringIO())
    )
    return rerun(folder / "a.csv", 1)


@pytest.mark.parametrize("dead_time_s", [on_demand(1.9), 0.9, on_demand(0.4)])
def test_the_vehicles_of_a_row_fly_again(dead_time_s: float, tmp_path: Path) -> None:
    """On the virtual clock the smallest distance is the row's, whether the vehicles answer as their
    agents believe or later."""
    row = flown(tmp_path, n=4, dead_time_s=dead_time_s)
    assert write_mission(row, tmp_path / "row.yaml", never_asked) == []
    swarm = VirtualSwarm(load(tmp_path / "row.yaml"))
    swarm.run(30.0)
    smallest = swarm.closest_m / row.batch.cell.unit_m
    assert smallest == pytest.approx(row.row["smallest_units"], abs=0.03)


def test_each_agent_keeps_its_own_vehicle_and_its_belief(tmp_path: Path) -> None:
    """Lag, dead time and acceleration by agent; speed, wind and the law's constants."""
    truth = {
        "spread": "agent",
        "lag_s": "0.2:0.9",
        "dead_time_s": "0.1:0.8",
        "acceleration_mps2": "2:4",
    }
    row = flown(tmp_path, **truth, speed_mps=7, model_lag_s=0.3, law={"delta_a": 0.2})
    write_mission(row, tmp_path / "row.yaml", never_asked)
    with pytest.raises(OSError, match="/dev/full"):  # a full disk is named
        write_mission(row, Path("/dev/full"), never_asked)
    mission = load(tmp_path / "row.yaml")
    for k, entry in enumerate(mission.fleet.agents):
        true = entry.simulated_response
        assert true is not None
        for name in ("lag_s", "dead_time_s", "acceleration_mps2"):
            assert getattr(true, name) == getattr(row.batch, name)[k, 0]
        assert entry.response == row.batch.cell.model
    assert mission.plan.limits.speed_mps == 7
    assert mission.plan.law.delta_a == 0.2


def test_deaths_and_losses_make_it_a_scenario(tmp_path: Path) -> None:
    """Its mission, its mesh, and each death so long after the form step begins."""
    row = flown(tmp_path, delay_s=0.1, jitter_s=0.05, loss=0.2, silent=1, silent_agents=2)
    assert (
        write_mission(row, tmp_path / "row.yaml", lambda mission: load(mission).plan.unit_m) == []
    )
    scenario, mission = load_scenario(tmp_path / "row.yaml")
    assert scenario.mesh == MeshQuality(loss=0.2, delay_s=0.1, jitter_s=0.05)
    after_s = row.batch.silent_s[:, 0]
    died = [k for k in range(row.batch.cell.n) if math.isfinite(after_s[k])]
    assert len(died) == 2
    assert [each.kill for each in scenario.happens] == [(k + 1,) for k in died]
    at_s = [each.at_s - mission.plan.unit_m for each in scenario.happens]
    assert at_s == pytest.approx([after_s[k] for k in died], abs=0.001)


def test_what_neither_can_carry_is_named(tmp_path: Path) -> None:
    """Bursts, and a delay of each agent."""
    row = flown(tmp_path, delay_s="0:0.1", spread="agent", loss=0.2, burst_s=0.3, limit_s=3)
    lost = write_mission(row, tmp_path / "row.yaml", never_asked)
    assert [each.split()[0] for each in lost] == ["delay_s", "burst_s"]
    assert load_scenario(tmp_path / "row.yaml")[0].mesh == MeshQuality(loss=0.2)
