"""The process that opens a radio, and passes the frames of the vehicles behind it to their agents.

It is a single point of failure: when it ends, the vehicles' own failsafes act.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

from swarm_ctl.core.model.fleet import FleetAgent
from swarm_ctl.core.swarm.radio import budget
from swarm_ctl.engine.clock import pause, wall_s
from swarm_ctl.engine.forked import serve_forked
from swarm_ctl.engine.lifeline import ALIVE, READY, Lifeline
from swarm_ctl.engine.radio.agent_port import AgentPort
from swarm_ctl.engine.radio.load import RadioLoad
from swarm_ctl.engine.radio.switch import RadioRoute, Switch
from swarm_ctl.errors import LinkError
from swarm_ctl.mavlink.wires import open_wire

_TURN_WALL_S: Final = 0.005
"""A tenth of a tick: so much later is a setpoint."""
_SHOW_WALL_S: Final = 0.5
_LINGER_WALL_S: Final = 1.6
"""After the lifeline's end and the last word of an agent, which has a heartbeat each second: until
then it lands its vehicle."""


@dataclass(frozen=True, slots=True)
class LinkConfig:
    """All the link's process is told."""

    agents: tuple[FleetAgent, ...]
    """All have the same radio."""
    signed: bool = False
    bytes_per_s: int | None = None
    """What the radio carries; None: as the fleet says."""
    log: Path | None = None
    """Where stdout and stderr go; None: they stay."""

    @property
    def radio(self) -> str:
        """The radio's endpoint."""
        return self.agents[0].reached_at or ""


def child_main(config: LinkConfig, connection: Connection) -> None:
    """Entry of the link that `run` forks."""
    serve_forked(lambda lifeline: run_link(config, lifeline), config.log, connection)


def run_link(
    config: LinkConfig, lifeline: Lifeline, show: Callable[[RadioLoad], None] = lambda _: None
) -> int:
    """Pass frames until the lifeline is cut and no agent has spoken for a while; the exit code.

    LinkError where the radio or an agent's port can't be opened.
    """
    with ExitStack() as opened:
        share = config.agents[0].radio
        if share is None:
            raise LinkError(f"agent {config.agents[0].id} shares no radio")
        radio = opened.enter_context(closing(open_wire(share.endpoint)))
        ports = [_port(agent, opened) for agent in config.agents]
        routes = [_route(a, port, config) for a, port in zip(config.agents, ports, strict=True)]
        switch = Switch(radio, routes, share.endpoint, config.bytes_per_s or share.bytes_per_s)
        lifeline.tell(READY)
        show_s = spoke_s = wall_s()
        trouble = ""
        while not lifeline.cut() or wall_s() < spoke_s + _LINGER_WALL_S:
            now = wall_s()
            switch.turn(now)
            if switch.trouble != trouble:
                trouble = switch.trouble
                lifeline.tell(f"{share.endpoint}: {trouble or 'works again'}")
            for word in (word for port in ports for word in port.news()):
                lifeline.tell(word)
            if now >= show_s:
                show_s = now + _SHOW_WALL_S
                load = switch.load(now)
                if any(vehicle.up_frames_per_s for vehicle in load.vehicles):
                    spoke_s = now
                lifeline.tell(ALIVE)
                show(load)
            pause(_TURN_WALL_S)
    return 0


def _port(agent: FleetAgent, opened: ExitStack) -> AgentPort:
    if agent.endpoint is None:
        raise LinkError(f"agent {agent.id} shares no radio")
    port = int(agent.endpoint.rpartition(":")[2])
    return opened.enter_context(closing(AgentPort(agent.id, port)))


def _route(agent: FleetAgent, port: AgentPort, config: LinkConfig) -> RadioRoute:
    if agent.radio is None:
        raise LinkError(f"agent {agent.id} shares no radio")
    return RadioRoute(agent, port, budget(agent.radio, agent.autopilot, signed=config.signed).hz)


def told(text: str) -> None:
    """Say it on the terminal."""
    if text not in (READY, ALIVE):
        sys.stderr.write(f"link: {text}\n")
