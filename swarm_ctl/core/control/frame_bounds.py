"""How far a leader's frame is believed: as far as its step, its age and the places allow.

All agents of a formation take their frame from one of them (`reference.py`). So what that one says
of it is held against what each of them knows:

- its way: from where the frame stood when the step began, along the step's own path, not beside it;
- its pace: no faster along it than the step flies, and no slower than the rate that it tells;
- after a target: no faster than the step flies;
- at first, where the vehicles are: the leader near its place, or all of them near theirs.

A frame that is not believed is not followed: the formation stands, and the leader is named.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from swarm_ctl.core.model.formation_frame import Frame
from swarm_ctl.core.model.steps.step import Step, strayed
from swarm_ctl.core.swarm.plausibility import JUMP_M

_BESIDE_M: Final = 1.0
"""Of its way: what rounding, and a leader that changes, bring about; in a small formation `_SMALL`
of its radius, so that no shape is turned or shrunk by more."""
_SMALL: Final = 0.15
_FASTER: Final = 1.05
"""Than the step's speed: two clocks run at the same rate to much less."""
_PACE_S: Final = 0.5
"""Of the way at full speed: states are at most so late, and clocks are known better."""
_FORGETS_S: Final = 5.0
"""A rate that leads too far: on a busy machine a leader loses ticks, and its frame moves by whole
ticks. So a fifth of them may be lost for as long as a move takes."""
_LATE_S: Final = 10.0
"""A step begins so much later on one agent than on another, at most: a command reaches all in this
time, or none."""


class FrameBounds:
    """What one agent believes of the frame in one step."""

    def __init__(self) -> None:
        self._start: Frame | None = None
        """Where the frame stood when the step began; None: not known."""
        self._first_m: float | None = None
        """How far along the step's way the first frame was that was believed."""
        self._first_s = self._last_s = -math.inf
        self._pace_mps = 0.0
        """Of the step in which a frame was believed last."""
        self._ahead_m = 0.0
        """How far the rates that were told have of late led beyond the frames."""
        self._done_m, self._fed_s = 0.0, -math.inf
        """How far along its way the last frame was, and when."""
        self._led: tuple[Frame, float] | None = None
        """The last frame of a target that was believed, and when."""

    def begin(self, start: Frame | None) -> None:
        """A step begins, with the frame here."""
        self._start, self._first_m, self._ahead_m, self._led = start, None, 0.0, None

    def doubt(
        self, frame: Frame, step: Step, radius_m: float, now: float, places: Places, *, feeds: bool
    ) -> str:
        """Why this frame is not believed, or ''.

        `radius_m` is the outermost place's distance from the centre at scale 1. `feeds`: the rate
        that it tells is flown now.
        """
        if step.follows is not None:
            return self._doubt_led(frame, step.frame_mps, radius_m, now)
        speed = step.frame_mps
        tolerance_m = step.settling.tolerance_m if step.settling else 0.0
        beside_m = min(_BESIDE_M, _SMALL * radius_m)
        if self._first_m is None:
            lag_m = self._pace_mps * min(_LATE_S, max(0.0, now - self._last_s) + _PACE_S)
            first_m = beside_m + lag_m
            why = self._doubt_first(frame, step, radius_m, tolerance_m, first_m, places)
            if why and places.worst_m > min(tolerance_m + JUMP_M, 2 * _SMALL * radius_m):
                return why
            if why or self._start is None:
                self._start = frame
            self._first_m, self._first_s = step.along(self._start, frame, radius_m)[0], now
            if not why:
                beside_m += lag_m
        start = self._start or frame
        done_m, off_m = step.along(start, frame, radius_m)
        if off_m > beside_m:
            if self._first_s != now:
                return _off(off_m, beside_m)
            self._start, self._first_m = frame, 0.0
            done_m = step.along(frame, frame, radius_m)[0]
        most_m = speed * (_FASTER * (now - self._first_s) + _PACE_S) + beside_m
        if done_m - self._first_m > most_m:
            gone = f"{done_m - self._first_m:.1f} m in {now - self._first_s:.1f} s"
            return f"its formation moved by {gone}; allowed: {most_m:.1f} m"
        self._feed(done_m, frame.rate * speed if feeds else 0.0, now)
        allowed_m = speed * 2 * _PACE_S + beside_m
        if self._ahead_m > allowed_m:
            behind = f"stays {self._ahead_m:.1f} m behind what its rate says"
            return f"its formation {behind}; allowed: {allowed_m:.1f} m"
        self._last_s, self._pace_mps = now, speed
        return ""

    def _doubt_led(self, frame: Frame, most_mps: float, radius_m: float, now: float) -> str:
        """Of a frame that a target leads: no plan knows its way, but its speed has a limit."""
        beside_m = min(_BESIDE_M, _SMALL * radius_m)
        # an agent that was held by an order comes back to a frame that has gone on without it
        began = self._start or frame, min(now - _LATE_S, self._last_s)
        last, since_s = self._led or began
        apart_m, turned_m, grown_m = strayed(last, frame, radius_m)
        if turned_m + grown_m > beside_m:
            return _off(turned_m + grown_m, beside_m)
        most_m = most_mps * (_FASTER * (now - since_s) + _PACE_S) + beside_m
        if apart_m > most_m:
            gone = f"{apart_m:.1f} m in {now - since_s:.1f} s"
            return f"its formation moved by {gone}; allowed: {most_m:.1f} m"
        speed = math.hypot(*frame.velocity_mps)
        if speed > _FASTER * most_mps:
            return f"its formation moves at {speed:.1f} m/s; allowed: {most_mps:g} m/s"
        self._led = frame, now
        self._last_s, self._pace_mps = now, most_mps
        return ""

    def _feed(self, done_m: float, speed_mps: float, now: float) -> None:
        """The frame is so far along its way, and its rate has been flown at this speed since the
        last one, believed or not."""
        if self._first_s == now:
            self._ahead_m = 0.0
        elif now > self._fed_s:
            passed_s = min(now - self._fed_s, _PACE_S)
            led_m = speed_mps * passed_s - (done_m - self._done_m)
            self._ahead_m = self._ahead_m * math.exp(-passed_s / _FORGETS_S) + led_m
        self._done_m, self._fed_s = done_m, now

    def _doubt_first(
        self,
        frame: Frame,
        step: Step,
        radius_m: float,
        tolerance_m: float,
        beside_m: float,
        places: Places,
    ) -> str:
        """Of the first frame in a step."""
        if self._start is None:
            start = Frame(frame.point_m, leg=frame.leg)
            _, off_m = step.along(start, frame, radius_m)
            off_m += max(0.0, places.centre_off_m - JUMP_M)
            return _off(off_m, beside_m) if off_m > beside_m else ""
        done_m, off_m = step.along(self._start, frame, radius_m)
        if off_m > beside_m:
            return _off(off_m, beside_m)
        near = places.leader_off_m <= tolerance_m + JUMP_M
        most_m = step.frame_mps * _LATE_S + beside_m
        if done_m <= most_m or near:
            return ""
        return f"its formation is {done_m:.1f} m on its way; allowed: {most_m:.1f} m"


class Places(NamedTuple):
    """How far vehicles are from their places in a frame [m]."""

    worst_m: float
    """The farthest peer that is heard."""
    leader_off_m: float
    centre_off_m: float
    """The centre, by all that are heard."""


def _off(off_m: float, allowed_m: float) -> str:
    return f"its formation is {off_m:.1f} m off its way; allowed: {allowed_m:.1f} m"
