"""The velocity nearest to a wish that a disc and half-planes allow: an exact quadratic program in
two dimensions.

Solved incrementally, as linear programs of few dimensions are (de Berg et al., Computational
Geometry, ch. 4; ORCA does the same): the best so far stays best while nothing forbids it; otherwise
the best lies on the line that does. Where nothing is allowed, all half-planes are relaxed by the
same least slack: none is dropped.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

_EXACT: Final = 1e-9
_PARALLEL: Final = 1e-12
_HALVINGS: Final = 18
"""Of the slack: 1 / 260,000 of the largest violation."""


class Row(NamedTuple):
    """A half-plane of velocities, `north v_n + east v_e >= bound`, and where it comes from."""

    north: float
    """Of the unit normal, as the next."""
    east: float
    bound: float
    soft: bool
    """It gives way before all that are not. Soft rows stand behind the hard ones."""
    source: int
    """What asks for it: `PAIRS`, `LINKS` of `core/kernel/decide.py`."""
    about: int
    """The aircraft that it is about."""


NO_ROW: Final = Row(1.0, 0.0, 0.0, False, 0, 0)


def violated(row: Row, wish: complex) -> bool:
    """Whether it forbids the wish."""
    return row.north * wish.real + row.east * wish.imag < row.bound


def nearest(
    wish: complex, rows: Sequence[Row], used: int, cap: float, slack: float, soft_slack: float
) -> tuple[bool, complex]:
    """Whether the first `used` rows and |v| <= cap allow any velocity, and the one that is nearest
    to the wish.

    Args:
        wish: what is asked for.
        rows: hard ones first.
        used: how many of them count.
        cap: the speed that is allowed.
        slack: by so much hard rows give way.
        soft_slack: likewise soft ones; under 0: they do not count.
    """
    x, y = wish.real, wish.imag
    size = math.hypot(x, y)
    if size > cap:
        x, y = x / size * cap, y / size * cap
    for k in range(used):
        nx, ny, b, soft, _, _ = rows[k]
        if soft and soft_slack < 0.0:
            break
        b -= soft_slack if soft else slack
        if nx * x + ny * y >= b - _EXACT:
            continue
        room = cap * cap - b * b
        if room < 0.0:
            return False, 0j
        high = math.sqrt(room)
        low = -high
        for i in range(k):
            mx, my, c, gives, _, _ = rows[i]
            c -= soft_slack if gives else slack
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


def relaxed(wish: complex, rows: Sequence[Row], used: int, cap: float) -> tuple[complex, float]:
    """As `nearest`, giving way where not all rows are possible together: the soft ones first, by
    the least common slack, then the hard ones. Returns the velocity and the slack of the hard rows
    (0 where they hold)."""
    exists, found = nearest(wish, rows, used, cap, 0.0, 0.0)
    if exists:
        return found, 0.0
    exists, found = nearest(wish, rows, used, cap, 0.0, -1.0)
    slack = 0.0
    if not exists:
        # with that much slack standing still is allowed
        most = -math.inf
        for k in range(used):
            if not rows[k].soft:
                most = max(most, rows[k].bound)
        found, slack = _least(wish, rows, used, cap, 0j, most, -1.0)
    most = 0.0
    for k in range(used):
        nx, ny, b, soft, _, _ = rows[k]
        if soft:
            most = max(most, b - nx * found.real - ny * found.imag)
    if most > 0.0:
        found, _ = _least(wish, rows, used, cap, found, most, slack)
    return found, slack


def _least(
    wish: complex,
    rows: Sequence[Row],
    used: int,
    cap: float,
    best: complex,
    high: float,
    firm: float,
) -> tuple[complex, float]:
    """The least slack that allows something; `best` is allowed with slack `high`. It is that of the
    soft rows beside a slack `firm` of the hard ones; where `firm` is under 0, of the hard ones
    alone."""
    low = 0.0
    for _ in range(_HALVINGS):
        slack = 0.5 * (low + high)
        if firm < 0.0:
            exists, found = nearest(wish, rows, used, cap, slack, -1.0)
        else:
            exists, found = nearest(wish, rows, used, cap, firm, slack)
        if exists:
            high, best = slack, found
        else:
            low = slack
    return best, high
