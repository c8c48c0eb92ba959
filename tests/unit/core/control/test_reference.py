"""The shared frame: it arrives, never overshoots, and its feed-forward is its derivative."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from swarm_ctl.core.control.reference import rate_towards
from swarm_ctl.core.model.geometry import turned
from swarm_ctl.core.model.planned_formation import Frame
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.steps.rotate import RotateStep
from swarm_ctl.core.model.steps.scale import ScaleStep
from swarm_ctl.core.model.steps.step import Path

RADIUS_M = 20.0
POINT = st.tuples(st.floats(-200, 200), st.floats(-200, 200))
STEPS = st.one_of(
    st.builds(
        lambda way, v: MoveStep(tuple(way), v, 0.5, 2.0, 60.0),
        st.lists(POINT, min_size=1, max_size=4),
        st.floats(0.5, 5),
    ),
    st.builds(
        lambda angle, v: RotateStep(angle, v, 0.5, 2.0, 60.0), st.floats(-7, 7), st.floats(0.5, 5)
    ),
    st.builds(
        lambda factor, v: ScaleStep(factor, v, 0.5, 2.0, 60.0), st.floats(0.2, 4), st.floats(0.5, 5)
    ),
)


def flown(step: Path, seconds: float, error_m: float | None = 0.0) -> Frame:
    frame = Frame((3.0, -4.0))
    for _ in range(round(seconds / 0.05)):
        frame = replace(frame, rate=rate_towards(frame, step, RADIUS_M, error_m, 1.4, 0.05))
        frame = step.advanced(frame, 0.05, RADIUS_M)
    return frame


@given(STEPS)
def test_the_frame_arrives_and_stays(step: Path) -> None:
    """In the time the way needs at its speed, with a start and a stop on each leg."""
    way = step.left_m(Frame((3.0, -4.0)), RADIUS_M)
    if isinstance(step, MoveStep):
        points = [(3.0, -4.0), *step.waypoints_m]
        way = sum(math.dist(a, b) for a, b in itertools.pairwise(points))
    legs = len(step.waypoints_m) if isinstance(step, MoveStep) else 1
    done = flown(step, way / step.speed_mps + legs * (step.speed_mps / 1.4 + 6.0) + 1.0)
    assert step.arrived(done, RADIUS_M)
    if isinstance(step, MoveStep):
        assert math.dist(done.point_m, step.waypoints_m[-1]) < 0.03
    assert step.advanced(done, 10.0, RADIUS_M).point_m == pytest.approx(done.point_m, abs=0.03)


@given(STEPS, st.tuples(st.floats(-20, 20), st.floats(-20, 20)), st.floats(0.1, 1))
def test_feed_forward_is_the_derivative_of_the_place(
    step: Path, slot: tuple[float, float], rate: float
) -> None:
    """Of each slot's place in the frame, whatever the step."""
    frame, dt = Frame((3.0, -4.0), 0.2, 1.1, 0, rate), 1e-5
    if step.left_m(frame, RADIUS_M) < 0.1:
        return
    later = step.advanced(frame, dt, RADIUS_M)

    def place(f: Frame) -> tuple[float, float]:
        north, east = turned(slot, f.angle_rad, f.scale)
        return f.point_m[0] + north, f.point_m[1] + east

    (n0, e0), (n1, e1) = place(frame), place(later)
    place_m = turned(slot, frame.angle_rad, frame.scale)
    velocity = step.motion(frame, RADIUS_M).of(complex(*place_m))
    assert velocity.real == pytest.approx((n1 - n0) / dt, rel=1e-2, abs=1e-3)
    assert velocity.imag == pytest.approx((e1 - e0) / dt, rel=1e-2, abs=1e-3)


@given(STEPS)
def test_the_frame_waits_for_the_shape_and_stops_when_blind(step: Path) -> None:
    """Two metres out of tolerance, or with a peer unheard, it does not move."""
    assume(step.left_m(Frame((3.0, -4.0)), RADIUS_M) > 0.1)
    for error_m in (2.6, None):
        assert flown(step, 20.0, error_m) == Frame((3.0, -4.0))


@given(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), st.floats(-7, 7))
def test_turning_keeps_lengths_and_is_clockwise(slot: tuple[float, float], angle: float) -> None:
    assert math.hypot(*turned(slot, angle, 2.0)) == pytest.approx(2 * math.hypot(*slot), abs=1e-9)
    assert turned((1.0, 0.0), math.pi / 2, 1.0) == pytest.approx((0.0, 1.0))
