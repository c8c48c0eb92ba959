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


def within(polygon: Sequence[Point], point: Point) -> bool:
    """The point lies in the polygon of at least three corners (even-odd rule; concave ones
    too)."""
    north, east = point
    odd = False
    for (n1, e1), (n2, e2) in zip(polygon, (*polygon[1:], polygon[0]), strict=True):
        if (e1 > east) != (e2 > east) and north < n1 + (east - e1) / (e2 - e1) * (n2 - n1):
            odd = not odd
    return odd


def area(polygon: Sequence[Point]) -> float:
    """Enclosed by the corners in order (the shoelace formula), in the square of their unit."""
    pairs = zip(polygon, (*polygon[1:], polygon[0]), strict=True)
    return abs(sum(n1 * e2 - n2 * e1 for (n1, e1), (n2, e2) in pairs)) / 2


def crossing_edges(polygon: Sequence[Point]) -> tuple[int, int] | None:
    """Two edges that cross (edge k goes from corner k to the next), or None: the fence would not be
    what was meant."""
    edges = list(zip(polygon, (*polygon[1:], polygon[0]), strict=True)) if polygon else []
    for j, (c, d) in enumerate(edges):
        for i, (a, b) in enumerate(edges[:j]):
            if cross(a, b, c, d):
                return i, j
    return None


def cross(a: Point, b: Point, c: Point, d: Point) -> bool:
    """The lines from a to b and from c to d have a point in common, other than an end."""
    return _side(a, b, c) * _side(a, b, d) < 0 and _side(c, d, a) * _side(c, d, b) < 0


def _side(a: Point, b: Point, p: Point) -> float:
    """Positive where p lies right of the way from a to b, seen from above."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
