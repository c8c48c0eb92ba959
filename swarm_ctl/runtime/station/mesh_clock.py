"""The mission clock of a station that has no run folder: told from the agents' messages."""

from __future__ import annotations

from typing import Final

from swarm_ctl.runtime.clock import Clock

_LATE_AT_MOST_S: Final = 1.0
"""A message that is later than this does not move the clock."""
_LEAK: Final = 0.001
"""The part of its lateness by which a message slows the clock: without it, a station's clock that
is a little faster than the agents' would run away from them."""


class MeshClock:
    """The swarm's mission clock [s], as if the fastest message of the last minutes had taken no
    time."""

    def __init__(self, speedup: float = 1.0) -> None:
        self._own = Clock.starting_now(speedup)
        self.speedup = speedup
        self._ahead_s = 0.0
        self.heard = False

    def now(self) -> float:
        """Mission time [s]; before the first message, the time since the start."""
        return self._own.now() + self._ahead_s

    def hear(self, time_s: float) -> None:
        """Take the time of a message that an agent sent a moment ago."""
        ahead = time_s - self.now()
        if not self.heard or ahead > 0:
            self._ahead_s += ahead
        elif ahead > -_LATE_AT_MOST_S:
            self._ahead_s += _LEAK * ahead
        self.heard = True
