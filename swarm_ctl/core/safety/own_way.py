"""The way of one vehicle to its place, round zones and inside the fence: the next corner to fly to.

The map (`ways.py`) is made once for the zones that are in the way; a way is looked for when the
straight line is cut, and again when the place has moved or the vehicle has left its way. Metres in
the common frame; a point is the complex number north + 1j * east.
"""

from __future__ import annotations

import itertools
from collections.abc import Generator, Sequence
from typing import Final, NamedTuple

from swarm_ctl.core.kernel.walls import kept_m
from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.plan import Fence
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.safety.ways import WayMap

_LOOKS_S: Final = 0.2
"""Between two looks at whether the line is free: meanwhile the filter keeps off."""
_INSIDE_M: Final = 0.15
"""A line may come so much nearer than the filter keeps, and ..."""
_TOUCHES_M: Final = 0.1
"""... and by so much more from beside a corner, where a way just keeps off. Besides, ..."""
_BESIDE_M: Final = 0.4
"""... corners stand so much farther out than that: there is a way from where the filter has stopped
a vehicle, and corners are passed without being slowed."""
_SLICE: Final = 1
"""Parts of a search in a call: 1 ms each among fifty zones, 6 ms at most."""
_AGAIN_S: Final = 3.0
"""Where there is no way, it is looked for again after so long."""
_MOVED_M: Final = 1.0
"""A place that has moved by more has another way."""


class WayLeg(NamedTuple):
    """What is flown next."""

    to: complex
    """The place itself, or the next corner of the way."""
    left_m: float
    """From here to the place, along the way."""
    round: str
    """The zone that cuts the straight line: `zone oak`; '': none does."""
    exists: bool = True
    """There is a way."""


class OwnWay:
    """One vehicle's way. `maps`: what several have in common."""

    def __init__(
        self,
        zones: Sequence[Zone],
        fence: Fence | None,
        tick_s: float,
        maps: dict[tuple[int, ...], WayMap] | None = None,
    ) -> None:
        self._zones = tuple(zones)
        self._fence_m = fence.polygon_m if fence else ()
        self.free = not self._zones and _convex(self._fence_m)
        """Each straight line is."""
        self._maps = {} if maps is None else maps
        """By the zones that are in the way."""
        self._every, self._calls = max(1, round(_LOOKS_S / tick_s)), 0
        self._search: Generator[None, None, list[Point] | None] | None = None
        """For a way, while it is under way."""
        self._again = 0
        """No way is looked for again before this call."""
        self._none = False
        """The last search has found no way."""
        self._way: list[complex] = []
        self._leg: WayLeg | None = None
        self._goal = 0j

    def leg(self, own: complex, goal: complex, low_m: float, high_m: float) -> WayLeg:
        """Towards a place, for a vehicle between these heights. While a way is looked for, it
        stays: a part of the search is done in each call, so that none takes long."""
        straight = WayLeg(goal, abs(goal - own), "")
        if self.free:
            return straight
        self._calls += 1
        leg = self._leg
        moved = abs(goal - self._goal) > _MOVED_M
        if moved:
            self._search, self._again, self._none = None, 0, False
        if leg is None or moved or self._search or self._calls % self._every == 0:
            leg = self._leg = self._looked(own, goal, low_m, high_m)
            self._goal = goal
        if not leg.round:
            return straight
        if self._search or not leg.exists:
            return leg._replace(to=own, left_m=0.0)
        return leg._replace(left_m=self._left_m(own))

    def _looked(self, own: complex, goal: complex, low_m: float, high_m: float) -> WayLeg:
        zones = tuple(k for k, zone in enumerate(self._zones) if zone.blocks(low_m, high_m))
        if zones not in self._maps:
            self._maps[zones] = self._map(zones)
        ways, here, there = self._maps[zones], _point(own), _point(goal)
        if ways.open_line(here, there, _TOUCHES_M):
            self._way, self._search, self._none = [], None, False
            return WayLeg(goal, abs(goal - own), "")
        cut = ways.cut_by(here, there)
        fenced = cut is None or cut >= len(zones)
        name = "the fence" if fenced else f"zone {self._zones[zones[cut or 0]].name}"
        way = self._way
        if self._search is None:
            kept = way and abs(way[-1] - goal) <= _MOVED_M
            if not (kept and ways.open_line(here, _point(way[0]), _TOUCHES_M)):
                if self._calls < self._again:
                    return WayLeg(own, 0.0, name, exists=False)
                self._search, self._way = ways.search(here, there), []
        if self._search is not None and not self._searched():
            return WayLeg(own, 0.0, name, exists=not self._none)
        way = self._way
        while len(way) > 1 and ways.open_line(here, _point(way[1]), _TOUCHES_M):
            way = way[1:]
        self._way = way
        self._none = not way
        if not way:
            self._again = self._calls + round(_AGAIN_S / _LOOKS_S) * self._every
            return WayLeg(own, 0.0, name, exists=False)
        return WayLeg(way[0], 0.0, name)

    def _searched(self) -> bool:
        """Go on with the search; whether it is over."""
        assert self._search is not None  # noqa: S101 - the caller looks
        try:
            for _ in range(_SLICE):
                next(self._search)
        except StopIteration as end:
            self._search = None
            self._way = [complex(*corner) for corner in end.value[1:]] if end.value else []
            return True
        return False

    def _left_m(self, own: complex) -> float:
        return sum(abs(b - a) for a, b in itertools.pairwise((own, *self._way)))

    def _map(self, zones: tuple[int, ...]) -> WayMap:
        outlines = [
            (zone.corners_m, zone.radius_m, kept_m(zone.clearance_m) - _INSIDE_M)
            for zone in (self._zones[k] for k in zones)
        ]
        return WayMap(outlines, self._fence_m, kept_m(0.0) - _INSIDE_M, beside_m=_BESIDE_M)


def _point(at: complex) -> Point:
    return at.real, at.imag


def _convex(corners: Sequence[Point]) -> bool:
    points = [complex(*corner) for corner in corners]
    turns = [
        ((b - a).conjugate() * (c - b)).imag
        for a, b, c in zip(points, points[1:] + points[:1], points[2:] + points[:2], strict=True)
    ]
    return all(turn >= 0.0 for turn in turns) or all(turn <= 0.0 for turn in turns)


def wish_on(leg: WayLeg, own: complex, gain: float, most_mps: float) -> complex:
    """The velocity that flies a leg: slower as the place comes near, none where there is no way."""
    way = leg.to - own
    return way / max(abs(way), 1e-9) * min(most_mps, gain * leg.left_m)
