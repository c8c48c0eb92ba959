"""One agent's process: carries bytes between the links and `core.agent.Agent`, and decides nothing.

Each tick: read vehicle and mesh, `step`, send the vehicle's goal first, then the rest. If this loop
stalls, nothing is sent: the vehicle's own failsafe stops it (deadman).
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter

from swarm_ctl.core.agent.agent import Agent, Ended, Inbox
from swarm_ctl.core.model.fleet import RadioShare, SigningPolicy
from swarm_ctl.core.model.messages import AgentStatus, Event, Glimpse, Outcome, Refusal, Severity
from swarm_ctl.core.model.plan import Plan, Response
from swarm_ctl.core.swarm.hearing import hears_all
from swarm_ctl.engine.agent.narration import Narration
from swarm_ctl.engine.agent.publish import listen, publish
from swarm_ctl.engine.clock import unix_s
from swarm_ctl.engine.collector import collect_rarely
from swarm_ctl.engine.companion import Companion
from swarm_ctl.engine.forked import serve_forked
from swarm_ctl.engine.lifeline import ALIVE, READY, Lifeline
from swarm_ctl.engine.link_keys import folder_signing
from swarm_ctl.engine.lockstep.seat import Seat, die, take_seat
from swarm_ctl.engine.lockstep.words import TickPhase
from swarm_ctl.engine.protection import access, own_identity, valid_for_s
from swarm_ctl.engine.refused_links import refused_links
from swarm_ctl.engine.script import NO_SCRIPT, AgentScript, ScriptedAgent
from swarm_ctl.engine.vehicle_memory import Remembering, VehicleMemory
from swarm_ctl.files import replacing
from swarm_ctl.law_loader import own_law_of
from swarm_ctl.mavlink.autopilots.timing import streams_hz
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
    """All an agent's process is told. The vehicle's `endpoint` is as in `core.model.fleet`; on
    the mesh it listens at `listen` ('': it does not) and connects to `connect`, in a large swarm
    the router of its host."""

    plan: Plan
    agent_id: int
    sysid: int
    agent_sysid: int
    """What the agent itself speaks with."""
    autopilot: str
    endpoint: str
    swarm: str
    listen: str
    connect: tuple[str, ...]
    epoch_s: float
    speedup: float
    vehicle: Response = field(default_factory=Response)
    """How the vehicle answers a velocity setpoint."""
    expect_station: bool = False
    """It does not arm before it has heard a ground station."""
    report: Path | None = None
    """Where the final status is written as JSON."""
    log: Path | None = None
    """Where stdout and stderr go; None: they stay."""
    tlog: Path | None = None
    """Where the vehicle's MAVLink frames are kept."""
    memory: Path | None = None
    """The folder where the vehicle's own parameters are remembered while we change them; None:
    they are not, as of a vehicle that ends with the run."""
    flight: str = ""
    """What this flight is called there."""
    mirror_port: int | None = None
    """Where it shares the vehicle's only link with ground control software."""
    mirror_secret: bytes = field(default=b"", repr=False)
    """By it the agent knows the relay that it shares its link with."""
    lockstep: str | None = None
    """Where the keeper of mission time is, for a run in lockstep."""
    identity: Path | None = None
    """The folder with the agent's own keys (`swarm-ctl trust new`); None: the mesh is open."""
    signing: SigningPolicy = SigningPolicy.OFF
    """Of the frames between agent and vehicle."""
    radio: RadioShare | None = None
    """What the vehicle shares with others."""
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


_LARGE_SWARM_NICE: Final = 4
"""Where both cores are busy, an agent then gets 0.4 of what a process that serves all gets (Linux:
1.25 a step). Chosen, not measured."""


def child_main(config: AgentConfig, connection: Connection) -> None:
    """Entry of an agent that `run` forks. Of a large swarm, whose processes one machine hardly
    carries, those that serve all agents (simulator, router, station) come first."""
    if not hears_all(config.plan):
        os.nice(_LARGE_SWARM_NICE)
    serve_forked(lambda lifeline: run_agent(config, lifeline), config.log, connection)


def run_agent(
    config: AgentConfig,
    lifeline: Lifeline,
    show: Callable[[str], None] = lambda _: None,
    companion: Companion | None = None,
) -> int:
    """Fly one agent to its end; the exit code: 0 when it completed or landed on command, 1 when it
    failed. `show` gets what it waits for and what happens, line by line; `companion` all that it
    says and hears."""
    identity = own_identity(config.identity, config.agent_id)
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
        seat.join(f"agent-{config.agent_id}", config.swarm, config.agent_id)
        lifeline.tell(READY)
        if companion is not None:
            node.overheard = companion.take
        ended, status = _loop(
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
        lifeline.tell(f"{ended.outcome}: {ended.reason}" if ended.reason else ended.outcome)
    if config.report is not None and status is not None:
        _write_report(config.report, status)
    return 0 if ended.outcome in (Outcome.COMPLETED, Outcome.ABORTED) else 1


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
    remembers = config.memory is not None
    vehicle = (seat.wire(config.endpoint), config.autopilot, config.sysid)
    mirror = (
        None if config.mirror_port is None else Mirror(config.mirror_port, config.mirror_secret)
    )
    return VehicleLink(
        *vehicle,
        keep,
        remembers=remembers,
        agent_sysid=config.agent_sysid,
        mirror=mirror,
        signing=signing,
        streams_hz=streams_hz(config.radio, config.autopilot, signed=signing is not None),
    )


def _join_mesh(
    config: AgentConfig, seat: Seat, identity: Identity | None, script: ScriptedAgent
) -> Node:
    now = seat.clock.now
    transport = ZenohTransport(
        [config.listen] if config.listen else [],
        config.connect,
        now,
        seat.mesh_speedup,
        patient=seat.repeats,
        access=access(identity, config.swarm),
        alive=keys.alive_key(config.swarm, "agent", config.agent_id),
        own=config.zenoh,
        # what does not listen is a router's client
        part=part_in(config.plan, () if config.listen else config.connect),
    )
    node = Node(script.wrap(seat.mesh(transport)), config.swarm, config.agent_id)
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
    own = script.own_time
    agent = Agent(
        config.plan,
        config.agent_id,
        own(seat.clock.now()),
        expect_station=config.expect_station,
        vehicle=config.vehicle,
        keys_end_s=own(seat.clock.now()) + valid_for_s(identity),
        # in lockstep mission time has no pace: no command is old
        speedup=math.inf if config.lockstep else config.speedup,
        same_clock=config.same_clock,
        own_law=own_law_of(config.plan.law),
    )
    memory = VehicleMemory(config.memory) if config.memory else None
    remembering = Remembering(memory, config.endpoint, config.flight)
    shown, remembers = Rim("what this agent tells of itself"), Rim("the vehicle's memory")
    shares, refusals = Rim("the shared link"), Rim("the words on refused messages")
    beside = Rim("the process beside this agent")
    ticker = seat.ticker(config.plan.tick_s, lambda: lifeline.tell(ALIVE))
    status: AgentStatus | None = None
    collect_rarely()

    def likely(word: Glimpse, at: float) -> bool:
        return agent.likely(word, own(at))

    swarm_s = 0.0
    while True:
        script.turn(swarm_s)  # what is due at the end of the tick before
        if script.killed:
            die(seat)
        swarm_s = ticker.wait()
        if script.stopped:
            continue
        now = own(swarm_s)
        link.receive(now)
        inbox = Inbox(
            view=link.view(),
            states=[(state, own(at)) for state, at in node.take(keys.STATE, likely)],
            far=[(state, own(at)) for state, at in node.take(keys.FAR, likely)],
            clocks=[(news, own(at)) for news, at in node.take(keys.CLOCK, likely)],
            laws=[news for news, _ in node.take(keys.LAW)],
            targets=[
                (word, own(at))
                for channel in (keys.TARGET, keys.SIGHTING)
                for word, at in node.take(channel)
            ],
            beacons=[(beacon, own(at)) for beacon, at in node.take(keys.BEACON)],
            commands=[command for command, _ in node.take(keys.COMMAND)],
            told_to_end=lifeline.cut(),
            tick=ticker.report,
            bad_payloads=node.bad_payloads,
            refused=lambda at_s: (
                refusals.run(lambda: (*node.refused(at_s), *links_refused(at_s))) or ()
            ),
        )
        actions = agent.step(now, inbox)
        link.pursue(actions.goal, now)
        actions.state = script.told(actions.state)
        publish(node, actions, shown)
        if actions.follow is not None:
            node.follow(keys.STATE, actions.follow)
        if actions.status is not None:
            status = actions.status
            lifeline.tell(ALIVE)
            remembers.run(remembering.serve, link, status.own)  # after the mesh was told
            for trouble in (
                t for rim in (shown, remembers, shares, refusals, beside) for t in rim.troubles()
            ):
                _log(str(trouble))
                event = Event(config.agent_id, now, Severity.WARNING, str(trouble))
                shown.run(node.send, keys.EVENT, event)
        shares.run(link.share, now)
        if companion is not None:
            beside.run(companion.send)
        shown.run(narration.tell, actions.events, actions.status)
        if actions.ended is not None:
            return actions.ended, status
