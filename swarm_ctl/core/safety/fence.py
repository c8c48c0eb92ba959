"""The geofence: where vehicles may be. Pure geometry in the common frame."""

from __future__ import annotations

from collections.abc import Sequence

from swarm_ctl.core.model.geometry import area as area
from swarm_ctl.core.model.geometry import cross, within
from swarm_ctl.core.model.geometry import crossing_edges as crossing_edges
from swarm_ctl.core.model.plan import Fence, Point


def inside(polygon: Sequence[Point], point: Point) -> bool:
    """The point lies in the polygon. True for one of fewer than three corners."""
    return len(polygon) < 3 or within(polygon, point)


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
