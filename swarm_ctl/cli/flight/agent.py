"""`swarm-ctl agent`: one agent alone, the same that `run` starts six of."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from swarm_ctl.cli.shared.options import (
    FleetFile,
    OpenMesh,
    Speedup,
    ZenohConfig,
    endpoint_option,
    option,
    require_writable,
    switch,
    zenoh_settings,
)
from swarm_ctl.core.model.fleet import Fleet, FleetAgent, SigningPolicy
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.errors import InputError, TrustError
from swarm_ctl.installed import require

if TYPE_CHECKING:
    from swarm_ctl.engine.agent.agent_process import AgentConfig
    from swarm_ctl.engine.companion import Companion
    from swarm_ctl.engine.fetched_plan import AgentPost
    from swarm_ctl.mission.compile.loader import LoadedMission
    from swarm_ctl.mission.compile.offers import PlanName

_PEER: Final = (
    "Where another agent listens; repeat it. Of two agents, one has to name the other."
    "  [default: the agents before it in the fleet]"
)
_ROUTER: Final = (
    "Where its router listens, for a swarm of more than 16 or with routers.  [default: as in the"
    " fleet]"
)
_KEY: Final = (
    "The vehicle's 32-byte signing key, mode 0600: all frames are signed. The newest stamp is kept"
    " beside it.  [default: as in the fleet]"
)
_IDENTITY: Final = (
    "The folder with its own keys (swarm-ctl trust).  [default: agent-ID in the fleet's trust]"
)
EXPECT_STATION: Final = "Do not arm before a ground station was heard."
_PLAN: Final = (
    "A plan file, NAME@HASH of a plan that a station has, or a mission file (needs ground)."
)
_TIMEOUT: Final = "Of NAME@HASH: how long to wait for a station that has it."
_RECORD: Final = (
    "A folder for agent-ID.tlog, which goes on where it is there, and the last status as JSON."
)
_EPOCH: Final = (
    "Mission time 0 on this host's monotonic clock.  [default: its own zero where the fleet says"
    " `host`, so that all agents of a host share one clock; else now]"
)
_ROS2: Final = (
    "Tell this drone's part to ROS 2 in this domain, over rmw_zenoh: a process beside the agent"
    " does. Takes no orders. Needs the extra `ros2`.  [default: ROS_DOMAIN_ID, or 0]"
)
_LOCKSTEP: Final = "The folder of a run in lockstep, whose clock this agent joins."


def agent(
    file: Annotated[Path, typer.Argument(metavar="PLAN", help=_PLAN)],
    agent_id: Annotated[int, option("ID", "The agent that this process is.", "--id")],
    endpoint: Annotated[
        str | None,
        endpoint_option(
            "Its vehicle, e.g. serial:/dev/ttyAMA0:921600.  [default: as in the fleet]"
        ),
    ] = None,
    mesh: Annotated[
        str | None, option("tcp/HOST:PORT", "Where it listens.  [default: as in the fleet]")
    ] = None,
    peer: Annotated[list[str] | None, option("tcp/HOST:PORT", _PEER)] = None,
    router: Annotated[str | None, option("tcp/HOST:PORT", _ROUTER)] = None,
    fleet: FleetFile = None,
    speedup: Speedup = 1.0,
    epoch: Annotated[float | None, option("SECONDS", _EPOCH)] = None,
    identity: Annotated[Path | None, option("FOLDER", _IDENTITY)] = None,
    open_mesh: OpenMesh = False,
    zenoh_config: ZenohConfig = None,
    expect_station: Annotated[bool, switch("--expect-station", EXPECT_STATION)] = False,
    lockstep: Annotated[Path | None, option("RUN", _LOCKSTEP)] = None,
    signing_key: Annotated[Path | None, option("FILE", _KEY)] = None,
    plan_timeout: Annotated[float, option("SECONDS", _TIMEOUT, min=1.0)] = 60.0,
    record: Annotated[Path | None, option("FOLDER", _RECORD)] = None,
    ros2: Annotated[str | None, option("DOMAIN", _ROS2, "--ros2")] = None,
) -> None:
    """Fly one agent, on the computer of its drone.

    The vehicle's endpoint and the address on the mesh are in the file's fleet, or given here. The
    agents need no ground station. Ctrl-C lands the vehicle.

    A plan that is named by its hash is fetched from a ground station on the mesh (`station`, `run`)
    and kept on this computer, so that the agent starts again without one. Only --mesh and --peer,
    or --router, are known before it is there.

    Examples:

    \b
        swarm-ctl agent plan.json --id 3
        swarm-ctl agent plan.json --id 3 --endpoint serial:/dev/ttyAMA0:921600
        swarm-ctl agent missions/hexagon.yaml --fleet outdoors.yaml --id 3
        swarm-ctl agent hexagon@3fa9c1d2e4f6 --id 3 --mesh tcp/10.0.0.13:7447
        swarm-ctl agent plan.json --id 3 --ros2
    """
    from swarm_ctl.engine.agent.agent_process import AgentConfig, run_agent
    from swarm_ctl.engine.agent.narration import show_on_terminal
    from swarm_ctl.engine.clock import Clock, unix_s
    from swarm_ctl.engine.forked import leave
    from swarm_ctl.engine.lifeline import SignalLifeline
    from swarm_ctl.engine.vehicle_memory import state_folder
    from swarm_ctl.mission.compile.offers import plan_name
    from swarm_ctl.mission.fleet.exposure import exposures, refuse_exposed

    domain = None if ros2 is None else _domain(ros2)
    given = _Places(endpoint, mesh, peer, router)
    wanted = None if file.exists() else plan_name(str(file))
    if wanted is None:
        plan, entries = plan_and_fleet(file, fleet)
    else:
        own_zenoh = zenoh_settings(zenoh_config, guarded=open_mesh or identity is not None)
        known = _Known(agent_id, given, fleet, identity, open_mesh, own_zenoh)
        plan, entries = _fetched(wanted, known, plan_timeout)
    own = _own(plan, entries, agent_id, given)
    begins_s = 0.0 if own.host and epoch is None else epoch
    clock = Clock.starting_now(speedup) if begins_s is None else Clock(begins_s, speedup)
    agents = tuple(own if entry.id == agent_id else entry for entry in entries.agents)
    config = AgentConfig.of(plan, replace(entries, agents=agents), agent_id, clock, identity)
    keys = config.identity
    config = replace(
        config,
        connect=tuple(peer or config.connect),
        expect_station=expect_station,
        memory=state_folder(),
        lockstep=None if lockstep is None else _clock_of(lockstep),
        signing_key=signing_key,
        zenoh=zenoh_settings(zenoh_config, guarded=open_mesh or keys is not None),
        report=record and record / f"agent-{agent_id}.json",
        tlog=record and record / f"agent-{agent_id}.tlog",
        started_us=int((unix_s() - clock.now()) * 1e6),
        same_clock=tuple(a.id for a in entries.agents if own.host and a.host == own.host),
    )
    if not open_mesh:
        signing = SigningPolicy.REQUIRED if signing_key else entries.signing
        alone = Fleet((config.own,), None if keys is None else str(keys), signing)
        refuse_exposed(exposures(alone, config.connect), str(fleet or file), keys)
    if keys is not None:
        threading.Thread(target=_explain, args=(keys, config.connect), daemon=True).start()
    if record is not None:
        require_writable(record, "choose with --record")
        record.mkdir(parents=True, exist_ok=True)
    beside = None if domain is None else _beside(config, domain)
    leave(run_agent(config, SignalLifeline(), show_on_terminal, beside))


def _beside(agent: AgentConfig, domain: int) -> Companion | None:
    """What tells ROS 2; None where it can't be started, which keeps no agent from flying."""
    from swarm_ctl.engine.companion import Companion, CompanionConfig

    try:
        return Companion(
            CompanionConfig(
                plan=agent.plan,
                agent=agent.own.id,
                epoch_s=agent.epoch_s,
                speedup=agent.speedup,
                stepped=agent.lockstep is not None,
                attach=(f"ros2={domain}",),
            )
        )
    except OSError as error:
        sys.stderr.write(f"agent: ROS 2 is told nothing: {error.strerror}; the flight goes on\n")
        return None


def _domain(given: str) -> int:
    """Of ROS 2; checked here, so that nothing flies where it is none."""
    from swarm_ctl.extensions.ros2 import domain_of

    require("ros2", "--ros2")
    return domain_of(given, os.environ)


def _explain(keys: Path, peers: Sequence[str]) -> None:
    """Say why a peer that is there already refuses this agent, which goes on trying: in the air it
    must not wait for the answer."""
    from swarm_ctl.engine.protection import explained
    from swarm_ctl.trust.identity import load_identity

    with contextlib.suppress(TrustError):  # `run_agent` says it
        why = explained(load_identity(keys), peers)
        if why:
            sys.stderr.write(f"agent: {why}\n")


def _clock_of(run: Path) -> str:
    from swarm_ctl.runfolder.manifest import read_manifest

    found = read_manifest(run).lockstep
    if found is None:
        raise InputError(f"--lockstep {run}: that run is in real time; allowed: one in lockstep")
    return found


def plan_and_fleet(
    file: Path, fleet: Path | None, look: Callable[[LoadedMission], None] = lambda _: None
) -> tuple[Plan, Fleet]:
    """Of a plan file, or of a mission file with the fleet it names, or this one; `look` at the
    mission."""
    from swarm_ctl.mission.compile.plan_file import is_plan_file, read_plan

    if not is_plan_file(file):
        require("ground", f"{file} is a mission file, which")
        from swarm_ctl.mission.compile.loader import load

        loaded = load(file, fleet=fleet)
        look(loaded)
        return loaded.plan, loaded.fleet
    if fleet is not None:
        raise InputError(
            f"--fleet {fleet}: {file} is a plan file and has its fleet; allowed: --endpoint, --mesh"
        )
    found = read_plan(file)
    return found.plan, Fleet(found.fleet, found.trust, found.signing)


def _fetched(wanted: PlanName, known: _Known, patience_s: float) -> tuple[Plan, Fleet]:
    """Of a station, or of this computer."""
    from swarm_ctl.engine.fetched_plan import fetched_plan, kept_plan
    from swarm_ctl.engine.protection import own_identity
    from swarm_ctl.engine.vehicle_memory import state_folder

    if known.fleet is not None:
        raise InputError(
            f"--fleet {known.fleet}: {wanted} is no file, so it is fetched with its fleet; allowed:"
            " --endpoint, --mesh"
        )
    # what came over an open mesh is not flown with keys
    folder = state_folder() / ("plans" if known.identity is None else "trusted-plans")
    found = kept_plan(wanted, folder)
    if found is None:
        post = _post(wanted, known)
        identity = own_identity(known.identity, known.agent_id)
        found = fetched_plan(wanted, folder, post, identity, patience_s, known.zenoh)
    return found.plan, Fleet(found.fleet, found.trust, found.signing)


def _post(wanted: PlanName, known: _Known) -> AgentPost:
    """Where the agent fetches its plan; InputError where it has no place, or others reach it."""
    from swarm_ctl.engine.fetched_plan import AgentPost
    from swarm_ctl.mission.fleet.exposure import leaves_loopback, refuse_exposed

    given = known.given
    post = AgentPost((given.mesh,) if given.mesh else (), tuple(given.peers or ()), given.router)
    if not post.endpoints:
        raise InputError(
            f"{wanted} is no file, so it is fetched from a station, and this agent has no place on"
            " the mesh; allowed: --mesh (and --peer), or --router"
        )
    if known.identity is None and not known.open_mesh:
        exposed = [f"the mesh is at {at}" for at in post.endpoints if leaves_loopback(at)]
        refuse_exposed(exposed, "FILE")
    return post


@dataclass(frozen=True, slots=True)
class _Known:
    """What the command line says to an agent that has no plan yet."""

    agent_id: int
    given: _Places
    fleet: Path | None
    identity: Path | None
    open_mesh: bool
    zenoh: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class _Places:
    """Endpoints of the command line."""

    endpoint: str | None
    mesh: str | None
    peers: list[str] | None
    router: str | None


def _own(plan: Plan, fleet: Fleet, agent_id: int, given: _Places) -> FleetAgent:
    """The agent's fleet entry with the addresses that were given."""
    ids = [entry.id for entry in fleet.agents]
    if agent_id not in ids:
        allowed = ", ".join(map(str, ids))
        raise InputError(f"--id {agent_id} is no agent of this mission; allowed: {allowed}")
    entry = fleet.agent(agent_id)
    own = replace(
        entry,
        endpoint=given.endpoint or entry.endpoint,
        radio=None if given.endpoint else entry.radio,
        mesh=given.mesh or entry.mesh,
        router=given.router or entry.router,
    )
    from swarm_ctl.mesh.zenoh_config import MeshPart, part_in

    routers = (own.router,) if own.router else ()
    routed = part_in(plan, routers) is MeshPart.CLIENT
    if routed and (given.mesh or given.peers):
        raise InputError(
            f"--mesh, --peer: agent {agent_id} is a client of its host's router; allowed: --router"
        )
    needed = {"router": own.router} if routed else {"mesh": own.mesh}
    for name, value in {"endpoint": own.endpoint, **needed}.items():
        if not value:
            raise InputError(
                f"agent {agent_id} has no `{name}` in the fleet; a single agent needs one,"
                f" there or as --{name}"
            )
    return own
