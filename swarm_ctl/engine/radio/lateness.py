"""Notices positions that have waited on their way down.

A radio that is asked for more than it carries stores frames and delivers them late. An agent takes
a position for as old as it is since it came, so one that waited must not reach it: then the agent
hears none, and does as always.
"""

from __future__ import annotations

import math
from typing import Final

from swarm_ctl.mavlink.addressed import boot_ms
from swarm_ctl.mavlink.framer import MavlinkFrame

LATE_S: Final = 0.3
"""Later than the fastest position: with the next one's 0.2 s that is `OWN_FIX_S`."""
_DRIFT: Final = 2e-4
"""Clocks of vehicles differ by at most so much a second."""
_BOOTED_S: Final = 1.0
"""A clock that goes back by more has begun anew; frames that overtake each other differ by less."""


class Lateness:
    """Of the positions of one vehicle, by the vehicle's clock."""

    def __init__(self) -> None:
        self.late_s = 0.0
        """How much later than the fastest one the newest position came [s]."""
        self._boot_s = -math.inf
        self._least_s = math.inf
        self._now = 0.0

    def late(self, frame: MavlinkFrame, now: float) -> bool:
        """Whether the frame is a position that came too late. The vehicle's clock begins anew when
        it boots."""
        at_ms = boot_ms(frame)
        if at_ms is None:
            return False
        boot_s = at_ms * 1e-3
        if boot_s < self._boot_s - _BOOTED_S:
            self._least_s = math.inf
        self._boot_s = boot_s
        drifted = self._least_s + (now - self._now) * _DRIFT
        self._least_s, self._now = min(drifted, now - boot_s), now
        self.late_s = now - boot_s - self._least_s
        return self.late_s > LATE_S
