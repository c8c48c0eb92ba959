"""One behind the other on one way: where each is on it, and whose turn it is. Metres; a point is
the complex number north + 1j * east, `ends` tell how far along the way each of its corners is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

_AHEAD_M: Final = 6.0
"""Of the own place on the way, the point that is flown to: farther than a vehicle brakes in."""
_BACK_M: Final = 8.0
_ON_M: Final = 15.0
"""A vehicle is looked for on the way from so far behind where it was to so far before it: a way
may come near to itself."""
_HOME_M: Final = 1.0
"""So near to its own place a vehicle is in it."""
_TURN_M: Final = 0.3
"""Less room than this is waited for."""
STAYS: Final = -1.0
OUT: Final = math.inf


def along_way(
    way: Sequence[complex],
    ends: Sequence[float],
    was: float,
    at: complex,
    opens: float,
    home: complex,
) -> float:
    """Where on the way this point is, near where it was; `OUT` from where the way `opens` on, for
    good: its own place, `home`, may lie farther back. So is one that is in its place: its words
    from the opening may be lost."""
    if was >= opens - _TURN_M or abs(at - home) < _HOME_M:
        return OUT
    low, high = was - _BACK_M, was + _ON_M
    least, best = math.inf, was
    for k in range(len(way) - 1):
        begin, end = ends[k], ends[k + 1]
        if end < low or begin > high or end == begin:
            continue
        a, b = way[k], way[k + 1]
        leg = (b - a) / (end - begin)
        along = (leg.conjugate() * (at - a)).real
        along = min(max(max(along, low - begin), 0.0), min(high - begin, end - begin))
        away, place = abs(at - a - leg * along), begin + along
        if away < least or (away == least and place < best):
            least, best = away, place
    return OUT if best >= opens - _TURN_M else best


def point_on(way: Sequence[complex], ends: Sequence[float], along: float) -> complex:
    """So far along the way."""
    for k in range(len(way) - 1):
        begin, end = ends[k], ends[k + 1]
        if along <= end and end > begin:
            a, b = way[k], way[k + 1]
            return a + (b - a) * ((along - begin) / (end - begin))
    return way[len(way) - 1]


def next_on(own: float, ahead: float, whole: float, gap: float) -> float:
    """How far along the way to fly now; `STAYS`: its turn has not come; `OUT`: the way is open, and
    each flies to its own place.

    Args:
        own: where it is.
        ahead: where the one before it is; `OUT`, too, where there is none.
        whole: length of the way.
        gap: from one to the next.
    """
    if own == OUT:
        return OUT
    most = min(min(own + _AHEAD_M, whole), ahead - gap)
    return STAYS if most < own + _TURN_M else most
