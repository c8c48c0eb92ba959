"""How far a leader's frame is believed: on its step's way, at its step's pace."""

from __future__ import annotations

from dataclasses import replace

import pytest

from swarm_ctl.core.control.reference import FrameBounds, Places
from swarm_ctl.core.model.planned_formation import Frame
from swarm_ctl.core.model.steps.hold import HoldStep
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.steps.rotate import RotateStep
from swarm_ctl.core.model.steps.scale import ScaleStep
from swarm_ctl.core.model.steps.step import Step

RADIUS_M, SPEED, TICK_S = 12.0, 2.0, 0.05
MOVE = MoveStep(((20.0, 0.0), (20.0, 30.0)), SPEED, 0.5, 2.0, 60.0)
ROTATE = RotateStep(1.5, SPEED, 0.5, 2.0, 60.0)
SCALE = ScaleStep(2.5, SPEED, 0.5, 2.0, 60.0)
HOLD = HoldStep(60.0, 90.0)
START = Frame((0.0, 0.0))
IN_PLACE = Places(0.3, 0.1, 0.1)
AWAY = Places(9.0, 9.0, 9.0)
"""No vehicle is where this frame has it."""


def followed(step: Step, seconds: float, bounds: FrameBounds, frame: Frame = START) -> Frame:
    """An honest leader at full speed: believed in every tick. Its frame at the end."""
    bounds.begin(frame)
    for k in range(round(seconds / TICK_S)):
        path = step.path
        feeds = path is not None and path.left_m(frame, RADIUS_M) > 0.02
        if path is not None:
            frame = path.advanced(replace(frame, rate=1.0), TICK_S, RADIUS_M)
        assert bounds.doubt(frame, step, RADIUS_M, k * TICK_S, IN_PLACE, feeds=feeds) == ""
    return frame


@pytest.mark.parametrize("step", [MOVE, ROTATE, SCALE, HOLD], ids=lambda step: step.kind)
def test_an_honest_leader_is_believed_to_the_end(step: Step) -> None:
    frame = followed(step, 5.0, FrameBounds())
    followed(step, 25.0, FrameBounds(), frame)


@pytest.mark.parametrize(
    ("step", "changes"),
    [
        (MOVE, {"scale": 0.1}),
        (MOVE, {"angle_rad": 1.0}),
        (MOVE, {"leg": 2}),
        (MOVE, {"point_m": (8.0, 9.0)}),
        (MOVE, {"point_m": (-4.0, 0.0)}),
        (ROTATE, {"scale": 0.5}),
        (ROTATE, {"angle_rad": -0.5}),
        (ROTATE, {"angle_rad": 1.5}),
        (SCALE, {"scale": 0.0}),
        (SCALE, {"scale": 0.5}),
        (SCALE, {"scale": 2.5}),
        (HOLD, {"scale": 0.1}),
        (HOLD, {"angle_rad": 0.3}),
        (HOLD, {"point_m": (3.0, 0.0)}),
    ],
)
@pytest.mark.parametrize("known_s", [2.0, 0.0])
def test_a_frame_off_its_way_or_before_its_time_is_not_believed(
    step: Step, changes: dict[str, object], known_s: float
) -> None:
    """In the middle of a step; and as the first word of it, where no vehicle is there."""
    bounds = FrameBounds()
    frame = followed(step, known_s, bounds)
    jumped = {"leg", "angle_rad", "scale"} & changes.keys()
    if known_s == 0.0 and jumped and changes in ({"angle_rad": 1.5}, {"scale": 2.5}):
        return  # the end of the step's own way, late or not
    hostile = replace(frame, **changes)  # type: ignore[arg-type]
    assert "its formation" in bounds.doubt(hostile, step, RADIUS_M, known_s, AWAY, feeds=True)


@pytest.mark.parametrize("start", [START, None], ids=["known", "not-known"])
def test_who_leads_after_this_agent_goes_on_from_its_frame(start: Frame | None) -> None:
    """An agent that was held comes back to the middle of a step, far from its place, and leads: by
    the frame of the one that led until then, and by no other."""
    bounds, middle = FrameBounds(), START
    bounds.begin(start)
    assert MOVE.path is not None
    for k in range(400):
        middle = MOVE.path.advanced(replace(middle, rate=1.0), TICK_S, RADIUS_M)
        bounds.lead(middle, k * TICK_S)
    ahead = MOVE.path.advanced(middle, 4.0, RADIUS_M)
    back = replace(middle, point_m=(20.0, 8.0))
    for hostile in (ahead, back, replace(middle, point_m=(30.0, 9.0)), replace(middle, scale=0.5)):
        why = bounds.doubt(hostile, MOVE, RADIUS_M, 20.5, AWAY, feeds=False)
        assert "its formation" in why
    assert bounds.doubt(middle, MOVE, RADIUS_M, 20.5, AWAY, feeds=False) == ""
    assert "moved by" in bounds.doubt(ahead, MOVE, RADIUS_M, 20.6, AWAY, feeds=False)


def test_a_rate_without_motion_is_not_believed_for_long() -> None:
    """Others would fly on by it while the frame stands."""
    bounds = FrameBounds()
    frame = replace(followed(MOVE, 2.0, bounds), rate=1.0)
    found = [
        bounds.doubt(frame, MOVE, RADIUS_M, 2.0 + k * TICK_S, AWAY, feeds=True) for k in range(80)
    ]
    assert found[0] == ""
    assert "what its rate says" in found[-1]
    frame = replace(frame, rate=0.0)
    believed = [
        bounds.doubt(frame, MOVE, RADIUS_M, 6.0 + k * TICK_S, AWAY, feeds=True) == ""
        for k in range(300)
    ]
    assert believed[-1], "a leader that tells no more than it flies is believed again"


@pytest.mark.parametrize("hz", [18.7, 16.0])
def test_a_leader_that_loses_ticks_is_believed_however_long_its_way(hz: float) -> None:
    """Its frame moves by whole ticks, and a busy machine gives it fewer: 15.6 Hz of 20 were seen
    for seconds, and 18.7 Hz for a minute, on a way of 150 m."""
    bounds, far = FrameBounds(), replace(MOVE, waypoints_m=((300.0, 0.0),))
    frame = START
    bounds.begin(frame)
    for k in range(2500):
        frame = far.path.advanced(replace(frame, rate=1.0), TICK_S, RADIUS_M)
        assert bounds.doubt(frame, far, RADIUS_M, k / hz, IN_PLACE, feeds=True) == ""


def test_a_creeping_shrink_is_not_believed() -> None:
    """By 2 % a second, in a hold: never a jump, and off its way at last."""
    bounds = FrameBounds()
    followed(HOLD, 1.0, bounds)
    doubts = []
    for k in range(1, 200):
        scale = 1.0 - 0.001 * k
        where = Places(0.2, 0.2, 0.2)  # all vehicles follow
        doubts.append(
            bounds.doubt(replace(START, scale=scale), HOLD, RADIUS_M, k * 0.05, where, feeds=True)
        )
    assert doubts[0] == ""
    assert "off its way" in doubts[-1]
