"""What `run` tells the process that starts autopilots, and what that tells back; both as JSON."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.engine.vehicles.containers import Image

ORDERS: Final = "orders.json"
STARTED: Final = "vehicles.json"
"""In the folder of the vehicles: what was asked for, and what runs where."""


@dataclass(frozen=True, slots=True)
class VehicleOrder:
    """One autopilot to start."""

    agent: int
    sysid: int
    kind: VehicleKind
    binary: Path | Image
    """As `binaries.find` has found it."""
    place: Geodetic
    """Where it stands."""
    logs: bool = False
    """A PX4 writes its own log."""


@dataclass(frozen=True, slots=True)
class Orders:
    """All autopilots of a run, and the speed at which they fly."""

    speedup: float
    vehicles: tuple[VehicleOrder, ...]


@dataclass(frozen=True, slots=True)
class Started:
    """One autopilot that runs."""

    agent: int
    sysid: int
    kind: VehicleKind
    instance: int
    pid: int
    endpoint: str
    """Its agent's."""
    ground_station: str
    """Where a ground station reaches it, as pymavlink writes it."""


ORDERS_JSON: Final = TypeAdapter(Orders)
STARTED_JSON: Final = TypeAdapter(tuple[Started, ...])
