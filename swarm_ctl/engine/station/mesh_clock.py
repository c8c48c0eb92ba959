"""The mission clock of a station that has no run folder: told from the agents' messages."""

from __future__ import annotations

from typing import Final

from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.lockstep.member import SteppedClock
from swarm_ctl.runfolder.manifest import Manifest

_LATE_AT_MOST_S: Final = 1.0
"""A message that is later than this does not move the clock."""
_LEAK: Final = 0.001
"""The part of its lateness by which a message slows the clock: without it, a station's clock that
is a little faster than the agents' would run away from them."""


class MeshClock:
    """The swarm's mission clock [s], as if the fastest message of the last minutes had taken no
    time. `lockstep`: mission time has no pace, so it is that of the newest message."""

    def __init__(self, speedup: float = 1.0, *, lockstep: bool = False) -> None:
        self._own = SteppedClock(speedup) if lockstep else Clock.starting_now(speedup)
        self.stepped = lockstep
        self.speedup = speedup
        self._ahead_s = 0.0
        self.heard = False

    def now(self) -> float:
        """Mission time [s]; before the first message, the time since the start."""
        return self._own.now() + self._ahead_s

    @property
    def steady_s(self) -> float:
        """Since this clock's start [s], whatever agents tell: mission time leaps where one is heard
        whose clock is ahead of all."""
        return self._own.now()

    @classmethod
    def of_run(cls, manifest: Manifest) -> Clock | MeshClock:
        """The clock of a process that joins a run of this machine."""
        if manifest.lockstep is not None:
            return cls(manifest.speedup, lockstep=True)
        return Clock(manifest.epoch_s, manifest.speedup)

    def hear(self, time_s: float) -> None:
        """Take the time of a message that an agent sent a moment ago."""
        ahead = time_s - self.now()
        if not self.heard or ahead > 0:
            self._ahead_s += ahead
        elif ahead > -_LATE_AT_MOST_S and not self.stepped:
            self._ahead_s += _LEAK * ahead
        self.heard = True
