"""Shaping a wish, a horizontal velocity north + 1j * east, before the constraints judge it.

Law and filter may both be satisfied, and nothing moves. Two ways out of such a dead-lock change the
wish only, so the filter still has the last word:
- *swirl*: avoidance that points against consensus is turned a little, by all agents to the same
  side, so that two agents that meet head-on go round each other;
- *tangential release*: an agent that has wanted to move for a while and has not moved goes
  sideways for some seconds, each time for a little longer, sometimes to the other side.
"""

from __future__ import annotations

import cmath
import math
from typing import Final, NamedTuple

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


_SWIRL: Final = 0.5
SWIRL_OFF: Final = 0.3
"""[units]: within r_out plus this of an agent that is not heard there is no swirl, as that agent
does not turn with it."""
_AVERAGE_S: Final = 1.5
_WANTS: Final = 0.05
"""[of the top speed]: an agent that wants more than this on average ..."""
_GETS: Final = 0.15
"""... and gets less of it than this share is dead-locked."""
_SIDEWAYS: Final = cmath.exp(-1j * math.pi / 3)
_LONGER_S: Final = 5.0
"""Later releases last at most so much longer than the first."""
_OTHER_SIDE_FROM: Final = 3
_OTHER_SIDE: Final = 0.4
"""From so many releases on, this share of them goes to the other side."""


class Release(NamedTuple):
    """What one agent remembers of how it gets on."""

    wanted: float
    """On average [length/s], as the next."""
    got: float
    left_s: float
    """It goes sideways for so long."""
    side: complex
    fails: int
    """Releases so far."""


NO_RELEASE: Final = Release(0.0, 0.0, 0.0, _SIDEWAYS, 0)


def swirled(consensus: complex, avoidance: complex) -> complex:
    """The avoidance, turned up to 27 degrees to its left where it points against the consensus."""
    sizes = abs(consensus) * abs(avoidance)
    against = max(0.0, -(avoidance * consensus.conjugate()).real / max(sizes, 1e-300))
    return avoidance * complex(1.0, -_SWIRL * against * against)


def turned(
    release: Release, wish: complex, consensus: complex, agent: int, speed: float, tick_s: float
) -> tuple[complex, Release]:
    """The wish, or the way out for an agent that is dead-locked.

    Args:
        release: what it remembers.
        wish: what it would fly.
        consensus: where it wants to.
        agent: its id; its dice depend on it, so that two that block each other do not move alike.
        speed: the limit, in the unit of all velocities here.
        tick_s: between two calls.
    """
    wanted, got, left_s, side, fails = release
    if left_s <= 0.0 and wanted > _WANTS * speed and got < _GETS * wanted:
        first, second = _dice(agent, fails)
        left_s = (_AVERAGE_S + min(float(fails), _LONGER_S)) * (0.7 + 0.6 * first)
        side = _SIDEWAYS
        if fails >= _OTHER_SIDE_FROM and second < _OTHER_SIDE:
            side = _SIDEWAYS.conjugate()
        fails += 1
        wanted = got = 0.0
    if left_s > 0.0:
        left_s -= tick_s
        pull = abs(consensus)
        if pull > 0.0:
            size = max(0.2 * speed, min(pull, 0.5 * speed))
            wish = consensus / max(pull, 1e-300) * size * side
    return wish, Release(wanted, got, left_s, side, fails)


def noted(
    release: Release, consensus: complex, flown: complex, speed: float, tick_s: float
) -> Release:
    """With what was commanded in the end."""
    wanted, got, left_s, side, fails = release
    pull = abs(consensus)
    if left_s <= 0.0 and pull > 0.0:
        share = tick_s / _AVERAGE_S
        along = (flown * consensus.conjugate()).real / max(pull, 1e-300)
        wanted += share * (min(pull, speed) - wanted)
        got += share * (along - got)
    return Release(wanted, got, left_s, side, fails)


def _dice(agent: int, fails: int) -> tuple[float, float]:
    """Two numbers in 0..1, the same for the same agent and number of fails."""
    seed = agent * 104729 + fails * 1299709
    first, second = (seed * 2654435761) % 2**32, ((seed + 12345) * 2246822519) % 2**32
    return first / 2**32, second / 2**32
