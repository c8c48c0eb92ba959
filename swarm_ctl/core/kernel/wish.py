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


ALIGN_RATE: Final = 0.5
"""[1/s]: an eighth of the law's own, and slow against the age of any news that counts (0.5 s)."""


def pull(own: complex, total: complex, count: int) -> complex:
    """Out of slow modes: the velocity [length/s] to where the slot is by the average error of all
    that are heard, for an error `own` among `count` others, whose errors sum up to `total`.

    The law's consensus runs along the links of N_i. Where the graph is long and thin, what is left
    of an error takes minutes from end to end: the slowest mode's rate is `kappa h` times the second
    eigenvalue of the graph's normalised Laplacian, 0.01 and less for fifty agents. The mesh carries
    each agent's state to all others, so

        v_i += rate (mean_j e_j - e_i),     j: all that are heard and fly the same shape, and i

    adds `rate` to the decay of each mode but the common one, and does not move the mean of agents
    that agree on it. A swarm whose graph was cut by a lost agent forms as well.
    """
    return ALIGN_RATE * ((total + own) * (1.0 / (count + 1)) - own)
