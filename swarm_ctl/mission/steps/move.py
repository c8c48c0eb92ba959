"""`move`."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, ClassVar, Final

from pydantic import Field

from swarm_ctl.core.control.in_file import GAP, gap_m
from swarm_ctl.core.model.autopilots import UpAndDown
from swarm_ctl.core.model.plan import Plan, PlannedStep, Point, Zone
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.safety.among_zones import AmongZones
from swarm_ctl.mission.input.document import Findings, Mistake, Place
from swarm_ctl.mission.sections.section import NorthEast
from swarm_ctl.mission.steps.step_kind import Checks, Mission
from swarm_ctl.mission.steps.travel import Pace, Travel, TravelSection, too_fast

MAX_DISTANCE_M: Final = 5000.0
"""From the origin: further out the common frame's flat horizon is metres off the earth's."""
_PACE: Final = 0.7
"""Of its speed, in file: walls slow, and each sets out when the one before it is on its way. Eight
that flew `missions/wood.yaml` took 72 s; so, it is 70 s."""


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
        among = among_zones(mission, before.span_m)
        waypoints_m, opens_m = among.round(before, _waypoints_m(written, before))
        return MoveStep(waypoints_m, *pace, opens_m=opens_m)

    def planned(self, written: MoveSection, mission: Mission, before: PlannedFormation) -> MoveStep:
        """One in file takes longer by the length of the file."""
        step = super().planned(written, mission, before)
        if step.file is None or written.timeout_s is not None:
            return step
        file_m = GAP * mission.law.r_out * mission.unit_m * len(mission.agents)
        return replace(step, timeout_s=step.timeout_s + 30 + 2 * file_m / step.speed_mps)

    def expected_s(self, step: MoveStep, at: PlannedStep, autopilot: UpAndDown) -> float:
        """The last one sets out when the others are on their way."""
        seconds = super().expected_s(step, at, autopilot)
        if step.file is None:
            return seconds
        file_m = gap_m(at.plan) * (len(at.plan.agents) - 1)
        way_m = sum(step.legs_m(at.before))
        return seconds + (file_m + way_m * (1.0 - _PACE)) / (_PACE * step.speed_mps)

    def words(self, step: MoveStep, plan: Plan) -> str:
        corners = ", ".join(f"({north:g}, {east:g})" for north, east in step.waypoints_m)
        how = "move" if step.file is None else "move in file"
        return f"{how} to {corners} m at {step.speed_mps:g} m/s"

    def wrong(self, step: MoveStep, at: PlannedStep, place: Place, mission: Mission) -> Findings:
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


def zones_of(mission: Mission) -> tuple[Zone, ...]:
    """In metres; lengths of the mission are in units."""
    unit, found = mission.unit_m, list[Zone]()
    for name, zone in mission.zones.items():
        corners = zone.polygon or ((zone.circle,) if zone.circle else ())
        found.append(
            Zone(
                name=name,
                corners_m=tuple((n * unit, e * unit) for n, e in corners),
                radius_m=(zone.radius or 0.0) * unit,
                clearance_m=zone.clearance_m or 0.5 * mission.law.r_in * unit,
                floor_m=zone.floor_m,
                ceiling_m=zone.ceiling_m,
            )
        )
    return tuple(found)


def among_zones(mission: Mission, heights_m: tuple[float, float]) -> AmongZones:
    """The ways of a mission, lengths in units, between two heights."""
    unit = mission.unit_m
    fence_m = [(n * unit, e * unit) for n, e in mission.fence.polygon or ()]
    return AmongZones(zones_of(mission), fence_m, heights_m)
