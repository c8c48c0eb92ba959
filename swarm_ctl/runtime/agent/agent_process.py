"""One agent's process: carries bytes between the wires and `core.Agent`, tick by tick, and decides
nothing.

Each tick: read vehicle and mesh, `step`, send the vehicle's goal first, then the rest. If this loop
stalls, nothing is sent: the vehicle's own failsafe stops it (deadman).
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import traceback
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final, Protocol

from pydantic import TypeAdapter

from swarm_ctl.core.agent.agent import Actions, Agent, Ended, Inbox
from swarm_ctl.core.model.messages import AgentStatus
from swarm_ctl.core.model.plan import Plan, Response
from swarm_ctl.errors import SwarmError
from swarm_ctl.mavlink.link import VehicleLink
from swarm_ctl.mavlink.tlog import TlogWriter
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.runtime.clock import Clock
from swarm_ctl.runtime.ticker import Ticker

READY: Final = "ready"
"""First word on the lifeline once link and mesh are open; anything else is why it did not start."""
ALIVE: Final = "alive"
"""Said with every status, so that a hung agent is noticed."""
_GC_THRESHOLD: Final = 50_000
"""Objects between collections: everything built at the start is frozen, a tick leaves next to none
behind."""


@dataclass(frozen=True, slots=True)
class AgentConfig:
    """All an agent's process is told. Endpoints as in `mission.compile.fleet`; the mesh connects to
    `connect`."""

    plan: Plan
    agent_id: int
    sysid: int
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
    """Started together with a ground station: it must be heard before anything arms."""
    report: Path | None = None
    """Where the final status is written as JSON."""
    log: Path | None = None
    """Where stdout and stderr go; None: they stay."""
    tlog: Path | None = None
    """Where the vehicle's MAVLink frames are kept, with mission time 0 at `started_us` microseconds
    of Unix time."""
    started_us: int = 0


class Lifeline(Protocol):
    """How an agent knows that whoever started it still lives."""

    def cut(self) -> bool:
        """True once the other end is gone (or a signal asked us to land)."""

    def tell(self, text: str) -> None:
        """Say one word to the other end, if it is there."""


class PipeLifeline:
    """A pipe to the parent: its end of file is the parent's death."""

    def __init__(self, connection: Connection) -> None:
        os.set_blocking(connection.fileno(), False)
        self._connection = connection
        self._cut = False

    def cut(self) -> bool:
        """As `Lifeline.cut`. What the parent writes says nothing and is read away."""
        try:
            while not self._cut and self._connection.poll():
                self._connection.recv_bytes()
        except (EOFError, OSError):
            self._cut = True
        return self._cut

    def tell(self, text: str) -> None:
        """As `Lifeline.tell`."""
        try:
            self._connection.send(text)
        except BlockingIOError:
            pass  # a parent that does not read must not stop the control loop
        except OSError:
            self._cut = True


class SignalLifeline:
    """An agent started alone from a terminal: SIGINT and SIGTERM land it."""

    def __init__(self) -> None:
        self._cut = False
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._signalled)

    def _signalled(self, *_: object) -> None:
        self._cut = True

    def cut(self) -> bool:
        """As `Lifeline.cut`."""
        return self._cut

    def tell(self, text: str) -> None:
        """Say it on the terminal."""
        if text != ALIVE:
            sys.stderr.write(f"agent: {text}\n")


def child_main(config: AgentConfig, connection: Connection) -> None:
    """Entry of an agent that `run` forks; ends the process with the agent's exit code."""
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # the lifeline is the only word that counts
    lifeline = PipeLifeline(connection)
    try:
        if config.log is not None:
            _redirect(config.log)
        code = run_agent(config, lifeline)
    except SwarmError as error:
        lifeline.tell(str(error))
        code = error.exit_code
    except BaseException:
        traceback.print_exc()
        lifeline.tell(traceback.format_exc(limit=-1).strip().splitlines()[-1])
        code = 70  # EX_SOFTWARE
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # no atexit of the forkserver's making; link and mesh are closed already


def _redirect(log: Path) -> None:
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    os.close(descriptor)


def run_agent(config: AgentConfig, lifeline: Lifeline) -> int:
    """Fly one agent to its end; 0 when it ended as it should (completed, or landed on command), 1
    when it failed."""
    clock = Clock(config.epoch_s, config.speedup)
    tlog = TlogWriter(config.tlog, config.started_us) if config.tlog else None
    link = VehicleLink(config.endpoint, config.autopilot, config.sysid, tlog.take if tlog else None)
    try:
        transport = ZenohTransport([config.listen], config.connect, clock.now, config.speedup)
        node = Node(transport, config.swarm, config.agent_id)
        try:
            node.listen(keys.STATE, keys.CLOCK, keys.BEACON, keys.COMMAND)
            lifeline.tell(READY)
            ended, status = _loop(config, clock, link, node, lifeline)
            lifeline.tell(f"{ended.outcome}: {ended.reason}" if ended.reason else ended.outcome)
        finally:
            node.close()
    finally:
        link.close()
        if tlog is not None:
            tlog.close()
            if tlog.failure:
                sys.stderr.write(f"agent: {config.tlog} ends early: {tlog.failure}\n")
    if config.report is not None and status is not None:
        _write_report(config.report, status)
    return 0 if ended.outcome in ("completed", "aborted") else 1


def _write_report(path: Path, status: AgentStatus) -> None:
    """A disk that takes no more does not make a flight a failure: the station's record has the last
    status, too."""
    try:
        path.write_bytes(TypeAdapter(AgentStatus).dump_json(status, indent=1))
    except OSError as error:
        sys.stderr.write(f"agent: {path} can't be written: {error.strerror}\n")


def _loop(
    config: AgentConfig, clock: Clock, link: VehicleLink, node: Node, lifeline: Lifeline
) -> tuple[Ended, AgentStatus | None]:
    agent = Agent(
        config.plan,
        config.agent_id,
        clock.now(),
        expect_station=config.expect_station,
        vehicle=config.vehicle,
    )
    ticker = Ticker(clock, config.plan.tick_s)
    status: AgentStatus | None = None
    gc.freeze()
    gc.set_threshold(_GC_THRESHOLD, 20, 100)
    while True:
        now = ticker.wait()
        link.receive(now)
        inbox = Inbox(
            view=link.view(),
            states=node.take(keys.STATE),
            clocks=node.take(keys.CLOCK),
            beacons=node.take(keys.BEACON),
            commands=[command for command, _ in node.take(keys.COMMAND)],
            lifeline_cut=lifeline.cut(),
            tick=ticker.report,
            bad_payloads=node.bad_payloads,
        )
        actions = agent.step(now, inbox)
        link.pursue(actions.goal, now)
        _publish(node, actions)
        if actions.status is not None:
            status = actions.status
            lifeline.tell(ALIVE)
        if actions.ended is not None:
            return actions.ended, status


def _publish(node: Node, actions: Actions) -> None:
    if actions.state is not None:
        node.send(keys.STATE, actions.state)
    if actions.clock is not None:
        node.send(keys.CLOCK, actions.clock)
    for ack in actions.acks:
        node.send(keys.ACK, ack)
    for event in actions.events:
        node.send(keys.EVENT, event)
    if actions.sigma is not None:
        node.send(keys.SIGMA, actions.sigma)
    if actions.status is not None:
        node.send(keys.STATUS, actions.status)
