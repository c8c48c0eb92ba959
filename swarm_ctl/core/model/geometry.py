"""Points of the plane: (north, east), in metres or in units."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

Point = tuple[float, float]


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
