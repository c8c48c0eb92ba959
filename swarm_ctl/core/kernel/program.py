"""The velocity nearest to a wish that a disc and half-planes allow: an exact quadratic program in
two dimensions.

Solved incrementally, as linear programs of few dimensions are (de Berg et al., Computational
Geometry, ch. 4; ORCA does the same): the best so far stays best while nothing forbids it; otherwise
the best lies on the line that does. Where nothing is allowed, the half-planes of the highest level
that can do it are relaxed by the same least slack: none is dropped.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

_EXACT: Final = 1e-9
_PARALLEL: Final = 1e-12
_HALVINGS: Final = 18
"""Of the slack: 1 / 260,000 of the largest violation."""


WALL: Final = 0
"""Levels. Rows of this one give way to each other alone ..."""
PAIR: Final = 1
"""... these to walls as well ..."""
LEAVE: Final = 2
"""... these, which lead out of a zone, to both ..."""
LINK: Final = 3
"""... and these to all."""
NONE: Final = (0.0, 0.0, 0.0, 0.0)
"""No level gives way."""


class Row(NamedTuple):
    """A half-plane of velocities, `north v_n + east v_e >= bound`, and where it comes from."""

    north: float
    """Of the unit normal, as the next."""
    east: float
    bound: float
    level: int
    """It gives way before those of lower levels. Rows stand in the order of their levels."""
    source: int
    """What asks for it: `WALLS`, `PAIRS`, `LINKS` of `core/kernel/decide.py`."""
    about: int
    """The aircraft that it is about, or the zone."""


NO_ROW: Final = Row(1.0, 0.0, 0.0, WALL, 0, 0)


def violated(row: Row, wish: complex) -> bool:
    """Whether it forbids the wish."""
    return row.north * wish.real + row.east * wish.imag < row.bound


def nearest(
    wish: complex,
    rows: Sequence[Row],
    used: int,
    cap: float,
    last: int,
    slacks: tuple[float, float, float, float],
) -> tuple[bool, complex]:
    """Whether the first `used` rows and |v| <= cap allow any velocity, and the one that is nearest
    to the wish.

    Args:
        wish: what is asked for.
        rows: by level.
        used: how many of them are asked.
        cap: the speed that is allowed.
        last: rows of higher levels do not count.
        slacks: by so much the rows of each level give way.
    """
    x, y = wish.real, wish.imag
    size = math.hypot(x, y)
    if size > cap:
        x, y = x / size * cap, y / size * cap
    for k in range(used):
        nx, ny, b, level, _, _ = rows[k]
        if level > last:
            break
        b -= slacks[level]
        if nx * x + ny * y >= b - _EXACT:
            continue
        room = cap * cap - b * b
        if room < 0.0:
            return False, 0j
        high = math.sqrt(room)
        low = -high
        for i in range(k):
            mx, my, c, lower, _, _ = rows[i]
            c -= slacks[lower]
            slope, missing = my * nx - mx * ny, c - b * (mx * nx + my * ny)
            if abs(slope) < _PARALLEL:
                if missing > _EXACT:
                    return False, 0j
            elif slope > 0.0:
                low = max(low, missing / slope)
            else:
                high = min(high, missing / slope)
        if low > high:
            return False, 0j
        along = min(max(ny * -wish.real + nx * wish.imag, low), high)
        x, y = b * nx - along * ny, b * ny + along * nx
    return True, complex(x, y)


def relaxed(
    wish: complex, rows: Sequence[Row], used: int, cap: float
) -> tuple[complex, tuple[float, float, float, float]]:
    """As `nearest`, giving way where not all rows are possible together: level by level, the
    highest first, by the least common slack of each. Returns the velocity and the slacks (0 where
    the rows of a level hold)."""
    exists, found = nearest(wish, rows, used, cap, LINK, NONE)
    if exists:
        return found, NONE
    slacks, found = NONE, 0j
    for level in range(LINK + 1):
        if level == WALL and rows[0].level > WALL:
            continue
        exists, allowed = nearest(wish, rows, used, cap, level, slacks)
        if exists:
            found = allowed
            continue
        # with that much slack what was found so far is allowed; at first, to stand still
        most = 0.0
        for k in range(used):
            row = rows[k]
            if row.level == level:
                most = max(most, row.bound - row.north * found.real - row.east * found.imag)
        found, slacks = _least(wish, rows, used, cap, level, slacks, found, most)
    return found, slacks


def _least(
    wish: complex,
    rows: Sequence[Row],
    used: int,
    cap: float,
    level: int,
    slacks: tuple[float, float, float, float],
    best: complex,
    high: float,
) -> tuple[complex, tuple[float, float, float, float]]:
    """The least slack of the rows of this level that allows something, beside the `slacks` of the
    lower ones; `best` is allowed with slack `high`."""
    low = 0.0
    for _ in range(_HALVINGS):
        slack = 0.5 * (low + high)
        exists, found = nearest(wish, rows, used, cap, level, _with(slacks, level, slack))
        if exists:
            high, best = slack, found
        else:
            low = slack
    return best, _with(slacks, level, high)


def _with(
    slacks: tuple[float, float, float, float], level: int, slack: float
) -> tuple[float, float, float, float]:
    wall, pair, leave, link = slacks
    if level == WALL:
        return slack, pair, leave, link
    if level == PAIR:
        return wall, slack, leave, link
    return (wall, pair, slack, link) if level == LEAVE else (wall, pair, leave, slack)
