"""One more ground station on a swarm that flies: found by its run folder, or by its mission and the
agents' mesh endpoints."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Final

from swarm_ctl.core.model.fleet import Fleet
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.flying_runs import ended
from swarm_ctl.engine.protection import NO_KEYS, Keys, explained, station_identity
from swarm_ctl.engine.station.attachments import Attachments
from swarm_ctl.engine.station.ground_station import Station, open_node
from swarm_ctl.engine.station.mesh_clock import MeshClock
from swarm_ctl.engine.station.recorders import LiveRecorder
from swarm_ctl.engine.station.screens import Show, possible, present
from swarm_ctl.engine.station.station_loop import GuestControl, loop
from swarm_ctl.engine.vehicle_memory import SwarmMemory, VehicleMemory, state_folder
from swarm_ctl.errors import InputError
from swarm_ctl.mesh.zenoh_config import part_in
from swarm_ctl.mission.compile.offers import pack
from swarm_ctl.mission.fleet.exposure import leaves_loopback, refuse_exposed
from swarm_ctl.runfolder.last_statuses import read_commands, read_events
from swarm_ctl.runfolder.manifest import read_manifest
from swarm_ctl.station.picture.protection import protection
from swarm_ctl.trust.identity import Identity

_ENDPOINT: Final = re.compile(r"(tcp|udp|tls|quic|ws)/[^/\s]+:(\d{1,5})")
_QUIET_WALL_S: Final = 5.0
_ALARMS: Final = "alarms from now on"


def join_run(folder: Path, show: Show, attach: Sequence[str], keys: Keys = NO_KEYS) -> None:
    """Watch and command a run of this machine; ends with the screen. `keys`: those of the command
    line; without, those and the zenoh settings with which it is flown."""
    manifest = read_manifest(folder)
    clock = MeshClock.of_run(manifest)
    identity = station_identity(manifest.trust, keys.identity or manifest.flown_by)
    seen = protection(identity, manifest.signing, is_open=manifest.open_mesh)
    part = part_in(manifest.plan, manifest.routers)
    plan = pack(manifest.plan, manifest.fleet, manifest.signing)
    own = keys.zenoh or manifest.zenoh
    mesh = open_node(
        manifest.swarm, manifest.whole_mesh, clock, identity=identity, part=part, plan=plan, own=own
    )
    with closing(mesh) as node:
        station = Station(manifest.plan, node, clock, protection=seen)
        notes: list[str] = []
        station.recall(read_events(folder, notes))
        station.recall(read_commands(folder, notes))
        words = "; ".join(["the log begins with the run's events and commands", _ALARMS, *notes])
        start_s = manifest.started_at.timestamp()
        stays = possible(show) is Show.DASHBOARD
        control = GuestControl(_Once(words), lambda: ended(folder, manifest), stays=stays)
        _watch(station, control, show, attach, start_s)


class SwarmMesh:
    """A swarm on other hosts: its plan, where it is on the mesh, and how this station joins it.

    Args:
        plan: what the agents fly.
        fleet: with these vehicles.
        source: the file that has both.
        mesh: where agents listen, such as `tcp/10.0.0.5:7447`; empty: as the mission's fleet says.
        speedup: that of a simulated swarm.
        keys: those of the command line.
    """

    def __init__(
        self,
        plan: Plan,
        fleet: Fleet,
        source: Path,
        mesh: Sequence[str],
        speedup: float,
        keys: Keys = NO_KEYS,
    ) -> None:
        self.plan, self.fleet, self.source, self.zenoh = plan, fleet, source, keys.zenoh
        self.connect, self.clock = _endpoints(fleet, source, mesh), MeshClock(speedup)
        self.identity = station_identity(fleet.trust, keys.identity)
        is_open = self.identity is None and any(map(leaves_loopback, self.connect))
        if is_open and not keys.open_mesh:
            refuse_exposed([f"the mesh is at {', '.join(self.connect)}"], keys.fleet_file)
        self.protection = protection(self.identity, fleet.signing, is_open=is_open)
        self.hint = _Hint(self.clock, self.connect, self.identity)


@contextmanager
def open_swarm(swarm: SwarmMesh) -> Iterator[Station]:
    """A station on the swarm's mesh."""
    plan, fleet, identity = swarm.plan, swarm.fleet, swarm.identity
    part = part_in(plan, fleet.routers)
    offer = pack(plan, fleet.agents, fleet.signing)
    ways = plan.name, swarm.connect, swarm.clock
    mesh = open_node(*ways, identity=identity, part=part, plan=offer, own=swarm.zenoh)
    with closing(mesh) as node:
        endpoints = {agent.id: agent.endpoint for agent in fleet.agents}
        memory = SwarmMemory(VehicleMemory(state_folder()), plan.name, endpoints)
        yield Station(plan, node, swarm.clock, memory=memory, protection=swarm.protection)


def join_swarm(swarm: SwarmMesh, show: Show, attach: Sequence[str]) -> None:
    """Watch and command a swarm that flies on any host; ends with the screen."""
    with open_swarm(swarm) as station:
        _watch(station, GuestControl(swarm.hint), show, attach, wall.unix_s())


def _watch(
    station: Station, control: GuestControl, show: Show, attach: Sequence[str], start_s: float
) -> None:
    """`start_s`: about the Unix time of mission time 0, for extensions."""
    plan = station.plan
    with ExitStack() as opened:
        attached = opened.enter_context(Attachments(attach, station))
        if attached.sinks:
            recorder = LiveRecorder(attached.sinks, plan, round(start_s * 1e9), station.name)
            station.record(opened.enter_context(closing(recorder)))
        present(show, plan, None, lambda screen: loop(station, screen, control, attached))


class _Once:
    """What to tell the operator of a station at its start."""

    def __init__(self, words: str) -> None:
        self._words = words

    def __call__(self) -> str:
        words, self._words = self._words, ""
        return words


class _Hint:
    """What to tell the operator of a station that has no run folder: from when on it has a log, and
    now and then, while it hears no agent, the endpoints."""

    def __init__(self, clock: MeshClock, connect: Sequence[str], identity: Identity | None) -> None:
        self._clock, self._identity, self._connect = clock, identity, connect
        self._where = ", ".join(connect)
        self._log = _Once(
            "log from now on: what was said before was not heard here; nothing is recorded (--runs"
            " FOLDER records, and makes a run that `send` finds)"
        )
        self._due = wall.wall_s() + _QUIET_WALL_S

    def __call__(self) -> str:
        if self._clock.heard:
            return self._log()
        if wall.wall_s() < self._due:
            return ""
        self._due = wall.wall_s() + 4 * _QUIET_WALL_S
        keys = "" if self._identity else ", and has it no keys"
        asked = f"does the swarm fly, is this where it listens{keys}?"
        why = explained(self._identity, self._connect)
        return f"no agent is heard at {self._where}; {f'{why}.' if why else asked} Trying on"


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
