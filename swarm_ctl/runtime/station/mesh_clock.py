"""A station that knows the mission and where to find the swarm, and has no run folder: on another
host, say."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.runtime.clock import Clock

_ENDPOINT: Final = re.compile(r"(tcp|udp|tls|quic|ws)/[^/\s]+:(\d{1,5})")
_LATE_AT_MOST_S: Final = 1.0
"""News that is older than this says nothing about the clock."""
_LEAK: Final = 0.001
"""Share of being ahead that is given up at each message: a clock a little faster than the agents'
comes back."""


class HeardClock:
    """The swarm's mission clock by what agents say: as if the fastest message of the last minutes
    took no time."""

    def __init__(self, speedup: float = 1.0) -> None:
        self._own = Clock.starting_now(speedup)
        self.speedup = speedup
        self._ahead_s = 0.0
        self.heard = False

    def now(self) -> float:
        """Mission time [s]; before anything was heard, the time since the start."""
        return self._own.now() + self._ahead_s

    def hear(self, time_s: float) -> None:
        """It was `time_s` on an agent's clock a moment ago."""
        ahead = time_s - self.now()
        if not self.heard or ahead > 0:
            self._ahead_s += ahead
        elif ahead > -_LATE_AT_MOST_S:
            self._ahead_s += _LEAK * ahead
        self.heard = True


def endpoints(mission: LoadedMission, given: Sequence[str]) -> list[str]:
    """Where the agents listen on the mesh: as given, or as the fleet says; InputError where neither
    does."""
    for endpoint in given:
        match = _ENDPOINT.fullmatch(endpoint)
        if match is None or not 0 < int(match[2]) <= 65535:
            raise InputError(
                f"--mesh {endpoint}: no endpoint of the mesh; allowed: tcp/HOST:PORT, as in tcp/10.0.0.5:7447"
            )
    found = list(given) or [agent.mesh for agent in mission.fleet.agents if agent.mesh]
    if not found:
        raise InputError(
            f"{mission.source}: its fleet does not say where agents listen (`mesh`);"
            " name each agent's endpoint with --mesh tcp/HOST:PORT, or a fleet file with --fleet"
        )
    return found
