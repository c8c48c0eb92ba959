"""Where the formation is planned to stand before and after each step of a plan.

The agents' shared frame, the plan's checks, the forecast and the figures all ask here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from swarm_ctl.core.model.plan import (
    FormStep,
    MoveStep,
    Plan,
    Point,
    RotateStep,
    ScaleStep,
    Step,
    TakeoffStep,
)

_CHORD_RAD: Final = math.radians(5.0)
"""An arc is at most a thousandth of its radius outside of such a chord."""


def mean_of(points: Iterable[Point]) -> Point:
    """The centroid of at least one point."""
    found = list(points)
    return sum(p[0] for p in found) / len(found), sum(p[1] for p in found) / len(found)


def centred(slots: Sequence[Point]) -> tuple[Point, ...]:
    """The slots with their mean at zero."""
    north, east = mean_of(slots)
    return tuple((slot[0] - north, slot[1] - east) for slot in slots)


def turned(slot: Point, angle_rad: float, scale: float) -> Point:
    """A centred slot, turned clockwise (from north to east) and scaled."""
    c, s = math.cos(angle_rad) * scale, math.sin(angle_rad) * scale
    return c * slot[0] - s * slot[1], s * slot[0] + c * slot[1]


@dataclass(frozen=True, slots=True)
class PlannedFormation:
    """The formation between two steps; the law alone keeps its centre only roughly."""

    slots: tuple[Point, ...]
    """The newest form step's, in the order of `Plan.agents` [units]; at first the starts."""
    unit_m: float
    centre_m: Point
    """In the common frame."""
    angle_rad: float = 0.0
    """Clockwise from `slots`."""
    scale: float = 1.0
    """Relative to `slots`."""
    height_m: float = 0.0
    formed: bool = False
    """A form step is done."""

    @classmethod
    def at_start(cls, starts: Sequence[Point], unit_m: float) -> PlannedFormation:
        """On the ground; `starts` in units, in the order of `Plan.agents`."""
        north, east = mean_of(starts)
        return cls(tuple(starts), unit_m, (north * unit_m, east * unit_m))

    def after(self, step: Step) -> PlannedFormation:
        """The formation when `step` is done."""
        match step:
            case TakeoffStep():
                return replace(self, height_m=step.height_m)
            case FormStep():
                return replace(self, slots=step.slots, angle_rad=0.0, scale=1.0, formed=True)
            case MoveStep():
                return replace(self, centre_m=step.waypoints_m[-1])
            case RotateStep():
                return replace(self, angle_rad=step.angle_rad)
            case ScaleStep():
                return replace(self, scale=step.factor)
            case _:
                return self

    @property
    def offsets(self) -> tuple[Point, ...]:
        """The slots as they stand now [units]: turned, scaled, their mean at zero."""
        return tuple(turned(slot, self.angle_rad, self.scale) for slot in centred(self.slots))

    @property
    def places(self) -> list[Point]:
        """Each agent's place in the common frame [units]."""
        north, east = self.centre_m[0] / self.unit_m, self.centre_m[1] / self.unit_m
        return [(north + n, east + e) for n, e in self.offsets]

    def places_m(self, centre_m: Point | None = None) -> list[Point]:
        """Each agent's place in the common frame, with the centre here or at `centre_m`."""
        (north, east), unit = centre_m or self.centre_m, self.unit_m
        return [(north + n * unit, east + e * unit) for n, e in self.offsets]

    @property
    def radius_m(self) -> float:
        """From the centre to the outermost agent."""
        return max(math.hypot(*offset) for offset in self.offsets) * self.unit_m

    def ways_m(self, step: Step) -> list[tuple[Point, ...]]:
        """The way of each agent in a step that moves the formation, as corners in the common
        frame: chords of 5 degrees at most where it turns. For another step, its place after it."""
        match step:
            case MoveStep():
                poses = [self, *(replace(self, centre_m=centre) for centre in step.waypoints_m)]
            case RotateStep():
                turn = step.angle_rad - self.angle_rad
                count = max(1, math.ceil(abs(turn) / _CHORD_RAD))
                poses = [
                    replace(self, angle_rad=self.angle_rad + turn * k / count)
                    for k in range(count + 1)
                ]
            case ScaleStep():
                poses = [self, self.after(step)]
            case _:
                poses = [self.after(step)]
        return list(zip(*(pose.places_m() for pose in poses), strict=True))

    def legs_m(self, step: Step) -> list[float]:
        """How far the outermost agent goes in a step that moves the formation, leg by leg."""
        match step:
            case MoveStep():
                points = (self.centre_m, *step.waypoints_m)
                return [math.dist(a, b) for a, b in itertools.pairwise(points)]
            case RotateStep():
                return [abs(step.angle_rad - self.angle_rad) * self.radius_m]
            case ScaleStep():
                return [abs(step.factor / self.scale - 1.0) * self.radius_m]
            case _:
                return []


def planned_formations(plan: Plan) -> list[PlannedFormation]:
    """The formation before the first step (index 0), and after step k (index k, from 1)."""
    start = PlannedFormation.at_start([agent.start for agent in plan.agents], plan.unit_m)
    return list(itertools.accumulate(plan.steps, PlannedFormation.after, initial=start))
