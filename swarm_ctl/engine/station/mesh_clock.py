"""The mission clock of a station that has no run folder: told from the agents' messages."""

from __future__ import annotations

from typing import Final

from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.lockstep.member import SteppedClock
from swarm_ctl.runfolder.manifest import Manifest

_OFF_AT_MOST_WALL_S: Final = 1.0
"""A message that is further from the clock than this does not move it: no link is so late, and an
agent that has started again counts anew."""
_LEAK: Final = 0.001
"""The part of its lateness by which a message slows the clock: without it, a station's clock that
is a little faster than the agents' would run away from them."""


class MeshClock:
    """The mission clock [s] of the agent that was heard first, as if the fastest message of its
    last minutes had taken no time. It never leaps: what is recorded stands on one clock, however
    far apart those of the agents are. `lockstep`: mission time has no pace, so it is that of the
    newest message."""

    def __init__(self, speedup: float = 1.0, *, lockstep: bool = False) -> None:
        self._own = SteppedClock(speedup) if lockstep else Clock.starting_now(speedup)
        self.stepped = lockstep
        self.speedup = speedup
        self._ahead_s = 0.0
        self._agent: int | None = None

    @property
    def heard(self) -> bool:
        """Whether any agent has set it."""
        return self._agent is not None

    def now(self) -> float:
        """Mission time [s]; before the first message, the time since the start."""
        return self._own.now() + self._ahead_s

    @classmethod
    def of_run(cls, manifest: Manifest) -> Clock | MeshClock:
        """The clock of a process that joins a run of this machine."""
        if manifest.lockstep is not None:
            return cls(manifest.speedup, lockstep=True)
        return Clock(manifest.epoch_s, manifest.speedup)

    def hear(self, agent: int, time_s: float) -> None:
        """Take the time of a message that an agent sent a moment ago."""
        ahead = time_s - self.now()
        if self._agent is None:
            self._agent = agent
            self._ahead_s += ahead
        elif self.stepped:
            self._ahead_s += max(ahead, 0.0)
        elif agent == self._agent and abs(ahead) < _OFF_AT_MOST_WALL_S * self.speedup:
            self._ahead_s += ahead if ahead > 0.0 else _LEAK * ahead
