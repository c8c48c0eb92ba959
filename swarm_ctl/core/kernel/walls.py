"""Walls as constraints of velocities: the edges of zones, which are kept out of, and of the fence,
which is stayed inside of. One half-plane for each wall that is near, on the own stop point:

    n . v >= min(leave, -RATE (gap - D))                           keep-off: `keep_off`
    |v| <= slow + min((v_max - slow) (gap - D) / zone, sqrt(2 a (gap - D))),
    |v| <= (spare + gap - D) / unsure                              caution near D: `wall_cap`

`n` points from the nearest point of the wall to the stop point, `gap` is their distance. A wall
makes no way: the whole burden is ours. To leave one that does not hold gives way to pairs
(`core/kernel/decide.py`). What is proven of it, and what is only measured:
`docs/understand/safety-evidence.md`.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from swarm_ctl.core.kernel.constraints import RATE, circling
from swarm_ctl.core.model.plan import Response

ERROR_M: Final = 0.5
"""Of D, beside the clearance: what the estimate of the own position is off by. Both real autopilots
say 0.3 m, one standard deviation, in simulation."""
_LEAVES: Final = 0.2
"""Of the top speed: how fast a vehicle leaves a zone that it is in by fault."""
_STEP_M: Final = 0.05


class WallMargins(NamedTuple):
    """The lengths [m] and speeds [m/s] of one clearance."""

    keep: float
    """D: how far from the wall the stop point stays."""
    slow: float
    """Speed allowed at D."""
    zone: float
    """Beyond D plus this, no corner slows."""
    spare: float
    """Of D, what doubt of the own response may use up."""
    reach: float
    """A wall that is farther from the stop point asks for nothing."""
    speed: float
    """The top speed."""
    braking: float
    """Acceleration that is counted on to stop."""
    leaves: float
    """How fast a zone is left."""


NO_WALL_MARGINS: Final = WallMargins(
    keep=0.0, slow=0.0, zone=1.0, spare=0.0, reach=0.0, speed=0.0, braking=0.0, leaves=0.0
)


def kept_m(clearance_m: float) -> float:
    """How far stop points stay from a wall from which positions are to stay `clearance_m`."""
    return clearance_m + ERROR_M


def wall_margins_of(
    clearance_m: float, response: Response, speed_mps: float, scale_m: float = 1.0
) -> WallMargins:
    """For vehicles with this response, whose positions are to stay `clearance_m` from the wall;
    lengths are units of `scale_m`.

    A position is an average of past stop points. Inside of a convex region that holds the stop
    points, it is held as well; round a corner of a zone it cuts inside: with stop points on a
    circle of radius x around the corner, positions stay `x F(v tau / x)` from it (safety.md, Proven
    2). `slow` and `zone` are chosen so that this is `clearance_m` at least.
    """
    keep = kept_m(clearance_m)
    slow = min(circling(clearance_m, keep, response), speed_mps)
    zone = _STEP_M
    while circling(clearance_m, keep + zone, response) < speed_mps:
        zone += _STEP_M
    stops = (speed_mps - slow) ** 2 / (2.0 * response.acceleration_mps2)
    # the doubt of a vehicle that was never measured
    sure = speed_mps * response.doubt_s - ERROR_M
    reach = keep + max(zone, speed_mps / RATE, stops, sure)
    braking = response.acceleration_mps2
    lengths = (keep, slow, zone, ERROR_M, reach, speed_mps, braking, _LEAVES * speed_mps)
    return WallMargins(*(length / scale_m for length in lengths))


class Edge(NamedTuple):
    """A part of a wall: the line from `first` to `last`, or a circle around both."""

    first: complex
    last: complex
    radius: float
    """Of the circle; 0: it is a line."""


class Wall(NamedTuple):
    """What one edge that is near asks for."""

    normal: complex
    """The unit vector from its nearest point to the own stop point; from the wrong side, to it."""
    gap: float
    """Distance of the two; from the wrong side under 0."""
    about: int
    """Which zone it is of; `FENCE`: of the fence."""


FENCE: Final = -1
NO_WALL: Final = Wall(1 + 0j, math.inf, FENCE)


def faced(edge: Edge, point: complex) -> tuple[complex, float]:
    """The unit vector to a point from the nearest one of the edge, and their distance; under 0
    inside of a circle. On a line itself, the vector is to its right."""
    first, last, radius = edge
    along = last - first
    squared = along.real * along.real + along.imag * along.imag
    q = point - first
    if squared > 0.0:
        share = (q.real * along.real + q.imag * along.imag) / squared
        q -= along * min(max(share, 0.0), 1.0)
    x = math.sqrt(q.real * q.real + q.imag * q.imag)
    if x < 1e-9:
        q = along * -1j if squared > 0.0 else complex(1.0, 0.0)
        normal = q / math.sqrt(q.real * q.real + q.imag * q.imag)
    else:
        normal = q / x
    return normal, x - radius


def keep_off(gap: float, margins: WallMargins) -> float:
    """The least velocity along the normal."""
    return min(margins.leaves, -RATE * (gap - margins.keep))


def wall_cap(gap: float, unsure_s: float, margins: WallMargins) -> float:
    """Speed allowed at this distance.

    Args:
        gap: to the wall.
        unsure_s: the own stop point is off by at most this times the own speed.
        margins: lengths and speeds.
    """
    room = max(0.0, gap - margins.keep)
    share = min(1.0, room / margins.zone)
    turns = margins.slow + (margins.speed - margins.slow) * share
    stops: float = margins.slow + math.sqrt(2.0 * margins.braking * room)
    sure = (margins.spare + room) / max(unsure_s, 1e-3)
    return min(min(turns, stops), min(sure, margins.speed))
