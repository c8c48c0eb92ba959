"""One agent's process: opens its links, and turns its shell each tick."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from pydantic import TypeAdapter

from swarm_ctl.core.agent.agent import Agent, Ended, ended
from swarm_ctl.core.model.fleet import Fleet, FleetAgent, SigningPolicy
from swarm_ctl.core.model.messages import AgentStatus, Event, Outcome, Refusal, Severity
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.engine.agent.narration import Narration
from swarm_ctl.engine.agent.shell import AgentShell, listen, vehicle_link
from swarm_ctl.engine.clock import Clock, unix_s
from swarm_ctl.engine.collector import collect_rarely
from swarm_ctl.engine.companion import Companion
from swarm_ctl.engine.gcs.config import RelayVehicle
from swarm_ctl.engine.lifeline import ALIVE, READY, Lifeline
from swarm_ctl.engine.link_keys import folder_signing
from swarm_ctl.engine.lockstep.seat import Seat, die, take_seat
from swarm_ctl.engine.lockstep.words import TickPhase
from swarm_ctl.engine.protection import access, agent_identity_folder, own_identity, valid_for_s
from swarm_ctl.engine.refused_links import refused_links
from swarm_ctl.engine.script import NO_SCRIPT, AgentScript, ScriptedAgent
from swarm_ctl.engine.vehicle_memory import Remembering, VehicleMemory
from swarm_ctl.files import replacing
from swarm_ctl.law_loader import own_law_of
from swarm_ctl.mavlink.link import VehicleLink
from swarm_ctl.mavlink.mirror import Mirror
from swarm_ctl.mavlink.signing import LinkSigning as FrameSigning
from swarm_ctl.mavlink.stamp import kept_signing
from swarm_ctl.mavlink.tlog import TlogWriter
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.zenoh_config import part_in
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.rim import Rim
from swarm_ctl.trust.identity import Identity


@dataclass(frozen=True, slots=True)
class AgentConfig:
    """All an agent's process is told. On the mesh it connects to `connect`, in a large swarm the
    router of its host."""

    plan: Plan
    own: FleetAgent
    """Its entry in the fleet; without `mesh` it does not listen."""
    connect: tuple[str, ...]
    epoch_s: float
    speedup: float
    expect_station: bool = False
    """It does not arm before it has heard a ground station."""
    report: Path | None = None
    """Where the final status is written as JSON."""
    tlog: Path | None = None
    """Where the vehicle's MAVLink frames are kept."""
    memory: Path | None = None
    """The folder where the vehicle's own parameters are remembered while we change them; None:
    they are not, as of a vehicle that ends with the run."""
    flight: str = ""
    """What this flight is called there."""
    mirror: RelayVehicle | None = field(default=None, repr=False)
    """Where it shares the vehicle's only link with ground control software."""
    lockstep: str | None = None
    """Where the keeper of mission time is, for a run in lockstep."""
    identity: Path | None = None
    """The folder with the agent's own keys (`swarm-ctl trust new`); None: the mesh is open."""
    signing: SigningPolicy = SigningPolicy.OFF
    """Of the frames between agent and vehicle."""
    signing_key: Path | None = None
    """The file with the key that signs them, of an agent that has no identity."""
    same_clock: tuple[int, ...] = ()
    """The agents that the launcher starts on the same host with the same `epoch_s`."""
    zenoh: Mapping[str, Any] = field(default_factory=dict)
    """A user's own zenoh settings."""
    script: AgentScript = NO_SCRIPT
    """What a scenario does to it; in lockstep alone."""
    started_us: int = 0
    """Mission time 0 of the tlog, in microseconds of Unix time."""

    @classmethod
    def of(
        cls, plan: Plan, fleet: Fleet, agent: int, clock: Clock, identity: Path | None = None
    ) -> Self:
        """As plan and fleet say it. In a mesh of peers an agent connects to those before it and
        listens for those after it, so that every pair is linked once; else it connects to the
        router."""
        own = fleet.agent(agent)
        before = fleet.agents[: fleet.agents.index(own)]
        return cls(
            plan=plan,
            own=replace(own, mesh=None) if own.router else own,
            connect=(own.router,) if own.router else tuple(a.mesh for a in before if a.mesh),
            epoch_s=clock.epoch_s,
            speedup=clock.speedup,
            flight=plan.name,
            identity=agent_identity_folder(fleet.trust, agent, identity),
            signing=fleet.signing,
        )


def run_agent(
    config: AgentConfig,
    lifeline: Lifeline,
    show: Callable[[str], None] = lambda _: None,
    companion: Companion | None = None,
) -> int:
    """Fly one agent to its end; the exit code: 0 when it completed or landed on command, 1 when it
    failed. `show` gets what it waits for and what happens, line by line; `companion` all that it
    says and hears."""
    identity = own_identity(config.identity, config.own.id)
    seat = take_seat(config.lockstep, TickPhase.SWARM, config.epoch_s, config.speedup)
    script = ScriptedAgent(config.script, seat.clock.now)
    with (
        closing(seat),
        _tlog(config) as keep,
        _signing(config) as signing,
        closing(_link(config, keep, seat, signing)) as link,
        refused_links(identity) as links_refused,
        closing(_join_mesh(config, seat, identity, script)) as node,
    ):
        seat.join(f"agent-{config.own.id}", config.plan.name, config.own.id)
        lifeline.tell(READY)
        if companion is not None:
            node.overheard = companion.take
        end, status = _loop(
            config,
            seat,
            link,
            node,
            lifeline,
            identity,
            links_refused,
            Narration(show),
            script,
            companion,
        )
        seat.end(last=True)
        lifeline.tell(f"{end.outcome}: {end.reason}" if end.reason else end.outcome)
    if config.report is not None and status is not None:
        _write_report(config.report, status)
    return 0 if end.outcome in (Outcome.COMPLETED, Outcome.ABORTED) else 1


@contextmanager
def _tlog(config: AgentConfig) -> Iterator[Callable[[bytes, float], None] | None]:
    """What keeps the vehicle's frames, if that is asked for."""
    if config.tlog is None:
        yield None
        return
    with closing(TlogWriter(config.tlog, config.started_us)) as tlog:
        yield tlog.take
    if tlog.failure:
        _log(f"{config.tlog} ends early: {tlog.failure}")


def _signing(config: AgentConfig) -> AbstractContextManager[FrameSigning | None]:
    """What signs the vehicle's link, if that is asked for."""
    key, pace = config.signing_key, 0.0 if config.lockstep else 1.0 / config.speedup
    if key is not None:
        return kept_signing(key, key.with_name(f"{key.name}.stamp"), unix_s(), pace=pace)
    if config.identity is None or config.signing is not SigningPolicy.REQUIRED:
        return nullcontext()
    return folder_signing(config.identity, pace=pace)


def _link(
    config: AgentConfig,
    keep: Callable[[bytes, float], None] | None,
    seat: Seat,
    signing: FrameSigning | None,
) -> VehicleLink:
    shared, wire = config.mirror, seat.wire(config.own.endpoint or "")
    mirror = None if shared is None else Mirror(shared.port, bytes.fromhex(shared.secret))
    remembers = config.memory is not None
    return vehicle_link(config.own, wire, signing, keep, remembers=remembers, mirror=mirror)


def _join_mesh(
    config: AgentConfig, seat: Seat, identity: Identity | None, script: ScriptedAgent
) -> Node:
    now = seat.clock.now
    transport = ZenohTransport(
        [config.own.mesh] if config.own.mesh else [],
        config.connect,
        now,
        seat.mesh_speedup,
        patient=seat.repeats,
        access=access(identity, config.plan.name),
        alive=keys.alive_key(config.plan.name, "agent", config.own.id),
        own=config.zenoh,
        # what does not listen is a router's client
        part=part_in(config.plan, () if config.own.mesh else config.connect),
    )
    node = Node(script.wrap(seat.mesh(transport)), config.plan.name, config.own.id)
    listen(node, config.plan)
    return node


def _write_report(path: Path, status: AgentStatus) -> None:
    """A full disk does not make a flight a failure: the station's record has the last status,
    too."""
    rim = Rim(f"the account in {path}")
    rim.run(lambda: _write_whole(path, TypeAdapter(AgentStatus).dump_json(status, indent=1)))
    for trouble in rim.troubles():
        _log(str(trouble))


def _write_whole(path: Path, data: bytes) -> None:
    with replacing(path) as file:
        file.write(data)


def _log(text: str) -> None:
    with suppress(OSError, ValueError):  # a full disk, a log that was closed
        sys.stderr.write(f"agent: {text}\n")


def _loop(
    config: AgentConfig,
    seat: Seat,
    link: VehicleLink,
    node: Node,
    lifeline: Lifeline,
    identity: Identity | None,
    links_refused: Callable[[float], tuple[Refusal, ...]],
    narration: Narration,
    script: ScriptedAgent,
    companion: Companion | None,
) -> tuple[Ended, AgentStatus | None]:
    clock = script.own_time
    agent = Agent(
        config.plan,
        config.own.id,
        clock(seat.clock.now()),
        expect_station=config.expect_station,
        vehicle=config.own.response,
        keys_end_s=clock(seat.clock.now()) + valid_for_s(identity),
        # in lockstep mission time has no pace: no command is old
        speedup=math.inf if config.lockstep else config.speedup,
        same_clock=config.same_clock,
        own_law=own_law_of(config.plan.law),
    )
    memory = VehicleMemory(config.memory) if config.memory else None
    remembering = Remembering(memory, config.own.endpoint or "", config.flight)
    shell = AgentShell(agent, link, node, remembering, clock)
    shell.tampered = script.told
    shell.shown = shown = Rim("what this agent tells of itself")
    shell.remembers = remembers = Rim("the vehicle's memory")
    shares, refusals = Rim("the shared link"), Rim("the words on refused messages")
    beside = Rim("the process beside this agent")
    ticker = seat.ticker(config.plan.tick_s, lambda: lifeline.tell(ALIVE))
    collect_rarely()

    def refused(at_s: float) -> tuple[Refusal, ...]:
        return refusals.run(lambda: (*node.refused(at_s), *links_refused(at_s))) or ()

    swarm_s = 0.0
    while shell.ended is None:
        script.turn(swarm_s)  # what is due at the end of the tick before
        if script.killed:
            die(seat)
        swarm_s = ticker.wait()
        if script.stopped:
            continue
        actions = ended(shell.turn(swarm_s, lifeline.cut(), ticker.report, refused))
        now = shell.clock(swarm_s)
        if actions.status is not None:
            lifeline.tell(ALIVE)
            for trouble in (
                t for rim in (shown, remembers, shares, refusals, beside) for t in rim.troubles()
            ):
                _log(str(trouble))
                event = Event(config.own.id, now, Severity.WARNING, str(trouble))
                shown.run(node.send, keys.EVENT, event)
        shares.run(link.share, now)
        if companion is not None:
            beside.run(companion.send)
        shown.run(narration.tell, actions.events, actions.status)
    return shell.ended, shell.status
