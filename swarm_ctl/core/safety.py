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


def swirled(push: Point, pull: Point) -> Point:
    """The avoidance term with a sideways part the more it opposes the pull, so that nobody gets stuck head-on.

    SAFETY.md section 1, swirl: push + 0.5 o^2 R(-90 deg) push, o = max(0, -cos(push, pull)).
    """
    sizes = math.hypot(*push) * math.hypot(*pull)
    if sizes < 1e-12:
        return push
    against = max(0.0, -(push[0] * pull[0] + push[1] * pull[1]) / sizes)
    share = 0.5 * against * against
    return push[0] + share * push[1], push[1] - share * push[0]


def climb_rate(height_error_m: float, limits: Limits) -> float:
    """The slow altitude loop: climb rate [m/s, up] for a height error [m, positive: too low]."""
    if not math.isfinite(height_error_m):
        return 0.0
    return max(-limits.descent_mps, min(limits.climb_mps, _ALTITUDE_GAIN * height_error_m))


_ALTITUDE_GAIN = 0.5
"""[1/s]: well under 1 / (dead time + lag) of any multirotor, so the loop cannot ring."""
