"""`move`."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Final

from pydantic import Field

from swarm_ctl.core.model.plan import Plan, Point
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.mission.input.document import Mistake, Place
from swarm_ctl.mission.input.findings import Findings
from swarm_ctl.mission.sections.section import NorthEast
from swarm_ctl.mission.steps.among_zones import AmongZones
from swarm_ctl.mission.steps.step_kind import Checks, Mission, Setting
from swarm_ctl.mission.steps.travel import Pace, Travel, TravelSection, too_fast

MAX_DISTANCE_M: Final = 5000.0
"""From the origin: further out the common frame's flat horizon is metres off the earth's."""


class MoveSection(TravelSection):
    """Move the formation's centre along a path and keep the shape. Give `to`, `along` or `by`."""

    to: NorthEast | None = None
    """Where the centre goes: [north, east] of the origin."""
    along: Annotated[tuple[NorthEast, ...], Field(min_length=1, max_length=200)] | None = None
    """Waypoints of the centre, each as `to`."""
    by: NorthEast | None = None
    """How far the centre goes: [north, east] of where it is planned to be."""


def _one_way(written: MoveSection, place: Place, _mission: Mission) -> Findings:
    given = [name for name in ("to", "along", "by") if getattr(written, name) is not None]
    if len(given) != 1:
        what = f"has {' and '.join(given) or 'no way to go'}"
        yield Mistake(place, what, "one of to, along, by")


class Move(Travel[MoveSection, MoveStep]):
    """The formation along waypoints."""

    section = MoveSection
    checks: ClassVar[Checks] = (("vehicle", _one_way), ("vehicle", too_fast))

    def led(
        self, written: MoveSection, mission: Mission, before: PlannedFormation, pace: Pace
    ) -> MoveStep:
        among = AmongZones.of_mission(mission, (before.height_m, before.height_m))
        return MoveStep(among.round(before, _waypoints_m(written, before)), *pace)

    def words(self, step: MoveStep, plan: Plan) -> str:
        corners = ", ".join(f"({north:g}, {east:g})" for north, east in step.waypoints_m)
        return f"move to {corners} m at {step.speed_mps:g} m/s"

    def wrong(self, step: MoveStep, at: Setting, place: Place, mission: Mission) -> Findings:
        """The common frame is flat."""
        for centre in step.waypoints_m if at.plan.fence is not None else ():
            if math.hypot(*centre) > MAX_DISTANCE_M:
                what = f"goes {math.hypot(*centre):.0f} m from the origin"
                yield Mistake(place, what, f"at most {MAX_DISTANCE_M:g} m")
        yield from super().wrong(step, at, place, mission)


def _waypoints_m(move: MoveSection, before: PlannedFormation) -> tuple[Point, ...]:
    unit = before.unit_m
    if move.by is not None:
        north, east = before.centre_m
        return ((north + move.by[0] * unit, east + move.by[1] * unit),)
    way = move.along or ((move.to,) if move.to else ())
    return tuple((north * unit, east * unit) for north, east in way)
