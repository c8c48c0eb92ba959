"""Ways out of a dead-lock: law and filter are both satisfied, and nothing moves.

Both change the wish only, so the filter still has the last word:
- *swirl*: avoidance that points against consensus is turned a little, by all agents to the same
  side, so that two agents that meet head-on go round each other;
- *tangential release*: an agent that has wanted to move for a while and has not moved goes
  sideways for some seconds, each time for a little longer, sometimes to the other side.

A horizontal vector is the complex number north + 1j * east.
"""

from __future__ import annotations

import cmath
import math
from typing import Any, Final

import numpy as np

from swarm_ctl.core.model.arrays import ONE, Arithmetic, Bools, keep_missions

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
_OTHER_SIDE: Final = (3, 0.4)
"""From so many releases on, this share of them goes to the other side."""


def swirled(consensus: Any, avoidance: Any) -> Any:
    """The avoidance, turned up to 27 degrees to its left where it points against the consensus
    (arrays)."""
    sizes = np.abs(consensus) * np.abs(avoidance)
    against = np.maximum(
        0.0, -(avoidance * np.conjugate(consensus)).real / np.maximum(sizes, 1e-300)
    )
    return avoidance * (1.0 - 1j * _SWIRL * against * against)


class DeadlockRelease:
    """Notices that an agent is dead-locked, and turns its wish.

    For one agent, or for arrays (n, m) of agents: then `agent`, and all velocities, are arrays.

    Args:
        agent: its id; its dice depend on it, so that two that block each other do not move alike.
        speed: the limit, in the unit of all velocities here.
        tick_s: between two calls.
        arithmetic: `MANY` for arrays.
    """

    def __init__(
        self, agent: Any, speed: float, tick_s: float, arithmetic: Arithmetic = ONE
    ) -> None:
        self._agent, self._speed, self._tick_s, self._of = agent, speed, tick_s, arithmetic
        self._wanted = self._got = self._left_s = 0.0 * agent
        self._side = _SIDEWAYS + 0.0 * agent
        self.fails = 0 * agent
        """Releases so far."""

    def only(self, missions: Bools) -> None:
        """Go on with some of the missions."""
        names = ("_agent", "_wanted", "_got", "_left_s", "_side", "fails")
        keep_missions(self, missions, *names)

    @property
    def releasing(self) -> Any:
        """The agent goes sideways in this tick."""
        return self._left_s > 0.0

    def turn(self, wish: Any, consensus: Any) -> Any:
        """The wish, or the way out for an agent that is dead-locked."""
        where = self._of.where
        begins = (self._left_s <= 0.0) & (self._wanted > _WANTS * self._speed)
        begins = begins & (self._got < _GETS * self._wanted)
        if self._of.some(begins):
            lasts_s, side = self._terms()
            self._left_s = where(begins, lasts_s, self._left_s)
            self._side = where(begins, side, self._side)
            self.fails = self.fails + begins
            self._wanted = where(begins, 0.0, self._wanted)
            self._got = where(begins, 0.0, self._got)
        going, pull = self.releasing, abs(consensus)
        if not self._of.some(going):
            return wish
        self._left_s = self._left_s - self._tick_s * going
        size = self._of.most(0.2 * self._speed, self._of.least(pull, 0.5 * self._speed))
        away = consensus / self._of.most(pull, 1e-300) * size * self._side
        return where(going & (pull > 0.0), away, wish)

    def note(self, consensus: Any, flown: Any) -> None:
        """Take in what was commanded in the end."""
        pull = abs(consensus)
        share = self._tick_s / _AVERAGE_S * ((self._left_s <= 0.0) & (pull > 0.0))
        along = (flown * consensus.conjugate()).real / self._of.most(pull, 1e-300)
        self._wanted = self._wanted + share * (self._of.least(pull, self._speed) - self._wanted)
        self._got = self._got + share * (along - self._got)

    def _terms(self) -> tuple[Any, Any]:
        """How long [s] and where to the next release goes."""
        first, second = _dice(self._agent, self.fails)
        lasts_s = (_AVERAGE_S + self._of.least(self.fails, _LONGER_S)) * (0.7 + 0.6 * first)
        other = (self.fails >= _OTHER_SIDE[0]) & (second < _OTHER_SIDE[1])
        return lasts_s, self._of.where(other, _SIDEWAYS.conjugate(), _SIDEWAYS)


def _dice(agent: Any, fails: Any) -> tuple[Any, Any]:
    """Two numbers in 0..1, the same for the same agent and number of fails."""
    seed = agent * 104729 + fails * 1299709
    first, second = (seed * 2654435761) % 2**32, ((seed + 12345) * 2246822519) % 2**32
    return first / 2**32, second / 2**32
