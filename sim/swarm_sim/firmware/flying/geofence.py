"""A vehicle's own fence, from the items that it was sent. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from swarm_sim.firmware.flying.mission_items import MissionItem

_INSIDE, _OUTSIDE, _CIRCLE_INSIDE, _CIRCLE_OUTSIDE = 5001, 5002, 5003, 5004
Place = tuple[float, float]


class Geofence:
    """Which places are forbidden; `place` gives (north, east) [m] of an item."""

    def __init__(self, items: Sequence[MissionItem], place: Callable[[MissionItem], Place]) -> None:
        self._polygons: list[tuple[bool, list[Place]]] = []
        self._circles: list[tuple[bool, Place, float]] = []
        k = 0
        while k < len(items):
            item = items[k]
            if item.command in (_INSIDE, _OUTSIDE):
                count = max(1, round(item.p[0]))
                corners = [place(each) for each in items[k : k + count]]
                self._polygons.append((item.command == _INSIDE, corners))
                k += count
                continue
            if item.command in (_CIRCLE_INSIDE, _CIRCLE_OUTSIDE):
                inside = item.command == _CIRCLE_INSIDE
                self._circles.append((inside, place(item), item.p[0]))
            k += 1

    def breached(self, at: Place) -> bool:
        """It is out of an area to stay inside of, or in one to keep out of."""
        polygons = (_within(corners, at) is not inside for inside, corners in self._polygons)
        circles = ((math.dist(at, c) < r) is not inside for inside, c, r in self._circles)
        return any(polygons) or any(circles)


def _within(corners: Sequence[Place], at: Place) -> bool:
    north, east = at
    odd = False
    for (n1, e1), (n2, e2) in zip(corners, (*corners[1:], corners[0]), strict=True):
        if (e1 > east) != (e2 > east) and north < n1 + (east - e1) / (e2 - e1) * (n2 - n1):
            odd = not odd
    return odd
