"""Lockstep: a keeper of mission time grants this simulator tick after tick, over a socket that
keeps packets apart. Both ends count datagrams by the clients' UDP ports, so that a tick has exactly
those of the tick before.

A packet is a JSON object: `join` (answered with `tick_s`), then `tick` and `done` in turn, and
`note` for the operator; the keeper lives as long as it says anything.
"""

from __future__ import annotations

import json
import socket
import struct
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_LONGEST = 1 << 16
_WAIT_WALL_S, _SILENT_WALL_S = 1.0, 20.0
"""The keeper speaks every second; after so long it is given up, by all members at once."""


class KeeperGoneError(Exception):
    """The keeper has ended, or hangs."""


@dataclass(frozen=True, slots=True)
class TickWord:
    """The world up to this tick is to be done."""

    tick: int
    anew: bool
    """What was counted before is void."""
    agents: int
    """Clients that take part."""
    sent: Mapping[int, int]
    """So many datagrams were sent from each client's port in the tick before."""


class Barrier:
    """The line to the keeper at `address` (of Linux's abstract name space)."""

    def __init__(self, address: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        wait = struct.pack("@ll", int(_WAIT_WALL_S), 0)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, wait)
        self._silent_s = 0.0
        self.sent: Counter[int] = Counter()
        """Datagrams of this tick by client's port."""
        self._tick = 0
        about: dict[str, Any] = {}
        try:
            self._socket.connect("\0" + address)
            self._send(join="simulator", phase=0, port=0)
            while "tick_s" not in about:
                about = self._receive()
        except (OSError, KeeperGoneError) as error:
            self._socket.close()
            raise ConnectionError(f"the run's clock does not answer: {error}") from None
        self.tick_s: float = about["tick_s"]

    def wait(self) -> TickWord | None:
        """The next tick; None after a second without. KeeperGoneError at the keeper's end, or when
        it is silent."""
        word = self._receive()
        if "tick" not in word:
            return None
        self._tick = word["tick"]
        sent = {int(port): count for port, count in word["sent"].items()}
        return TickWord(word["tick"], word["anew"], word["agents"], sent)

    def done(self, *, last: bool) -> None:
        """The tick is done; `last`: the simulator ends."""
        self._send(done=self._tick, said={}, sent=self.sent, last=last)
        self.sent.clear()

    def note(self, text: str) -> None:
        """A line for the operator."""
        self._send(note=text)

    def close(self) -> None:
        self._socket.close()

    def _receive(self) -> dict[str, Any]:
        try:
            data = self._socket.recv(_LONGEST)
        except BlockingIOError:
            self._silent_s += _WAIT_WALL_S
            if self._silent_s >= _SILENT_WALL_S:
                raise KeeperGoneError("it is silent") from None
            return {}
        except OSError:
            data = b""
        if not data:
            raise KeeperGoneError("it has ended")
        self._silent_s = 0.0
        word: dict[str, Any] = json.loads(data)
        return word

    def _send(self, **word: Any) -> None:
        try:
            self._socket.send(json.dumps(word).encode())
        except OSError as error:
            raise KeeperGoneError(str(error)) from None
