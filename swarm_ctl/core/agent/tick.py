"""What one tick of an agent has to go by."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import field
from typing import TypeAlias

from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.model.messages import Phase, StationBeacon
from swarm_ctl.core.model.rows import row
from swarm_ctl.core.model.timeouts import OWN_FIX_S
from swarm_ctl.core.model.vehicle import VehicleView
from swarm_ctl.core.swarm.snapshot import PeerSnapshot

HeardStation: TypeAlias = tuple[StationBeacon, float]
"""The newest beacon, and when it came."""


ASLEEP_S = 0.5
"""Between two ticks (50 ms): for longer, the agent itself did not run."""
_KEPT = 16


class Attention:
    """When the agent itself ran. One that was stopped (SIGSTOP, a computer that sleeps) heard
    nothing meanwhile, which is no silence of its vehicle."""

    def __init__(self) -> None:
        self._last_s = math.nan
        self._asleep: deque[tuple[float, float]] = deque(maxlen=_KEPT)

    def run(self, now: float) -> None:
        """A tick at `now` [s]."""
        if now - self._last_s > ASLEEP_S:
            self._asleep.append((self._last_s, now))
        self._last_s = now

    def awake_s(self, since_s: float, now: float) -> float:
        """For how long [s] of the time from `since_s` to `now` the agent ran."""
        if not self._asleep:
            return now - since_s
        asleep = (max(0.0, end - max(begin, since_s)) for begin, end in self._asleep)
        return now - since_s - sum(asleep)


@row
class Tick:
    """One tick: what was heard up to `now` [s, own clock]."""

    now: float
    view: VehicleView
    newest_fix: OwnFix | None
    """However old; None: no position was ever heard."""
    peers: PeerSnapshot
    station: HeardStation | None = None
    attention: Attention = field(default_factory=Attention)
    before: Phase = Phase.CONNECT
    """What the agent did in the tick before."""

    @property
    def vehicle_silent_s(self) -> float:
        """For how long the agent has listened since the vehicle's last heartbeat."""
        return self.attention.awake_s(self.view.heartbeat_s, self.now)

    @property
    def position_silent_s(self) -> float:
        """For how long it has listened since the vehicle's last position."""
        fix = self.newest_fix
        since_s = self.now - fix.age_s if fix is not None else -math.inf
        return self.attention.awake_s(since_s, self.now)

    @property
    def fix(self) -> OwnFix | None:
        """The own position, if it is fresh (`OWN_FIX_S`)."""
        fix = self.newest_fix
        return fix if fix is not None and fix.age_s <= OWN_FIX_S else None

    @property
    def station_s(self) -> float | None:
        """When a station was last heard; None: never."""
        return self.station[1] if self.station is not None else None
