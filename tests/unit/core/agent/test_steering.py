"""From a decision to the goal that goes to the vehicle."""

from __future__ import annotations

from dataclasses import replace

import pytest

from swarm_ctl.core.agent.steering import FlyTo
from swarm_ctl.core.model.vehicle import FlyGoal
from tests.unit.core.builders import Own, fix


def test_the_vehicle_is_told_the_drift_less_so_its_position_moves_as_wished() -> None:
    """What the agent believes and tells stays the wish."""
    goals = []
    for drift_mps in ((0.0, 0.0), (0.3, -0.2)):
        own = Own()
        goal = own.steering.fly(
            own.tick(fix=replace(fix(), drift_mps=drift_mps)), FlyTo((9.0, 0.0), 1.0)
        )
        assert isinstance(goal, FlyGoal)
        goals.append(goal.velocity_ned_mps[:2])
        assert own.controller.setpoint_mps == pytest.approx(goals[0])
    assert goals[1] == pytest.approx((goals[0][0] - 0.3, goals[0][1] + 0.2))
