"""A simulated vehicle that answers with a dead time, a lag and bounded acceleration."""

from __future__ import annotations

import math

import numpy as np
import pytest

from swarm_sim.physics.kinematics import Demands, MotionState, advance
from swarm_sim.physics.response import LagResponse
from swarm_sim.world.world import STEP_S


def step_response(response: LagResponse, speed_mps: float, seconds: float) -> list[float]:
    """Northward speed after each step, two vehicles in the air."""
    state = MotionState.at_rest(np.array([[0.0, 0.0, -10.0]] * 2), response)
    state.landed[:], state.ground[:] = False, 0.0
    demands = Demands.idle(state)
    demands.lift[:] = True
    demands.velocity[:, 0] = speed_mps
    found = []
    for _ in range(round(seconds / STEP_S)):
        advance(state, demands, response, STEP_S)
        assert (state.velocity[0] == state.velocity[1]).all()
        found.append(float(state.velocity[0, 0]))
    return found


def test_it_waits_then_follows_its_lag() -> None:
    """Nothing in the dead time; 63 % of the step one lag later."""
    speeds = step_response(LagResponse(0.5, 50.0, round(0.4 / STEP_S)), 1.0, 2.0)
    dead = round(0.4 / STEP_S)
    assert speeds[dead - 1] == 0.0
    assert speeds[dead] > 0.0
    assert speeds[dead + round(0.5 / STEP_S) - 1] == pytest.approx(1 - math.exp(-1), abs=1e-6)


def test_its_acceleration_is_bounded() -> None:
    speeds = step_response(LagResponse(0.1, 2.0), 5.0, 2.0)
    assert max(np.diff([0.0, *speeds])) == pytest.approx(2.0 * STEP_S)
