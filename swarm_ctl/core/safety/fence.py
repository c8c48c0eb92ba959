"""The geofence: where vehicles may be. Pure geometry in the common frame."""

from __future__ import annotations

from collections.abc import Sequence

from swarm_ctl.core.model.plan import Fence, Point


def inside(polygon: Sequence[Point], point: Point) -> bool:
    """The point lies in the polygon (even-odd rule; concave ones too). True for one of fewer than
    three corners."""
    if len(polygon) < 3:
        return True
    north, east = point
    odd = False
    for (n1, e1), (n2, e2) in zip(polygon, (*polygon[1:], polygon[0]), strict=True):
        if (e1 > east) != (e2 > east) and north < n1 + (east - e1) / (e2 - e1) * (n2 - n1):
            odd = not odd
    return odd


def leaves(polygon: Sequence[Point], a: Point, b: Point) -> bool:
    """The straight line from a to b is not all in the polygon: it ends outside, or crosses an edge
    on its way."""
    if not (inside(polygon, a) and inside(polygon, b)):
        return True
    if len(polygon) < 3:
        return False
    return any(_cross(a, b, c, d) for c, d in zip(polygon, (*polygon[1:], polygon[0]), strict=True))


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
            if _cross(a, b, c, d):
                return i, j
    return None


def _cross(a: Point, b: Point, c: Point, d: Point) -> bool:
    """The lines from a to b and from c to d have a point in common, other than an end."""
    return _side(a, b, c) * _side(a, b, d) < 0 and _side(c, d, a) * _side(c, d, b) < 0


def _side(a: Point, b: Point, p: Point) -> float:
    """Positive where p lies right of the way from a to b, seen from above."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def outside(fence: Fence | None, point: Point, height_m: float) -> str:
    """Why this place is not allowed, or ''."""
    if fence is None:
        return ""
    if height_m > fence.height_m:
        return f"{height_m:.1f} m high; the geofence ends at {fence.height_m:g} m"
    return "" if inside(fence.polygon_m, point) else "outside the geofence"
