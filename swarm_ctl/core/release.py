"""Out of a dead-lock without giving up the distance: where law and filter are both satisfied and nothing moves.

Two means, both on the wish, so that the filter has the last word as always:
- *swirl*: where avoidance points against consensus, it is turned a little, everywhere to the same side: two that meet
  head-on go round each other;
- *tangential release*: an agent that has wanted to go somewhere for a while and got nowhere goes sideways for some
  seconds, each time for a little longer, sometimes to the other side.

For one agent or arrays of them; a horizontal vector is the complex number north + 1j * east.
"""

from __future__ import annotations

import cmath
import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]

_SWIRL: Final = 0.5
_AVERAGE_S: Final = 1.5
_WANTS: Final = 0.05
"""[of the top speed]: who wants to go faster than this on average ..."""
_GETS: Final = 0.15
"""... and gets less of it than this share, is stuck."""
_SIDEWAYS: Final = cmath.exp(-1j * math.pi / 3)
_LONGER_S: Final = 5.0
_OTHER_SIDE: Final = (3, 0.4)
"""From so many releases on, this share of them goes to the other side."""


def swirled(consensus: Any, avoidance: Any) -> Any:
    """The avoidance, turned up to 27 degrees to the left of it where it points against the consensus (arrays)."""
    sizes = np.abs(consensus) * np.abs(avoidance)
    against = np.maximum(0.0, -(avoidance * np.conjugate(consensus)).real / np.maximum(sizes, 1e-300))
    return avoidance * (1.0 - 1j * _SWIRL * against * against)


class Release:
    """Notices who is stuck, and turns their wish.

    Args:
        shape: of the arrays of agents, () for one.
        speed: the limit, in the unit of all velocities here.
        dice: (fails) -> two numbers in 0..1 for each agent; the same for the same agent and number of fails.
    """

    def __init__(self, shape: tuple[int, ...], speed: float, tick_s: float) -> None:
        self._speed, self._tick_s = speed, tick_s
        self._wanted, self._got = np.zeros(shape), np.zeros(shape)
        self._left_s, self._side = np.zeros(shape), np.ones(shape, dtype=np.complex128)
        self.fails = np.zeros(shape)
        """Releases so far."""

    def only(self, chosen: Any) -> None:
        """Go on with some of the last axis."""
        for name in ("_wanted", "_got", "_left_s", "_side", "fails"):
            setattr(self, name, getattr(self, name)[..., chosen])

    def turn(self, wish: Any, consensus: Any, dice: Any) -> Any:
        """The wish, or the way out for those that are stuck. `dice`: (2, ...) in 0..1, looked at when one begins."""
        pull = np.abs(consensus)
        want = np.minimum(pull, self._speed)
        stuck = (
            (self._left_s <= 0.0) & (self._wanted > _WANTS * self._speed) & (self._got < _GETS * self._wanted)
        )
        if stuck.any():
            lasts = (_AVERAGE_S + np.minimum(self.fails, _LONGER_S)) * (0.7 + 0.6 * dice[0])
            other = (self.fails >= _OTHER_SIDE[0]) & (dice[1] < _OTHER_SIDE[1])
            self._left_s = np.where(stuck, lasts, self._left_s)
            self._side = np.where(stuck, np.where(other, _SIDEWAYS.conjugate(), _SIDEWAYS), self._side)
            self.fails = self.fails + stuck
            self._wanted = np.where(stuck, 0.0, self._wanted)
            self._got = np.where(stuck, 0.0, self._got)
        releasing = self._left_s > 0.0
        self._left_s = self._left_s - self._tick_s * releasing
        size = np.maximum(0.2 * self._speed, np.minimum(want, 0.5 * self._speed))
        away = consensus / np.maximum(pull, 1e-300) * size * self._side
        return np.where(releasing & (pull > 0.0), away, wish)

    def note(self, consensus: Any, flown: Any) -> None:
        """What was commanded in the end."""
        pull = np.abs(consensus)
        share = self._tick_s / _AVERAGE_S
        idle = self._left_s <= 0.0
        along = (flown * np.conjugate(consensus)).real / np.maximum(pull, 1e-300)
        self._wanted = self._wanted + share * idle * (np.minimum(pull, self._speed) - self._wanted)
        self._got = self._got + share * idle * (along - self._got)
