"""Zones: places that vehicles keep out of, as plain frozen data in the common frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Final

from annotated_types import Ge, MinLen

from swarm_ctl.core.model.geometry import Point, within

HEIGHT_ROOM_M: Final = 1.5
"""A zone counts from so far under its floor to so far over its ceiling: a height loop's error, and
what a barometer drifts by."""
_DRAWN: Final = 32
"""Corners of a circle on a map."""


@dataclass(frozen=True, slots=True)
class Zone:
    """A polygon, or a circle, that no vehicle may enter between two heights."""

    name: str
    corners_m: Annotated[tuple[Point, ...], MinLen(1)]
    """(north, east), in order; of a circle its centre alone."""
    radius_m: Annotated[float, Ge(0)]
    """Of a circle; 0: it is a polygon."""
    clearance_m: Annotated[float, Ge(0)]
    """No vehicle's position comes closer to it."""
    floor_m: float | None = None
    """It begins at this height above the origin; None: at the ground."""
    ceiling_m: float | None = None
    """It ends there; None: nowhere."""

    @property
    def outline_m(self) -> tuple[Point, ...]:
        """Its corners; of a circle, those of a polygon that is drawn for it."""
        if len(self.corners_m) > 1:
            return self.corners_m
        ((north, east),) = self.corners_m
        turns = [2.0 * math.pi * k / _DRAWN for k in range(_DRAWN)]
        r = self.radius_m
        return tuple((north + r * math.cos(a), east + r * math.sin(a)) for a in turns)

    def contains(self, point: Point) -> bool:
        """It is there, whatever its height."""
        if len(self.corners_m) == 1:
            return math.dist(point, self.corners_m[0]) < self.radius_m
        return within(self.corners_m, point)

    def blocks(self, low_m: float, high_m: float) -> bool:
        """Whether it is in the way of what flies between these heights, give or take
        `HEIGHT_ROOM_M`."""
        over = self.ceiling_m is not None and low_m > self.ceiling_m + HEIGHT_ROOM_M
        under = self.floor_m is not None and high_m < self.floor_m - HEIGHT_ROOM_M
        return not over and not under
