"""The formation with a target that moves."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, Literal, NamedTuple

from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.planned_formation import Frame
from swarm_ctl.core.model.policies import Policy
from swarm_ctl.core.model.steps.step import Step
from swarm_ctl.core.model.targets import TargetNow

LOWEST_M: Final = 2.0
BELOW_TOP_M: Final = 2.0
"""So far above the ground, and below the fence's top, a formation stays above its target."""
_CLOSES: Final = 1.5
"""[1/s] of the way to the target's place, beside its velocity."""


class Stops(NamedTuple):
    """How vehicles come to rest that are told to stop: their stop points are so far ahead."""

    dead_s: float
    """They fly on for so long, and then ..."""
    coast_m: Callable[[float], float]
    """... so far [m] from this speed [m/s]."""
    lag_s: float = 0.0
    """So late a velocity follows one that changes slowly, beside `dead_s`."""
    trim_m: float = 0.0
    """What the rest of this leaves, as was seen: the place is put so far ahead of the target."""


@dataclass(frozen=True, slots=True)
class FollowStep(Step):
    """Keep the last formation, its centre `offset_m` from a target, for `duration_s`."""

    target: str
    offset_m: Point
    """North and east; with `in_course` ahead of it and to its right."""
    in_course: bool
    speed_mps: float
    """The formation flies no faster than this after its target."""
    duration_s: float
    timeout_s: float
    lost_after_s: float = 10.0
    """Without news for so long, `on_lost` is done."""
    above_m: float | None = None
    """Fly so high above the target; None: at the flight height."""
    until_m: Point | None = None
    """The step is done before its time when the target is here, within `until_within_m`."""
    until_within_m: float = 10.0
    on_lost: Policy = Policy.HOLD
    """`hold`: the formation stands where it is until there is news again."""
    on_timeout: Policy = Policy.LAND
    kind: Literal["follow"] = "follow"

    @property
    def title(self) -> str:
        return f"follow {self.target}"

    @property
    def follows(self) -> FollowStep | None:
        return self

    @property
    def lasts_s(self) -> float | None:
        return self.duration_s

    @property
    def frame_mps(self) -> float:
        return self.speed_mps

    def reached(self, target: TargetNow | None) -> bool:
        """The target, as it is heard now, has come to where the step ends."""
        if self.until_m is None or target is None or not target.fresh:
            return False
        return abs(target.at - complex(*self.until_m)) <= self.until_within_m

    def place(self, target: TargetNow, stops: Stops) -> tuple[complex, complex, complex]:
        """Where the centre's stop point is to be now [m]; the velocity to fly for that; and by how
        much faster it moves than that [m/s]: in a turn it is on a wider circle. Vehicles whose stop
        points keep to it are at the target's place."""
        at, velocity, course = target.ahead(stops.dead_s)
        offset = complex(*self.offset_m)
        if self.in_course:
            at += offset * course
            velocity += 1j * target.turns * offset * course
        else:
            at += offset
        # of a target that is faster, the formation flies as fast as it may
        flown = velocity * (self.speed_mps / max(abs(velocity), self.speed_mps))
        coasts = flown / max(abs(flown), 1e-9) * stops.coast_m(abs(flown))
        lags = flown * stops.lag_s
        at += stops.trim_m * course
        turns = 1j * target.turns
        return at + coasts, velocity + turns * lags, turns * (coasts - lags)

    def missed_m(self, target: TargetNow, centre: complex) -> float:
        """How far the formation's centre is ahead of its place about the target."""
        offset = complex(*self.offset_m) * (target.course if self.in_course else 1.0)
        return ((centre - offset - target.at) * target.course.conjugate()).real

    def led(
        self, frame: Frame, target: TargetNow | None, stops: Stops, most_mps2: float, dt_s: float
    ) -> Frame:
        """The frame one tick later: towards the target's place, within speed and acceleration.

        Args:
            frame: now.
            target: what is known of it; None: nothing.
            stops: how vehicles come to rest.
            most_mps2: the frame accelerates no harder.
            dt_s: the tick.
        """
        at, flies, wish = complex(*frame.point_m), complex(*frame.velocity_mps), 0j
        faster = 0j
        if target is not None and target.fresh:
            place, velocity, faster = self.place(target, stops)
            way = place - at
            left_m = abs(way)
            closes = min(_CLOSES * left_m, math.sqrt(2.0 * most_mps2 * left_m))
            wish = velocity + way / max(left_m, 1e-9) * closes
            wish *= self.speed_mps / max(abs(wish), self.speed_mps)
        change = wish - flies
        flies += change * min(1.0, most_mps2 * dt_s / max(abs(change), 1e-9))
        at += (flies + faster) * dt_s
        return replace(frame, point_m=(at.real, at.imag), velocity_mps=(flies.real, flies.imag))
