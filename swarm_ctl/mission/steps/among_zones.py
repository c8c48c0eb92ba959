"""A mission's zones as the plan has them, and the ways that a formation has among them."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Final

from swarm_ctl.core.kernel.walls import wall_margins_of
from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.plan import Plan, Response, Zone
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.safety.ways import WayMap
from swarm_ctl.mission.steps.step_kind import Mission

_TOUCHES_M: Final = 0.02
"""A way round a zone may come so much nearer than a vehicle may stay: ways are rounded."""
_GAP_M: Final = 0.1
"""How exactly the width of a gap is told."""


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


class AmongZones:
    """Where what flies between two heights can go.

    Args:
        zones: of the plan; those at other heights do not count.
        fence_m: corners of the fence; (): it is not in the way.
        response: of the vehicles.
        speed_mps: the most that they fly.
        heights_m: from, to.
    """

    def __init__(
        self,
        zones: Iterable[Zone],
        fence_m: Sequence[Point],
        response: Response,
        speed_mps: float,
        heights_m: tuple[float, float],
    ) -> None:
        self._response, self._speed_mps, self._fence_m = response, speed_mps, fence_m
        self.zones = [zone for zone in zones if zone.blocks(*heights_m)]
        """Those that are in the way."""
        self._alone = {zone.name: self._map([zone], (), -_TOUCHES_M) for zone in self.zones}

    @classmethod
    def of(cls, plan: Plan, heights_m: tuple[float, float]) -> AmongZones:
        """Of a plan."""
        fence_m = plan.fence.polygon_m if plan.fence else ()
        return cls(plan.zones, fence_m, plan.response, plan.limits.speed_mps, heights_m)

    @classmethod
    def of_mission(cls, mission: Mission, heights_m: tuple[float, float]) -> AmongZones:
        """Of a mission, lengths in units."""
        unit, vehicle = mission.unit_m, mission.vehicle
        fence_m = [(n * unit, e * unit) for n, e in mission.fence.polygon or ()]
        limits = vehicle.limits.planned()
        return cls(
            zones_of(mission), fence_m, vehicle.response.planned(), limits.speed_mps, heights_m
        )

    def cut(self, way_m: Iterable[Point]) -> str:
        """The first zone that cuts this way of one vehicle: `oak`; '': none does."""
        for a, b in itertools.pairwise(way_m):
            for name, alone in self._alone.items():
                if not alone.free_line(a, b):
                    return name
        return ""

    def leads(self, way_m: Sequence[Point]) -> bool:
        """A single vehicle has a way from corner to corner."""
        alone = self._map(self.zones, self._fence_m, -_TOUCHES_M)
        return all(alone.shortest(a, b) for a, b in itertools.pairwise(way_m))

    def round(self, before: PlannedFormation, waypoints_m: Sequence[Point]) -> tuple[Point, ...]:
        """The waypoints of the formation's centre, and between them what leads it round zones.
        Straight on where no zone cuts the way of an agent, and where there is no way."""
        found, wide = list[Point](), None
        for a, b in itertools.pairwise((before.centre_m, *waypoints_m)):
            ends = zip(before.places_m(a), before.places_m(b), strict=True)
            way: Sequence[Point] | None = None
            if any(self.cut(straight) for straight in ends):
                wide = wide or self._map(self.zones, self._fence_m, before.radius_m)
                way = wide.shortest(a, b)
            found += [(round(n, 3), round(e, 3)) for n, e in (way or ())[1:-1]] + [b]
        return tuple(found)

    def gap_m(self, a: Point, b: Point, radius_m: float) -> float:
        """How wide the widest way is that leads from a to b, and is too narrow for a formation of
        this radius; 0: there is none, for a single vehicle either."""
        low, high = 0.0, radius_m
        if self._map(self.zones, self._fence_m, low).shortest(a, b) is None:
            return 0.0
        while high - low > 0.5 * _GAP_M:
            middle = 0.5 * (low + high)
            if self._map(self.zones, self._fence_m, middle).shortest(a, b) is None:
                high = middle
            else:
                low = middle
        return 2.0 * (low + self._keep_m(min(zone.clearance_m for zone in self.zones)))

    def needed_m(self, radius_m: float) -> float:
        """How wide a gap has to be for a formation of this radius."""
        return 2.0 * (radius_m + self._keep_m(max(zone.clearance_m for zone in self.zones)))

    def _map(self, zones: Iterable[Zone], fence_m: Sequence[Point], radius_m: float) -> WayMap:
        outlines = [
            (zone.corners_m, zone.radius_m, radius_m + self._keep_m(zone.clearance_m))
            for zone in zones
        ]
        return WayMap(outlines, fence_m, radius_m + self._keep_m(0.0))

    def _keep_m(self, clearance_m: float) -> float:
        """How far stop points stay from what has this clearance."""
        return wall_margins_of(clearance_m, self._response, self._speed_mps).keep
