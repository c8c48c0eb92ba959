"""A row as a mission: real agents, drivers and simulated vehicles fly what the row flew."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from swarm_ctl.mission.compile.loader import load
from swarm_ctl.study.executor import run_study
from swarm_ctl.study.parameter_space import Study
from swarm_ctl.study.rerun import Rerun, rerun, write_mission
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
    assert write_mission(row, tmp_path / "row.yaml") == []
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
    write_mission(row, tmp_path / "row.yaml")
    mission = load(tmp_path / "row.yaml")
    for k, entry in enumerate(mission.fleet.agents):
        true = entry.simulated_response
        assert true is not None
        for name in ("lag_s", "dead_time_s", "acceleration_mps2"):
            assert getattr(true, name) == getattr(row.batch, name)[k, 0]
        assert entry.response == row.batch.cell.model
    assert mission.plan.limits.speed_mps == 7
    assert mission.plan.law.delta_a == 0.2


def test_what_a_mission_cannot_carry_is_named(tmp_path: Path) -> None:
    """The mesh's delay and losses, and deaths."""
    row = flown(tmp_path, delay_s=0.1, jitter_s=0.05, loss=0.2, burst_s=0.3, silent=1, limit_s=3)
    names = [lost.split()[0] for lost in write_mission(row, tmp_path / "row.yaml")]
    assert names == ["delay_s", "jitter_s", "loss", "burst_s", "the"]
