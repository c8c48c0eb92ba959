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
"""Between two ticks (50 ms): for longer, the agent itself did not run. So much of it counts all the
same, so that on a machine that is slow for good silence is still found."""
_KEPT = 16


class Attention:
    """When the agent itself ran. One that was stopped (SIGSTOP, a computer that sleeps) heard
    nothing meanwhile, which is nobody's silence."""

    def __init__(self) -> None:
        self._last_s = math.nan
        self._asleep: deque[tuple[float, float]] = deque(maxlen=_KEPT)

    def run(self, now: float) -> float:
        """A tick at `now` [s]. Returns for how long [s] the agent was stopped before it."""
        begin, self._last_s = self._last_s + ASLEEP_S, now
        if not now > begin:
            return 0.0
        self._asleep.append((begin, now))
        return now - begin

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
    def station_silent_s(self) -> float:
        """For how long it has listened since a station's last word; -inf: it never heard any."""
        return self.attention.awake_s(self.station[1], self.now) if self.station else -math.inf

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
