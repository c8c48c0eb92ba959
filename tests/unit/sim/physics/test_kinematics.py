"""Properties of the kinematics, for every response."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swarm_sim.physics.kinematics import Array, Demands, MotionState, VelocityResponse, advance
from swarm_sim.physics.response import ArdupilotResponse, IdealResponse, Px4Response

DT = 0.01
REAL: list[ArdupilotResponse | Px4Response] = [ArdupilotResponse(), Px4Response()]

N = 32
"""Vehicles a drawn example has: array passes make them cheap."""
targets = arrays(np.float64, (6, N, 3), elements=st.floats(-20.0, 20.0))


def hovering(
    response: VelocityResponse, n: int = 1, height_m: float = 1e5
) -> tuple[MotionState, Demands]:
    state = MotionState.at_rest(np.zeros((n, 3)), response)
    state.landed[:] = False
    state.position[:, 2] = -height_m
    demands = Demands.idle(state)
    demands.lift[:] = True
    return state, demands


def run(state: MotionState, demands: Demands, response: VelocityResponse, seconds: float) -> None:
    for _ in range(round(seconds / DT)):
        advance(state, demands, response, DT)


@pytest.mark.parametrize("response", REAL)
@settings(max_examples=10)
@given(sequence=targets)
def test_acceleration_and_speed_stay_within_their_bounds(
    response: ArdupilotResponse | Px4Response, sequence: Array
) -> None:
    """Whatever the targets: horizontal force within the lean limit, so speed within what drag
    balances at it."""
    state, demands = hovering(response, N)
    # a PX4's attitude swings over by 7 % of its way
    lean = (
        response.lean_mps2 if isinstance(response, ArdupilotResponse) else 1.15 * response.tilt_mps2
    )
    fastest = 12.0 if isinstance(response, Px4Response) else 11.0
    for target in sequence:
        demands.velocity[:] = target
        for _ in range(100):
            before = np.hypot(state.velocity[:, 0], state.velocity[:, 1])
            advance(state, demands, response, DT)
            air = np.hypot(state.velocity[:, 0], state.velocity[:, 1])
            drag = before * (
                1.0
                if isinstance(response, Px4Response)
                else 0.29 + 0.024 * np.abs(state.velocity).sum(axis=1)
            )
            assert (
                np.hypot(state.acceleration[:, 0], state.acceleration[:, 1])
                <= lean + 1.05 * drag + 1e-9
            ).all()
            assert (air <= fastest).all()
            assert (np.abs(state.acceleration[:, 2]) <= response.lift_mps2 + 12.0).all()


@settings(max_examples=10)
@given(sequence=targets)
def test_arducopter_shapes_its_target_within_acceleration_and_jerk(sequence: Array) -> None:
    """WPNAV_ACCEL and PSC_JERK_XY bound the horizontal *vectors* of the shaped path; more only over
    WPNAV_SPEED_DN."""
    response = ArdupilotResponse()
    state, demands = hovering(response, N)
    before = np.zeros((N, 3))
    climb_mps2 = np.full(N, response.climb_mps2)
    for target in sequence:
        climb_mps2[np.abs(target[:, 2]) > response.descent_mps] = 0.7 * response.lift_mps2
        demands.velocity[:] = target
        for _ in range(50):
            advance(state, demands, response, DT)
            shaped = state.memory[:, 2].copy()
            change = shaped - before
            assert (np.hypot(shaped[:, 0], shaped[:, 1]) <= response.acceleration_mps2 + 1e-9).all()
            assert (np.hypot(change[:, 0], change[:, 1]) <= response.jerk_mps3 * DT + 1e-9).all()
            assert (np.abs(shaped[:, 2]) <= climb_mps2 + 1e-9).all()
            before = shaped


@pytest.mark.parametrize("response", REAL)
def test_a_held_position_is_reached_without_overshoot_worth_the_name(
    response: VelocityResponse,
) -> None:
    """One flight of a minute, to many goals; the first is where it begins."""
    goal = np.random.default_rng(1).uniform(-60.0, 60.0, (N, 3))
    goal[0] = 0.0
    state, demands = hovering(response, N)
    start = state.position.copy()
    demands.position[:], demands.hold[:] = start + goal, 1.0
    length = np.hypot(goal[:, 0], goal[:, 1])
    along = goal[:, :2] / np.maximum(length, 1e-9)[:, None]
    overshoot = np.zeros(N)
    for _ in range(6000):
        advance(state, demands, response, DT)
        gone = ((state.position - start)[:, :2] * along).sum(axis=1)
        overshoot = np.maximum(overshoot, gone - length)
    np.testing.assert_allclose(state.position, start + goal, atol=0.1)
    assert (overshoot < 0.05 + 0.05 * length).all()


def test_turns_to_its_heading_the_short_way() -> None:
    response = IdealResponse()
    state, demands = hovering(response)
    state.heading[:] = math.radians(170.0)
    demands.heading[:] = math.radians(-170.0)
    run(state, demands, response, 0.1)
    assert math.degrees(state.heading[0]) == pytest.approx(176.0)
    run(state, demands, response, 1.0)
    assert math.remainder(state.heading[0] - demands.heading[0], 2 * math.pi) == pytest.approx(
        0.0, abs=1e-9
    )
