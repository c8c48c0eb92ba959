"""An agent's port at the link: one agent is heard at it, of the link's own user.

Any program of the machine may write to the port, and what it writes goes to a vehicle. So a sender
counts only where its socket belongs to the user of the link, or to root (Linux tells that of each
UDP socket), and only while no other one speaks as the agent.
"""

from __future__ import annotations

import math
import os
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Final

from swarm_ctl.errors import LinkError
from swarm_ctl.mavlink.wire import SILENT_S, Wire

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
