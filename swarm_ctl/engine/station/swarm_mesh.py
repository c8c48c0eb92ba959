"""A swarm's mesh, and how a process that is no agent joins it."""

from __future__ import annotations

import os
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swarm_ctl.core.model.fleet import Fleet
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.lockstep.seat import Seat
from swarm_ctl.engine.protection import access
from swarm_ctl.engine.station.mesh_clock import MeshClock
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.access import station_name
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.zenoh_config import part_in
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.mission.compile.offers import pack
from swarm_ctl.runfolder.manifest import Manifest
from swarm_ctl.trust.identity import Identity

STATION = "station"


@dataclass(frozen=True, slots=True, kw_only=True)
class SwarmMesh:
    """Who flies, where that swarm is on the mesh, and as whom this process joins it."""

    swarm: str
    """Its name on the mesh."""
    plan: Plan
    fleet: Fleet
    source: Path
    """The file that is flown."""
    connect: Sequence[str]
    """Where others listen, such as `tcp/10.0.0.5:7447`."""
    listen: Sequence[str] = ()
    clock: Clock | MeshClock
    identity: Identity | None = None
    """None: the mesh is open."""
    is_open: bool = False
    """Other computers reach it without keys: the mesh, or where that has keys the links."""
    zenoh: Mapping[str, Any] = field(default_factory=dict)
    """A user's own settings."""
    seat: Seat | None = None
    """This process's, in lockstep; it plays one role alone."""

    @classmethod
    def of_run(
        cls,
        manifest: Manifest,
        identity: Identity | None,
        zenoh: Mapping[str, Any] | None = None,
        seat: Seat | None = None,
    ) -> SwarmMesh:
        """Of a run of this machine; `zenoh`: None for those with which it is flown."""
        return cls(
            swarm=manifest.swarm,
            plan=manifest.plan,
            fleet=Fleet(manifest.fleet, manifest.trust, manifest.signing),
            source=Path(manifest.mission),
            connect=manifest.whole_mesh,
            clock=seat.clock if seat else MeshClock.of_run(manifest),
            identity=identity,
            is_open=manifest.open_mesh,
            zenoh=manifest.zenoh if zenoh is None else zenoh,
            seat=seat,
        )

    @property
    def endpoints(self) -> dict[int, str | None]:
        """Of the vehicles, by agent."""
        return {agent.id: agent.endpoint for agent in self.fleet.agents}

    def open_node(self, role: str = STATION) -> Node:
        """Join it under a name that no other process has, on any host. A station offers the plan
        to agents that fetch it."""
        seat, identity = self.seat, self.identity
        again = seat is not None and seat.repeats
        suffix = "lockstep" if again else f"{os.getpid()}-{uuid.uuid4().hex[:6]}"
        name = f"{role}-{suffix}" if identity is None else station_name(identity.name, suffix)
        transport = ZenohTransport(
            self.listen,
            self.connect,
            self.clock.now,
            seat.mesh_speedup if seat else self.clock.speedup,
            patient=again,
            access=access(identity, self.swarm),
            part=part_in(self.plan, self.fleet.routers),
            own=self.zenoh,
            alive=keys.alive_key(self.swarm, "station", name) if role == STATION else "",
        )
        if role == STATION:
            offer = pack(self.plan, self.fleet.agents, self.fleet.signing)
            transport.serve(keys.plan_key(self.swarm, name), offer)
        return Node(seat.mesh(transport) if seat else transport, self.swarm, name)
