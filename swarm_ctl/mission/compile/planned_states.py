"""Where the swarm is planned to be, step by step: what loader, checks, warnings and forecasts all
start from."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from swarm_ctl.core.control.reference import centred, turned
from swarm_ctl.core.model.plan import Point
from swarm_ctl.mission.geometry import slot_assignment
from swarm_ctl.mission.geometry.shapes import slots_of
from swarm_ctl.mission.input.schema import Form, MissionFile, Move, Step

FENCE_MARGIN_M = 100.0
"""Around everything planned, where a mission draws no fence of its own."""


@dataclass(frozen=True)
class Stand:
    """The swarm at the end of a step. `slots` are the last form step's, in the order of the ids
    (units)."""

    ids: tuple[int, ...]
    slots: tuple[Point, ...]
    angle_rad: float = 0.0
    scale: float = 1.0
    centre: Point = (0.0, 0.0)
    """Of the formation, in units; the law alone keeps it only roughly."""
    waypoints: tuple[Point, ...] = ()
    """Where this step takes the centre, in units."""
    height_m: float = 0.0

    @property
    def offsets(self) -> tuple[Point, ...]:
        """The slots as they stand now: turned, scaled, their mean at zero."""
        return tuple(
            turned(slot, self.angle_rad, self.scale)
            for slot in centred(dict(enumerate(self.slots))).values()
        )

    @property
    def radius(self) -> float:
        """Of the outermost slot now, in units."""
        return max(math.hypot(*offset) for offset in self.offsets)


def course(mission: MissionFile) -> list[Stand]:
    """The stand before the first step, and after each."""
    starts = {agent.id: agent.start for agent in sorted(mission.agents, key=lambda agent: agent.id)}
    points = tuple(starts.values())
    centre = (sum(p[0] for p in points) / len(points), sum(p[1] for p in points) / len(points))
    stands = [Stand(tuple(starts), points, centre=centre)]
    for step in mission.steps:
        stands.append(_after(mission, step, stands[-1]))
    return stands


def _after(mission: MissionFile, step: Step, before: Stand) -> Stand:
    before = replace(before, waypoints=())
    if step.takeoff:
        return replace(before, height_m=step.takeoff.height_m)
    if step.form:
        return replace(
            before, slots=_take_slots(mission, step.form, before.offsets), angle_rad=0.0, scale=1.0
        )
    if step.rotate:
        return replace(before, angle_rad=before.angle_rad + math.radians(step.rotate.angle_deg))
    if step.scale:
        return replace(before, scale=before.scale * step.scale.factor)
    if step.move:
        way = waypoints(step.move, before.centre)
        return replace(before, centre=way[-1], waypoints=way)
    return before


def waypoints(move: Move, centre: Point) -> tuple[Point, ...]:
    """The centre's path, in units."""
    if move.along is not None:
        return move.along
    if move.to is not None:
        return (move.to,)
    north, east = move.by or (0.0, 0.0)
    return ((centre[0] + north, centre[1] + east),)


def _take_slots(mission: MissionFile, form: Form, points: tuple[Point, ...]) -> tuple[Point, ...]:
    targets = slots_of(mission.shapes[form.shape], len(points))
    if form.slots == "nearest":
        targets = slot_assignment.nearest(points, targets)
    # Rounded (and -0 made 0) so that the plan's hash does not hang on a machine's last bits.
    return tuple((float(north), float(east)) for north, east in np.round(targets, 9) + 0.0)


def fence_box(stands: list[Stand], unit_m: float) -> tuple[Point, ...]:
    """A rectangle around everything planned, `FENCE_MARGIN_M` away from it [m]."""
    points = list(stands[0].slots)
    for before, stand in itertools.pairwise(stands):
        reach = max(before.radius, stand.radius)
        for north, east in (before.centre, *stand.waypoints, stand.centre):
            points += [(north - reach, east - reach), (north + reach, east + reach)]
    low = [math.floor(min(p[axis] for p in points) * unit_m - FENCE_MARGIN_M) for axis in (0, 1)]
    high = [math.ceil(max(p[axis] for p in points) * unit_m + FENCE_MARGIN_M) for axis in (0, 1)]
    return ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]))
