"""What an agent's parts share: the setpoint that goes to the vehicle."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.unit.core.builders import NOW, context, fix


def test_the_vehicle_is_told_the_drift_less_so_its_position_moves_as_wished() -> None:
    """What the agent believes and tells stays the wish."""
    own = context()
    drifting = replace(fix(), drift_mps=(0.3, -0.2))
    own.controller.send(1.0 + 2.0j)
    goal = own.setpoint(NOW, drifting, (1.0, 2.0))
    assert goal.velocity_ned_mps[:2] == pytest.approx((0.7, 2.2))
    assert own.controller.setpoint_mps == (1.0, 2.0)


def test_without_a_fix_the_setpoint_is_zero() -> None:
    assert context().setpoint(NOW, None, (1.0, 2.0)).velocity_ned_mps == (0.0, 0.0, 0.0)
