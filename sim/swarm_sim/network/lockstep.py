"""Lockstep: a keeper of mission time grants this simulator tick after tick, over a socket that
keeps packets apart. Both ends count datagrams by the clients' UDP ports, so that a tick has exactly
those of the tick before.

The words (little-endian): JOIN 1 and WELCOME 2 with JSON, READY 3, TICK 4 (tick, messages to hear,
anew, agents that take part, a list's length, the list, then port and count of each client), DONE 5
(tick, last, a list's length, then port and count of each client), WAIT 6.
"""

from __future__ import annotations

import json
import select
import socket
import struct
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

_JOIN, _WELCOME, _READY, _TICK, _DONE, _NOTE = 1, 2, 3, 4, 5, 7
_TICK_HEAD = struct.Struct("<BII?HH")
_LISTED = 5
_DONE_HEAD = struct.Struct("<BI?H")
_PORT = struct.Struct("<HI")
_LONGEST = 1 << 16
_SILENT_WALL_S = 20.0
"""The keeper speaks every second; after so long it is given up, by all members at once."""


class KeeperGoneError(Exception):
    """The keeper has ended, or hangs."""


@dataclass(frozen=True, slots=True)
class TickWord:
    """The world up to this tick is to be done."""

    number: int
    anew: bool
    """What was counted before is void."""
    agents: int
    """Clients that take part."""
    datagrams: Mapping[int, int]
    """So many were sent from each client's port in the tick before."""


class Barrier:
    """The line to the keeper at `address` (of Linux's abstract name space)."""

    def __init__(self, address: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._silent_s = 0.0
        self.sent: Counter[int] = Counter()
        """Datagrams of this tick by client's port."""
        self._tick = 0
        try:
            self._socket.connect("\0" + address)
            about = {"name": "simulator", "phase": 0, "port": 0}
            self._socket.send(bytes([_JOIN]) + json.dumps(about).encode())
            data = self._receive(10.0)
        except (OSError, KeeperGoneError) as error:
            self._socket.close()
            raise ConnectionError(f"the run's clock does not answer: {error}") from None
        self.tick_s: float = json.loads(data[1:])["tick_s"]
        self._send(bytes([_READY]))

    def wait(self, wall_s: float) -> TickWord | None:
        """The next tick; None: not yet. KeeperGoneError at its end, or when it is silent."""
        data = self._receive(wall_s)
        if not data or data[0] != _TICK:
            return None
        _, number, _, anew, agents, listed = _TICK_HEAD.unpack_from(data)
        ports = data[_TICK_HEAD.size + listed * _LISTED :]
        self._tick = number
        return TickWord(number, anew, agents, dict(_PORT.iter_unpack(ports)))

    def done(self, *, last: bool) -> None:
        """The tick is done; `last`: the simulator ends."""
        ports = b"".join([_PORT.pack(*item) for item in self.sent.items()])
        self.sent.clear()
        self._send(_DONE_HEAD.pack(_DONE, self._tick, last, 0) + ports)

    def note(self, text: str) -> None:
        """A line for the operator."""
        self._send(bytes([_NOTE]) + text.encode())

    def close(self) -> None:
        self._socket.close()

    def _receive(self, wall_s: float) -> bytes:
        if not select.select([self._socket], [], [], wall_s)[0]:
            self._silent_s += wall_s
            if self._silent_s >= _SILENT_WALL_S:
                raise KeeperGoneError("it is silent")
            return b""
        self._silent_s = 0.0
        try:
            data = self._socket.recv(_LONGEST)
        except OSError:
            data = b""
        if not data:
            raise KeeperGoneError("it has ended")
        return data

    def _send(self, data: bytes) -> None:
        try:
            self._socket.send(data)
        except OSError as error:
            raise KeeperGoneError(str(error)) from None
