"""What is decided before a run starts: its folder, its endpoints, and what each process is told."""

from __future__ import annotations

import json
import os
import shutil
import socket
import uuid
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from swarm_ctl import extension
from swarm_ctl.core.model.fleet import Fleet, FleetAgent, SigningPolicy, VehicleKind
from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.flying_runs import make_folder, process_space
from swarm_ctl.engine.launch.ground_control import ground_control
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.engine.launch.sim_config import simulator_config
from swarm_ctl.engine.launch_file import Launch, write_launch
from swarm_ctl.engine.lockstep.keeper import Rules
from swarm_ctl.engine.lockstep.seat import SIMULATOR, STATION
from swarm_ctl.engine.protection import (
    NO_KEYS,
    Keys,
    agent_identity_folder,
    operator_identity,
    refuse_useless,
    router_identity_folder,
)
from swarm_ctl.engine.script import RunScript
from swarm_ctl.engine.station.screens import Show
from swarm_ctl.engine.system import lacks_for_lockstep, refuse_without
from swarm_ctl.engine.vehicles.binaries import find
from swarm_ctl.engine.vehicles.homes import start_of
from swarm_ctl.engine.vehicles.order import ORDERS, ORDERS_JSON, Orders, Started, VehicleOrder
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.mesh.access import as_tls
from swarm_ctl.mesh.zenoh_config import MeshPart, part_in
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.mission.fleet.exposure import exposures, leaves_loopback, refuse_exposed
from swarm_ctl.runfolder.manifest import Manifest, package_versions, write_manifest
from swarm_ctl.trust.identity import MAVLINK_KEY
from swarm_ctl.trust.names import LOOPBACK, KeyHolder, member_of


@dataclass(frozen=True, slots=True)
class RunOptions:
    """How to run a mission."""

    speedup: float = 1.0
    show: Show = Show.DASHBOARD
    runs: Path = Path("runs")
    seed: int = 1
    record_hz: dict[str, float] = field(default_factory=dict)
    tlog: bool = True
    attach: tuple[str, ...] = ()
    """The extensions of its station, each `NAME[=ARGUMENT]`."""
    gcs: tuple[tuple[str, int], ...] = ()
    """Where ground control software listens: host and port."""
    binaries: Mapping[VehicleKind, str | None] = field(default_factory=dict)
    """Where the autopilots to start are, as the command line says."""
    px4_log: bool = False
    lockstep: Lockstep | None = None
    """None: in real time times `speedup`."""
    keys: Keys = NO_KEYS
    """Of the command line."""
    script: RunScript | None = None
    """What a scenario does to the processes; in lockstep alone."""
    lifeline: int | None = None
    """A pipe from the program that started this; its end lands the swarm."""


@dataclass(frozen=True, slots=True)
class Lockstep:
    """How mission time goes when it waits for all processes."""

    factor: float | None = None
    """Mission seconds per second of the wall clock at most; None: as fast as it goes."""
    patience_wall_s: float = 10.0
    """The clock does not wait longer for a process."""
    further: tuple[str, ...] = ()
    """Members that are not of the run, without which the clock does not start."""


class RunSetup:
    """One run, decided: `manifest` has every endpoint, but those of autopilots that are still to
    be started, and stands in `folder` already.

    StartError where an autopilot that the fleet wants is not on this machine.
    """

    def __init__(self, mission: LoadedMission, options: RunOptions) -> None:
        self.options = options
        kinds = {agent.id: agent.started_as for agent in mission.fleet.agents}
        self._simulated = {i for i, kind in kinds.items() if kind is VehicleKind.SIMULATED}
        self._lasting = {agent.id for agent in mission.fleet.agents if agent.endpoint is not None}
        """The agents whose vehicles were there before this run, and will be after it."""
        if options.lockstep is not None:
            _refuse_lockstep(mission.fleet.agents)
        identity = operator_identity(mission.fleet.trust, options.keys.identity)
        if identity is not None:
            refuse_useless(identity, mission.fleet.agents, _router_place(mission))
        exposed = exposures(mission.fleet) + _exposed_stations(mission.fleet, options.gcs)
        if not options.keys.open_mesh:
            refuse_exposed(exposed, options.keys.fleet_file, mission.fleet.trust)
        extension.check(options.attach)
        self._orders = _orders(mission, options)
        self.folder = make_folder(options.runs, mission.plan.name)
        self.manifest = _manifest(mission, options).model_copy(
            update={
                "identity": identity and str(identity.folder.absolute()),
                "open_mesh": bool(exposed),
                "zenoh": dict(options.keys.zenoh),
            }
        )
        self._simulation = mission.file.simulation
        self.ground_control = ground_control(self.manifest.fleet, self._simulated, options.gcs)
        try:
            write_manifest(self.folder, self.manifest)
        except OSError as error:
            self.ground_control.held.close()
            shutil.rmtree(self.folder, ignore_errors=True)
            raise StartError(
                f"{self.folder}: can't be written: {error.strerror}; choose with --runs"
            ) from None

    def write_orders(self) -> Path | None:
        """The folder of the autopilots to start, with the orders; None where there are none."""
        if not self._orders:
            return None
        folder = self.folder / "vehicles"
        folder.mkdir()
        orders = Orders(self.options.speedup, self._orders)
        (folder / ORDERS).write_bytes(ORDERS_JSON.dump_json(orders, indent=1))
        return folder

    def take_started(self, started: Sequence[Started]) -> None:
        """The endpoints of the autopilots, which are ready: the mission's clock begins now."""
        endpoints = {vehicle.agent: vehicle.endpoint for vehicle in started}
        fleet = tuple(
            replace(agent, endpoint=endpoints.get(agent.id, agent.endpoint))
            for agent in self.manifest.fleet
        )
        self.ground_control.take_started(
            {vehicle.agent: vehicle.ground_station for vehicle in started}
        )
        begun = {"started_at": wall.date_and_time(), "epoch_s": _epoch_s(self.options)}
        self.manifest = self.manifest.model_copy(update={"fleet": fleet} | begun)
        write_manifest(self.folder, self.manifest)

    def write_launch(self) -> None:
        """What the processes read beside the manifest; and the scenario."""
        options, lockstep = self.options, self.options.lockstep
        started = {order.agent for order in self._orders}
        launch = Launch(
            show=options.show,
            attach=options.attach,
            tlog=options.tlog,
            autopilots=tuple(started),
            remembered=tuple(self._lasting),
            relay=self.ground_control.relay(self.manifest.fleet),
            keeper=None if lockstep is None else self._rules(lockstep),
            script=options.script,
        )
        write_launch(self.folder, launch)
        if options.script is not None:
            (self.folder / "scenario.yaml").write_text(options.script.text, encoding="utf-8")

    def _rules(self, lockstep: Lockstep) -> Rules:
        agents = [f"agent-{agent.id}" for agent in self.manifest.fleet]
        return Rules(
            self.manifest.plan.tick_s,
            (SIMULATOR, *agents, STATION, *lockstep.further),
            lockstep.factor,
            lockstep.patience_wall_s,
        )

    @property
    def radios(self) -> tuple[str, ...]:
        """The endpoint of each radio that agents share."""
        return tuple(
            agents[0].reached_at or "" for agents in Fleet(self.manifest.fleet).radios().values()
        )

    def write_simulator_config(self) -> Path | None:
        """The simulator's configuration file; None where no vehicle is simulated."""
        if not self._simulated:
            return None
        manifest = self.manifest
        vehicles = [agent for agent in manifest.fleet if agent.id in self._simulated]
        config = simulator_config(manifest.plan, vehicles, self._simulation)
        for agent, vehicle in zip(vehicles, config["vehicles"], strict=True):
            vehicle["also"] = self.ground_control.further[agent.id]
            keys = agent_identity_folder(manifest.trust, agent.id)
            if keys is not None and manifest.signing is SigningPolicy.REQUIRED:
                vehicle["signing_key_path"] = str(keys / MAVLINK_KEY)
        config |= {
            "speedup": manifest.speedup,
            "epoch_s": manifest.epoch_s,
            "lockstep": manifest.lockstep,
            "seed": self.options.seed,
            "truth_path": str(self.folder / "truth.jsonl"),
        }
        path = self.folder / "sim.json"
        path.write_text(json.dumps(config, indent=1))
        return path

    def table(self) -> Iterator[str]:
        """What is where, for the operator."""
        started = {order.agent: str(order.kind) for order in self._orders}
        kinds = {
            agent.id: f"simulated {agent.autopilot}"
            if agent.id in self._simulated
            else started.get(agent.id, agent.autopilot)
            for agent in self.manifest.fleet
        }
        return self.ground_control.table(self.manifest.fleet, kinds)


def _orders(mission: LoadedMission, options: RunOptions) -> tuple[VehicleOrder, ...]:
    """One for each agent whose vehicle is an autopilot itself."""
    plan, agents = mission.plan, mission.fleet.agents
    kinds = {a.started_as for a in agents} - {None, VehicleKind.SIMULATED}
    binaries = {kind: find(kind, options.binaries.get(kind)) for kind in kinds if kind}
    found = []
    for agent in agents:
        if agent.started_as in binaries:
            at, kind = start_of(plan, agent.id), agent.vehicle
            order = VehicleOrder(
                agent.id, agent.sysid, kind, binaries[kind], at, logs=options.px4_log
            )
            found.append(order)
    return tuple(found)


def _refuse_lockstep(agents: Sequence[FleetAgent]) -> None:
    """InputError where this system can't, or where a vehicle has a clock of its own."""
    refuse_without(lacks_for_lockstep(), "lockstep", "run without --lockstep or --speedup max")
    for agent in agents:
        if agent.endpoint is not None:
            raise InputError(
                f"--lockstep: agent {agent.id} flies the vehicle at {agent.endpoint}, whose clock"
                " this run can't stop; allowed: simulated vehicles"
            )
        if agent.started_as is not VehicleKind.SIMULATED:
            raise InputError(
                f"--lockstep: agent {agent.id} flies {agent.started_as}, which keeps its own time"
                " (a PX4 is stepped from outside by its own simulator interface alone);"
                " allowed: simulated vehicles"
            )


def _exposed_stations(fleet: Fleet, gcs: Sequence[tuple[str, int]]) -> list[str]:
    """Ground control software on other computers, which could command vehicles without keys."""
    if fleet.signing is SigningPolicy.REQUIRED:
        return []
    return [
        f"--gcs {host}:{port} commands the vehicles"
        for host, port in gcs
        if leaves_loopback(f"{host}:{port}")
    ]


def _epoch_s(options: RunOptions) -> float:
    return Clock.starting_now(options.speedup).epoch_s


def _router(agents: Sequence[FleetAgent]) -> str | None:
    """Where the fleet says that the router of all its agents listens; InputError where they have
    several: this run starts one."""
    named = list(dict.fromkeys(agent.router for agent in agents))
    if len(named) > 1:
        raise InputError(
            f"the fleet has routers at {', '.join(at or 'no place' for at in named)}, and run"
            " starts one, for all agents; allowed: one `router` (for several hosts: swarm-ctl"
            " router and swarm-ctl agent)"
        )
    return named[0]


def _router_place(mission: LoadedMission) -> dict[KeyHolder, str | None]:
    """The member that routes, and where; none in a mesh of peers. TrustError where the fleet's
    trust has none for that address."""
    if part_in(mission.plan, mission.fleet.routers) is MeshPart.PEER:
        return {}
    at = _router(mission.fleet.agents)
    folder = router_identity_folder(mission.fleet.trust, at or f"tcp/{LOOPBACK}:1")
    return {} if folder is None else {member_of(folder.name): at}


def _manifest(mission: LoadedMission, options: RunOptions) -> Manifest:
    """Simulated vehicles, and agents or a router without a place on the mesh, get free loopback
    ports."""
    agents = mission.fleet.agents
    simulated = [agent.id for agent in agents if agent.started_as is VehicleKind.SIMULATED]
    local = simulated + [agent.id for agent in agents if agent.radio]
    ports = dict(zip(local, free_ports(len(local), socket.SOCK_DGRAM), strict=True))
    routed = part_in(mission.plan, mission.fleet.routers) is MeshPart.CLIENT
    missing = 0 if routed else sum(agent.mesh is None for agent in agents)
    meshes = [f"tcp/127.0.0.1:{port}" for port in free_ports(missing + 1, socket.SOCK_STREAM)]
    trust = mission.fleet.trust
    spelled = as_tls if trust is not None else str
    router = spelled(_router(agents) or meshes.pop()) if routed else None
    fleet = tuple(
        replace(
            agent,
            endpoint=f"udpout:127.0.0.1:{ports[agent.id]}" if agent.id in ports else agent.endpoint,
            mesh=None if routed else spelled(agent.mesh or meshes.pop(0)),
            router=router,
        )
        for agent in agents
    )
    return Manifest(
        mission=str(mission.source),
        swarm=mission.plan.name,
        started_at=wall.date_and_time(),
        speedup=options.speedup,
        epoch_s=_epoch_s(options),
        lockstep=f"swarm-ctl-{uuid.uuid4()}" if options.lockstep else None,
        headless=options.show is not Show.DASHBOARD,
        plan=mission.plan,
        plan_hash=mission.plan.fingerprint(),
        fleet=fleet,
        simulated=tuple(simulated),
        process=os.getpid(),
        process_space=process_space(),
        trust=None if trust is None else str(Path(trust).absolute()),
        signing=mission.fleet.signing,
        station_mesh=None if routed else spelled(meshes.pop()),
        record_hz=options.record_hz,
        versions=package_versions(),
    )
