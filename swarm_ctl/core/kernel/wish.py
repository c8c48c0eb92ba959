"""Shaping a wish, a horizontal velocity north + 1j * east, before the constraints judge it."""

from __future__ import annotations

import math
from typing import Final

PASSES: Final = -1j
"""Past an aircraft, seen from it: `away` times this is where to."""


def limited(wish: complex, speed: float) -> complex:
    """Scaled down to the speed limit. What is not finite becomes zero: to stop is right for every
    cause."""
    finite = math.isfinite(math.hypot(wish.real, wish.imag))  # abs() of huge ones raises
    return shortened(wish, speed) if finite else 0j


def shortened(vector: complex, most: float) -> complex:
    """The vector, not longer than `most`."""
    length = abs(vector)
    return vector if length <= most else vector / length * most


def bent(wish: complex, away: complex, closing: float, turns: complex = PASSES) -> complex:
    """The wish, not approaching an aircraft that stays at more than `closing`; the rest of it goes
    past, on the side that `turns` says.

    `away` points from the other to us. On free air all agents turn to the same side, so no two are
    stuck head-on.
    """
    size = abs(away)
    if size < 1e-9:
        return wish
    away /= size
    excess = -(wish * away.conjugate()).real - closing
    return wish + excess * away * (1 + turns) if excess > 0.0 else wish
