"""The process that opens a radio, and passes the frames of the vehicles behind it to their agents.

It is a single point of failure: when it ends, the vehicles' own failsafes act.
"""

from __future__ import annotations

import math
import os
import socket
import sys
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from swarm_ctl.core.model.fleet import FleetAgent
from swarm_ctl.core.swarm.radio import budget
from swarm_ctl.engine.clock import pause, wall_s
from swarm_ctl.engine.lifeline import ALIVE, READY, Lifeline
from swarm_ctl.engine.radio.load import RadioLoad
from swarm_ctl.engine.radio.switch import RadioRoute, Switch
from swarm_ctl.errors import LinkError
from swarm_ctl.mavlink.wire import SILENT_S, Wire
from swarm_ctl.mavlink.wires import open_wire

HOST: Final = "127.0.0.1"
NOBODY: Final = -1
"""The user of a socket that exists no more."""
_CHUNK: Final = 4096
_TABLE: Final = Path("/proc/net/udp")
_KNOWN_S: Final = 1.0
"""For so long the user of a socket stays known: another program may take its port."""
_LOOKS_PER_S: Final = 50
"""At most: a flood from ever new ports must not take the link's time."""
_SAID_AGAIN_S: Final = 10.0

Address = tuple[str, int]


def owners(table: str) -> dict[int, set[int]]:
    """The users of the sockets in a table like /proc/net/udp that may speak from the loopback
    interface, by port."""
    found: dict[int, set[int]] = {}
    for line in table.splitlines()[1:]:
        fields = line.split()
        host, _, port = fields[1].partition(":")
        if host in ("0100007F", "00000000"):
            found.setdefault(int(port, 16), set()).add(int(fields[7]))
    return found


def _table() -> str:
    return _TABLE.read_text()


class AgentPort(Wire):
    """The UDP socket that one agent speaks to. LinkError where the port is taken.

    Any program of the machine may write to it, and what it writes goes to a vehicle. So a sender
    counts only where its socket belongs to the user of the link, or to root (Linux tells that of
    each UDP socket), and only while no other one speaks as the agent.

    `read` gives b"" for a datagram of a stranger. `table`: of all UDP sockets; an OSError of it
    (no Linux): the users are not known, and who spoke as the agent first has the port.
    """

    def __init__(self, agent: int, port: int, table: Callable[[], str] = _table) -> None:
        self._agent, self._own, self._table = agent, port, table
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((HOST, port))
        except OSError as error:
            self._socket.close()
            raise LinkError(f"agent {agent}'s port {port} at the link: {error}") from error
        self._sender: Address | None = None
        self._partner: Address | None = None
        self._heard_s = -math.inf
        self._now = 0.0
        self._known: dict[Address, tuple[str, float]] = {}
        self._looks, self._looks_since_s = 0, -math.inf
        self._news: list[str] = []
        self._said_s = -math.inf

    def read(self, now: float) -> bytes | None:
        self._now = now
        try:
            data, self._sender = self._socket.recvfrom(_CHUNK)
        except BlockingIOError:
            return None
        why = self._stranger(self._sender)
        if not why and self._taken(self._sender):
            partner = self._partner or ("", 0)
            why = f"the agent speaks from {partner[0]}:{partner[1]}"
        if why:
            self._tell(f"{self._sender[0]}:{self._sender[1]} is not heard: {why}")
            return b""
        return data

    def write(self, data: bytes, now: float, system: int = 0) -> None:  # noqa: ARG002
        if self._partner is not None:
            self._socket.sendto(data, self._partner)

    def confirm(self, system: int = 0, *, proven: bool = False) -> None:  # noqa: ARG002
        """The last chunk came from the agent."""
        if self._sender is None or self._taken(self._sender):
            return
        before, self._partner, self._heard_s = self._partner, self._sender, self._now
        if before is not None and before != self._partner:
            new = f"{self._partner[0]}:{self._partner[1]}"
            self._tell(f"the agent speaks from {new} now; before, from {before[0]}:{before[1]}")

    def news(self) -> list[str]:
        """What the operator should know since the last call."""
        news, self._news = self._news, []
        return news

    def close(self) -> None:
        self._socket.close()

    def _taken(self, sender: Address) -> bool:
        """Another one is the agent, and speaks."""
        speaks = self._now - self._heard_s < SILENT_S
        return self._partner is not None and sender != self._partner and speaks

    def _stranger(self, sender: Address) -> str:
        """Why this sender can't be the agent, or ''."""
        why, since_s = self._known.get(sender, ("", -math.inf))
        if self._now - since_s < _KNOWN_S:
            return why
        if self._now - self._looks_since_s >= 1.0:
            self._looks, self._looks_since_s = 0, self._now
            self._known = {a: k for a, k in self._known.items() if self._now - k[1] < _KNOWN_S}
        if self._looks >= _LOOKS_PER_S:
            return why if sender == self._partner else "too many speak to this port"
        self._looks += 1
        why = self._user_of(sender)
        self._known[sender] = why, self._now
        return why

    def _user_of(self, sender: Address) -> str:
        try:
            found = owners(self._table())
        except (OSError, ValueError, IndexError):
            return ""
        if self._own not in found:
            return ""  # a table without the own socket tells nothing
        users, mine = found.get(sender[1], {NOBODY}), os.getuid()
        strangers = users - {mine, 0}
        if not strangers:
            return ""
        if strangers == {NOBODY}:
            return "its socket is closed already"
        return f"it is user {max(strangers)}'s; allowed: user {mine}, as the link's, and root"

    def _tell(self, words: str) -> None:
        if self._now - self._said_s >= _SAID_AGAIN_S:
            self._said_s = self._now
            self._news.append(f"agent {self._agent}'s port {self._own}: {words}")


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
