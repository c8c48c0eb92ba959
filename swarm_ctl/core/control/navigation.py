"""Where the own vehicle is in the common frame, from what it says of its own frame.

Each vehicle's LOCAL_POSITION_NED counts from its own origin. Where that origin lies is
GPS_GLOBAL_ORIGIN's word; the offset to the mission's origin is constant, so it is worked out once
per origin. Velocities need no origin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from swarm_ctl.core.model.frames import ned_from_geodetic
from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.core.model.vehicle import Vector3, VehicleView

AGREE_M = 5.0
"""GLOBAL_POSITION_INT and the local position may differ by this much [m] horizontally: both come
from one estimator, so more than latency at full speed (5 m/s for 0.5 s) and rounding means that an
origin is wrong."""


@dataclass(frozen=True, slots=True)
class OwnFix:
    """The own vehicle in the common frame. `position_ned_m` is carried on to the time it was asked
    for."""

    age_s: float
    position_ned_m: Vector3
    velocity_ned_mps: Vector3
    height_m: float
    """Above the vehicle's own origin; differences of it are what counts."""


class Navigator:
    """Turns views into fixes; remembers the offset of the vehicle's origin."""

    def __init__(self, origin: Geodetic) -> None:
        self._origin = origin
        self._vehicle_origin: Geodetic | None = None
        self._offset: Vector3 = (0.0, 0.0, 0.0)

    def fix(self, view: VehicleView, now: float) -> OwnFix | None:
        """Position at `now`, carried on from the last report at its velocity for at most half a
        second."""
        if view.local is None or view.origin is None:
            return None
        if view.origin != self._vehicle_origin:
            self._vehicle_origin = view.origin
            self._offset = ned_from_geodetic(view.origin, self._origin)
        age = max(0.0, now - view.local.time_s)
        ahead = min(age, 0.5)
        (n, e, d), (vn, ve, vd) = view.local.position_ned_m, view.local.velocity_ned_mps
        off = self._offset
        position = (n + off[0] + vn * ahead, e + off[1] + ve * ahead, d + off[2] + vd * ahead)
        return OwnFix(age, position, (vn, ve, vd), -d)

    def disagreement_m(self, view: VehicleView, fix: OwnFix) -> float:
        """Horizontal distance between the fix and GLOBAL_POSITION_INT [m]; 0 while there is
        none."""
        if view.global_ is None:
            return 0.0
        north, east, _ = ned_from_geodetic(view.global_.position, self._origin)
        return math.hypot(north - fix.position_ned_m[0], east - fix.position_ned_m[1])
