"""The ways that a formation has among zones: together, in file, or none."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from swarm_ctl.core.kernel.queue import point_on
from swarm_ctl.core.kernel.walls import kept_m
from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.plan import Plan, Zone
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.safety.ways import AROUND, BESIDE_M, WayMap

_TOUCHES_M: Final = 0.02
"""A way round a zone may come so much nearer than a vehicle may stay: ways are rounded."""
_SPARE_M: Final = 0.5
"""In file, vehicles stay so much farther off than the filter keeps them: they are not slowed."""
_LONGER: Final = 1.5
"""A way that is wide enough for all, and longer than one vehicle's by this factor, is not taken."""
_STEP_M: Final = 1.0
_GAP_M: Final = 0.1
"""How exactly the width of a gap is told."""
_LEAST_M: Final = 0.02
"""What is so narrow is no gap."""


class AmongZones:
    """Where what flies between two heights can go.

    Args:
        zones: of the plan; those at other heights do not count.
        fence_m: corners of the fence; (): it is not in the way.
        heights_m: from, to.
    """

    def __init__(
        self, zones: Iterable[Zone], fence_m: Sequence[Point], heights_m: tuple[float, float]
    ) -> None:
        self._fence_m = fence_m
        self.zones = [zone for zone in zones if zone.blocks(*heights_m)]
        """Those that are in the way."""
        self._alone = {zone.name: self._map([zone], (), -_TOUCHES_M) for zone in self.zones}

    @classmethod
    def of(cls, plan: Plan, heights_m: tuple[float, float]) -> AmongZones:
        """Of a plan."""
        fence_m = plan.fence.polygon_m if plan.fence else ()
        return cls(plan.zones, fence_m, heights_m)

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

    def round(
        self, before: PlannedFormation, waypoints_m: Sequence[Point]
    ) -> tuple[tuple[Point, ...], float | None]:
        """The waypoints of the formation's centre, and between them what leads it round zones; and
        None, or that it goes in file, until so much of its way is left.

        Straight on where no zone cuts the way of an agent, and where there is no way. In file where
        no way is wide enough for all, or each is much longer than that of one vehicle.
        """
        legs = list(itertools.pairwise((before.centre_m, *waypoints_m)))
        together, single, narrow = list[Point](), list[Point](), False
        if not any(
            self.cut(way)
            for a, b in legs
            for way in zip(before.places_m(a), before.places_m(b), strict=True)
        ):
            return tuple(waypoints_m), None
        wide = self._map(self.zones, self._fence_m, before.radius_m)
        alone = self._map(self.zones, self._fence_m, _SPARE_M)
        for a, b in legs:
            way, short = wide.shortest(a, b), alone.shortest(a, b)
            straight = zip(before.places_m(a), before.places_m(b), strict=True)
            if not any(self.cut(each) for each in straight):
                way = [a, b]
            elif short and len(before.slots) > 1:
                narrow = narrow or way is None or _length_m(way) > _LONGER * _length_m(short)
            together += _rounded(way or [a, b])
            single += _rounded(short or way or [a, b])
        if not narrow:
            return tuple(together), None
        return tuple(single), _open_m([before.centre_m, *single], wide)

    def in_file(
        self, before: PlannedFormation, to_m: Point
    ) -> tuple[tuple[Point, ...], float] | None:
        """The way on which all follow one another, whether there is a wider one or not, and so much
        of it as is left where it is wide enough for all; None: there is none."""
        way = self._map(self.zones, self._fence_m, _SPARE_M).shortest(before.centre_m, to_m)
        if way is None:
            return None
        single = tuple(_rounded(way))
        wide = self._map(self.zones, self._fence_m, before.radius_m)
        return single, _open_m([before.centre_m, *single], wide)

    def single(self, start_m: Point, way_m: Sequence[Point]) -> tuple[Point, ...] | None:
        """The way of one vehicle along these corners, round what cuts it. A corner that it may not
        pass is left out, but the last; None: there is no way."""
        keeps = self._map(self.zones, self._fence_m, _SPARE_M)
        clear = self._map(self.zones, self._fence_m, _SPARE_M - _TOUCHES_M)
        corners = [at for at in way_m[:-1] if clear.free(np.array([complex(*at)]))[0]]
        found = list[Point]()
        for a, b in itertools.pairwise((start_m, *corners, way_m[-1])):
            short = [a, b] if clear.free_line(a, b) else keeps.shortest(a, b)
            if short is None:
                return None
            found += _rounded(short)
        return tuple(found)

    def lacks_m(self, a: Point, b: Point, *, many: bool) -> float | None:
        """How much wider the widest gap from a to b has to be for one vehicle, or for `many` in
        file; 0: they have a way; None: there is no gap."""
        high = _SPARE_M if many else 0.0
        needed_m, low = (high, -max((kept_m(zone.clearance_m) for zone in self.zones), default=0))
        if self._map(self.zones, self._fence_m, high).shortest(a, b) is not None:
            return 0.0
        if self._map(self.zones, self._fence_m, low).shortest(a, b) is None:
            return None
        while high - low > 0.25 * _GAP_M:
            middle = 0.5 * (low + high)
            if self._map(self.zones, self._fence_m, middle).shortest(a, b) is None:
                high = middle
            else:
                low = middle
        return (1.0 + AROUND) * (needed_m - low)

    def needed_m(self, *, many: bool) -> tuple[float, float]:
        """How wide a gap has to be for one vehicle, or for `many` in file: between two zones, and
        between a zone and the fence. Enough for all: no corner of a way is nearer to one side than
        it has to be, and none is blocked by the other."""
        spare = _SPARE_M if many else 0.0
        keep = spare + kept_m(max(zone.clearance_m for zone in self.zones))
        return (1.0 + AROUND) * keep + BESIDE_M, AROUND * keep + BESIDE_M + spare + kept_m(0.0)

    def off_m(self, name: str, radius_m: float) -> float:
        """How far from this zone the middle of a formation of this radius stays."""
        return radius_m + kept_m(next(z.clearance_m for z in self.zones if z.name == name))

    def roomy(self, name: str, at: Point, radius_m: float) -> bool:
        """A formation of this radius may stand there, as far as this zone goes."""
        zones = [zone for zone in self.zones if zone.name == name]
        return bool(self._map(zones, (), radius_m).free(np.array([complex(*at)]))[0])

    def _map(self, zones: Iterable[Zone], fence_m: Sequence[Point], radius_m: float) -> WayMap:
        outlines = [
            (zone.corners_m, zone.radius_m, max(_LEAST_M, radius_m + kept_m(zone.clearance_m)))
            for zone in zones
        ]
        return WayMap(outlines, fence_m, max(_LEAST_M, radius_m + kept_m(0.0)))


def _length_m(way: Sequence[Point]) -> float:
    return sum(math.dist(a, b) for a, b in itertools.pairwise(way))


def _rounded(way: Sequence[Point]) -> list[Point]:
    """Without its first point, and to millimetres but for the last."""
    return [*((round(n, 3), round(e, 3)) for n, e in way[1:-1]), way[-1]]


def _open_m(way: Sequence[Point], wide: WayMap) -> float:
    """So much of the end of a way is wide enough for all."""
    points, whole = [complex(*corner) for corner in way], _length_m(way)
    ends = [0.0, *itertools.accumulate(math.dist(a, b) for a, b in itertools.pairwise(way))]
    open_m = 0.0
    while open_m + _STEP_M < whole:
        at = point_on(points, ends, whole - open_m - _STEP_M)
        if not wide.free(np.array([at]))[0]:
            break
        open_m += _STEP_M
    return open_m
