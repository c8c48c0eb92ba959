"""The last word between the law and the vehicle: no velocity reaches a vehicle without passing here.

Today it is the speed limit. The collision filter takes its place beside it, with this same call.
"""

from __future__ import annotations

import math

from swarm_ctl.core.plan import Limits, Point


def protect(desired_mps: Point, limits: Limits) -> Point:
    """The horizontal velocity (north, east) to command for `desired_mps`: scaled to the speed limit, same direction.

    A velocity that is not finite becomes zero: stopping is the one answer that is right for every cause.
    """
    speed = math.hypot(*desired_mps)
    if not math.isfinite(speed):
        return (0.0, 0.0)
    if speed <= limits.speed_mps:
        return desired_mps
    return shortened(desired_mps, limits.speed_mps)


def shortened(vector: Point, most: float) -> Point:
    """The vector, not longer than `most`."""
    length = math.hypot(*vector)
    return vector if length <= most else (vector[0] / length * most, vector[1] / length * most)


def bent(wish: Point, away: Point, closing_mps: float) -> Point:
    """The wish, not closing in faster than `closing_mps` on somebody who stays; what is too much goes past it.

    `away` points from the other to us. Everybody turns to the same side, so nobody is stuck head-on.
    """
    size = math.hypot(*away)
    if size < 1e-9:
        return wish
    north, east = away[0] / size, away[1] / size
    excess = -(wish[0] * north + wish[1] * east) - closing_mps
    if excess <= 0.0:
        return wish
    return wish[0] + excess * (north + east), wish[1] + excess * (east - north)


def climb_rate(height_error_m: float, limits: Limits) -> float:
    """The slow altitude loop: climb rate [m/s, up] for a height error [m, positive: too low]."""
    if not math.isfinite(height_error_m):
        return 0.0
    return max(-limits.descent_mps, min(limits.climb_mps, _ALTITUDE_GAIN * height_error_m))


_ALTITUDE_GAIN = 0.5
"""[1/s]: well under 1 / (dead time + lag) of any multirotor, so the loop cannot ring."""
