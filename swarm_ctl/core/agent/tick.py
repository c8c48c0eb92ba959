"""What one tick of an agent has to go by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.model.messages import StationBeacon
from swarm_ctl.core.model.timeouts import OWN_FIX_S
from swarm_ctl.core.model.vehicle import VehicleView
from swarm_ctl.core.swarm.snapshot import PeerSnapshot

HeardStation: TypeAlias = tuple[StationBeacon, float]
"""The newest beacon, and when it came."""


@dataclass(frozen=True, slots=True)
class Tick:
    """One tick: what was heard up to `now` [s, own clock]."""

    now: float
    view: VehicleView
    newest_fix: OwnFix | None
    """However old; None: no position was ever heard."""
    peers: PeerSnapshot
    station: HeardStation | None = None

    @property
    def fix(self) -> OwnFix | None:
        """The own position, if it is fresh (`OWN_FIX_S`)."""
        fix = self.newest_fix
        return fix if fix is not None and fix.age_s <= OWN_FIX_S else None

    @property
    def station_s(self) -> float | None:
        """When a station was last heard; None: never."""
        return self.station[1] if self.station is not None else None
