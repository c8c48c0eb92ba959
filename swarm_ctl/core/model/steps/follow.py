"""The formation with a target that moves."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, Literal, NamedTuple

from swarm_ctl.core.model.formation_frame import Frame
from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.policies import Policy
from swarm_ctl.core.model.steps.step import Step
from swarm_ctl.core.model.targets import TargetNow

PREDICTED_S: Final = 1.0
"""News of a target is carried on for so long; then the formation brakes, and stands."""
_CLOSES: Final = 1.0
"""[1/s] of the way to the target's place, beside its velocity."""
_BRAKES: Final = 0.5
"""Of the acceleration of the frame: how hard the rest of that way is braked."""


class Stops(NamedTuple):
    """How vehicles come to rest that are told to stop: their stop points are so far ahead."""

    dead_s: float
    """They fly on for so long, and then ..."""
    coast_m: Callable[[float], float]
    """... so far [m] from this speed [m/s]."""


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

    def place(self, target: TargetNow, stops: Stops) -> tuple[complex, complex]:
        """Where the centre's stop point is to be now, and how it moves: vehicles whose stop points
        keep to it are at the target's place."""
        at, velocity, course = target.ahead(stops.dead_s)
        offset = complex(*self.offset_m)
        if self.in_course:
            at += offset * course
            velocity += 1j * target.turns * offset * course
        else:
            at += offset
        coasts = velocity / max(abs(velocity), 1e-9) * stops.coast_m(abs(velocity))
        return at + coasts, velocity + 1j * target.turns * coasts

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
        if target is not None and target.age_s <= PREDICTED_S:
            place, velocity = self.place(target, stops)
            way = place - at
            left_m = abs(way)
            closes = min(_CLOSES * left_m, math.sqrt(2.0 * _BRAKES * most_mps2 * left_m))
            wish = velocity + way / max(left_m, 1e-9) * closes
            wish *= self.speed_mps / max(abs(wish), self.speed_mps)
        change = wish - flies
        flies += change * min(1.0, most_mps2 * dt_s / max(abs(change), 1e-9))
        at += flies * dt_s
        return replace(frame, point_m=(at.real, at.imag), velocity_mps=(flies.real, flies.imag))
