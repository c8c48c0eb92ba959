"""One more ground station on a swarm that flies: found by its run folder, or by its mission and the
agents' mesh endpoints."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from swarm_ctl.core.model.fleet import Fleet
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.flying_runs import ended
from swarm_ctl.engine.protection import NO_KEYS, Keys, explained, station_identity
from swarm_ctl.engine.station.mesh_clock import MeshClock
from swarm_ctl.engine.station.screens import Show, possible
from swarm_ctl.engine.station.session import StationSession
from swarm_ctl.engine.station.station_loop import GuestControl
from swarm_ctl.engine.station.swarm_mesh import SwarmMesh
from swarm_ctl.engine.vehicle_memory import SwarmMemory, VehicleMemory, state_folder
from swarm_ctl.errors import InputError
from swarm_ctl.mission.fleet.exposure import leaves_loopback, refuse_exposed
from swarm_ctl.runfolder.last_statuses import read_commands, read_events
from swarm_ctl.runfolder.manifest import read_manifest

_ENDPOINT: Final = re.compile(r"(tcp|udp|tls|quic|ws)/[^/\s]+:(\d{1,5})")
_QUIET_WALL_S: Final = 5.0
_ALARMS: Final = "alarms from now on"


def join_run(folder: Path, show: Show, attach: Sequence[str], keys: Keys = NO_KEYS) -> None:
    """Watch and command a run of this machine; ends with the screen. `keys`: those of the command
    line; without, those and the zenoh settings with which it is flown."""
    manifest = read_manifest(folder)
    identity = station_identity(manifest.trust, keys.identity or manifest.flown_by)
    mesh = SwarmMesh.of_run(manifest, identity, keys.zenoh or None)
    with StationSession(mesh, attach) as session:
        notes: list[str] = []
        session.station.recall(read_events(folder, notes))
        session.station.recall(read_commands(folder, notes))
        words = "; ".join(["the log begins with the run's events and commands", _ALARMS, *notes])
        stays = possible(show) is Show.DASHBOARD
        session.record_nothing(manifest.started_at.timestamp())
        session.show(show, GuestControl(_Once(words), lambda: ended(folder, manifest), stays=stays))


@dataclass(frozen=True, slots=True, kw_only=True)
class SwarmElsewhere(SwarmMesh):
    """The mesh of a swarm on other hosts, whose time is told by what its agents say."""

    clock: MeshClock


def elsewhere(
    plan: Plan,
    fleet: Fleet,
    source: Path,
    mesh: Sequence[str],
    speedup: float,
    keys: Keys = NO_KEYS,
) -> SwarmElsewhere:
    """The mesh of a swarm on other hosts.

    Args:
        plan: what the agents fly.
        fleet: with these vehicles.
        source: the file that has both.
        mesh: where agents listen, such as `tcp/10.0.0.5:7447`; empty: as the mission's fleet says.
        speedup: that of a simulated swarm.
        keys: those of the command line.
    """
    connect = _endpoints(fleet, source, mesh)
    identity = station_identity(fleet.trust, keys.identity)
    is_open = identity is None and any(map(leaves_loopback, connect))
    if is_open and not keys.open_mesh:
        refuse_exposed([f"the mesh is at {', '.join(connect)}"], keys.fleet_file)
    return SwarmElsewhere(
        swarm=plan.name,
        plan=plan,
        fleet=fleet,
        source=source,
        connect=connect,
        clock=MeshClock(speedup),
        identity=identity,
        is_open=is_open,
        zenoh=keys.zenoh,
    )


def open_elsewhere(mesh: SwarmElsewhere, attach: Sequence[str]) -> StationSession:
    """A station on the mesh of such a swarm; it remembers the vehicles' own parameters."""
    memory = SwarmMemory(VehicleMemory(state_folder()), mesh.plan.name, mesh.endpoints)
    return StationSession(mesh, attach, memory)


def join_swarm(mesh: SwarmElsewhere, show: Show, attach: Sequence[str]) -> None:
    """Watch and command a swarm that flies on any host; ends with the screen."""
    with open_elsewhere(mesh, attach) as session:
        session.record_nothing(wall.unix_s())
        session.show(show, GuestControl(Hint(mesh)))


class _Once:
    """What to tell the operator of a station at its start."""

    def __init__(self, words: str) -> None:
        self._words = words

    def __call__(self) -> str:
        words, self._words = self._words, ""
        return words


class Hint:
    """What to tell the operator of a station that joins a swarm elsewhere: from when on it has a
    log, that nothing is recorded unless it `records`, and now and then, while it hears no agent,
    the endpoints."""

    def __init__(self, mesh: SwarmElsewhere, *, records: bool = False) -> None:
        self._mesh = mesh
        lost = "; nothing is recorded (--runs FOLDER records, and makes a run that `send` finds)"
        lost = "" if records else lost
        self._log = _Once(f"log from now on: what was said before was not heard here{lost}")
        self._due = wall.wall_s() + _QUIET_WALL_S

    def __call__(self) -> str:
        mesh, where = self._mesh, ", ".join(self._mesh.connect)
        if mesh.clock.heard:
            return self._log()
        if wall.wall_s() < self._due:
            return ""
        self._due = wall.wall_s() + 4 * _QUIET_WALL_S
        keys = "" if mesh.identity else ", and has it no keys"
        asked = f"does the swarm fly, is this where it listens{keys}?"
        why = explained(mesh.identity, mesh.connect)
        return f"no agent is heard at {where}; {f'{why}.' if why else asked} Trying on"


def _endpoints(fleet: Fleet, source: Path, given: Sequence[str]) -> list[str]:
    """Where the agents listen on the mesh: as given, or as the fleet says."""
    for endpoint in given:
        match = _ENDPOINT.fullmatch(endpoint)
        if match is None or not 0 < int(match[2]) <= 65535:
            raise InputError(
                f"--mesh {endpoint}: no endpoint of the mesh; allowed: tcp/HOST:PORT, as in"
                " tcp/10.0.0.5:7447"
            )
    named = (at for agent in fleet.agents if (at := agent.router or agent.mesh))
    found = list(given) or list(dict.fromkeys(named))
    if not found:
        raise InputError(
            f"{source}: its fleet does not say where agents listen (`mesh`);"
            " name each agent's endpoint with --mesh tcp/HOST:PORT, or a fleet file with --fleet"
        )
    return found
