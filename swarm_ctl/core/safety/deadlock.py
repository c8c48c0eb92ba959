"""Out of a dead-lock without giving up the distance: where law and filter are both satisfied and
nothing moves.

Two means, both on the wish, so that the filter has the last word as always:
- *swirl*: where avoidance points against consensus, it is turned a little, everywhere to the same
  side: two that meet head-on go round each other;
- *tangential release*: an agent that has wanted to go somewhere for a while and got nowhere goes
  sideways for some seconds, each time for a little longer, sometimes to the other side.

A horizontal vector is the complex number north + 1j * east. `study.batch.batch_safety_filter` has
the release for arrays of agents.
"""

from __future__ import annotations

import cmath
import math
from typing import Any, Final

import numpy as np

_SWIRL: Final = 0.5
SWIRL_OFF: Final = 0.3
"""[units]: within r_out plus this of somebody unheard nobody swirls, as that one does not turn with
it."""
AVERAGE_S: Final = 1.5
WANTS: Final = 0.05
"""[of the top speed]: who wants to go faster than this on average ..."""
GETS: Final = 0.15
"""... and gets less of it than this share, is stuck."""
SIDEWAYS: Final = cmath.exp(-1j * math.pi / 3)
LONGER_S: Final = 5.0
OTHER_SIDE: Final = (3, 0.4)
"""From so many releases on, this share of them goes to the other side."""


def swirled(consensus: Any, avoidance: Any) -> Any:
    """The avoidance, turned up to 27 degrees to the left of it where it points against the
    consensus (arrays)."""
    sizes = np.abs(consensus) * np.abs(avoidance)
    against = np.maximum(
        0.0, -(avoidance * np.conjugate(consensus)).real / np.maximum(sizes, 1e-300)
    )
    return avoidance * (1.0 - 1j * _SWIRL * against * against)


class DeadlockRelease:
    """Notices that one agent is stuck, and turns its wish.

    Args:
        agent: what its dice are thrown with, so that two that block each other do not move alike.
        speed: the limit, in the unit of all velocities here.
        tick_s: between two calls.
    """

    def __init__(self, agent: int, speed: float, tick_s: float) -> None:
        self._agent, self._speed, self._tick_s = agent, speed, tick_s
        self._wanted = self._got = self._left_s = 0.0
        self._side = SIDEWAYS
        self.fails = 0
        """Releases so far."""

    @property
    def releasing(self) -> bool:
        """It goes sideways just now."""
        return self._left_s > 0.0

    def turn(self, wish: complex, consensus: complex) -> complex:
        """The wish, or the way out for one that is stuck."""
        pull = abs(consensus)
        if (
            self._left_s <= 0.0
            and self._wanted > WANTS * self._speed
            and self._got < GETS * self._wanted
        ):
            self._left_s, self._side = terms(self.fails, dice(self._agent, self.fails))
            self.fails += 1
            self._wanted = self._got = 0.0
        if self._left_s <= 0.0:
            return wish
        self._left_s -= self._tick_s
        size = max(0.2 * self._speed, min(pull, 0.5 * self._speed))
        return consensus / pull * size * self._side if pull > 0.0 else wish

    def note(self, consensus: complex, flown: complex) -> None:
        """What was commanded in the end."""
        pull = abs(consensus)
        if self._left_s > 0.0 or pull == 0.0:
            return
        share = self._tick_s / AVERAGE_S
        self._wanted += share * (min(pull, self._speed) - self._wanted)
        self._got += share * ((flown * consensus.conjugate()).real / pull - self._got)


def terms(fails: int, thrown: tuple[float, float]) -> tuple[float, complex]:
    """How long [s] and where to, after so many releases."""
    lasts = (AVERAGE_S + min(fails, LONGER_S)) * (0.7 + 0.6 * thrown[0])
    other = fails >= OTHER_SIDE[0] and thrown[1] < OTHER_SIDE[1]
    return lasts, SIDEWAYS.conjugate() if other else SIDEWAYS


def dice(agent: int, fails: int) -> tuple[float, float]:
    """Two numbers in 0..1, the same for the same agent and number of fails."""
    seed = agent * 104729 + fails * 1299709
    first, second = (seed * 2654435761) % 2**32, ((seed + 12345) * 2246822519) % 2**32
    return first / 2**32, second / 2**32
