"""The geofence: where vehicles may be. Pure geometry in the common frame."""

from __future__ import annotations

from collections.abc import Sequence

from swarm_ctl.core.model.geometry import area as area
from swarm_ctl.core.model.geometry import cross
from swarm_ctl.core.model.geometry import crossing_edges as crossing_edges
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
    return any(cross(a, b, c, d) for c, d in zip(polygon, (*polygon[1:], polygon[0]), strict=True))


def outside(fence: Fence | None, point: Point, height_m: float) -> str:
    """Why this place is not allowed, or ''."""
    if fence is None:
        return ""
    if height_m > fence.height_m:
        return f"{height_m:.1f} m high; the geofence ends at {fence.height_m:g} m"
    return "" if inside(fence.polygon_m, point) else "outside the geofence"
