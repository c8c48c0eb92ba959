"""A websocket client as Foxglove is one: by its protocol, and by nothing of ours
(https://github.com/foxglove/ws-protocol)."""

from __future__ import annotations

import json
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, Self

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

PROTOCOL = Subprotocol("foxglove.sdk.v1")
_MESSAGE = struct.Struct("<BIQ")
_DATA = 1
_LISTENS = "0A"


class FoxgloveClient:
    """Connects when the server is there, subscribes to all channels, keeps what comes."""

    def __init__(self, port: int, patience_s: float = 60.0) -> None:
        self._opened = ExitStack()
        self._socket = self._opened.enter_context(_connected(port, patience_s))
        self.listening = _listening(port)
        """The addresses at which the server does."""
        self.protocol = self._socket.subprotocol
        self.info: dict[str, Any] = {}
        self.channels: dict[int, dict[str, Any]] = {}
        self.messages: dict[str, list[tuple[int, bytes]]] = {}
        """(log time [ns], data) by topic."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._opened.close()

    def listen(self, enough: Callable[[], bool], seconds: float = 60.0) -> bool:
        """Take messages until `enough`; False where the server closed first."""
        until = time.monotonic() + seconds
        while not enough():
            assert time.monotonic() < until, sorted(self.messages)
            try:
                self._take(self._socket.recv(timeout=seconds))
            except ConnectionClosed:
                return False
        return True

    def newest(self, topic: str) -> Any:
        """The newest message of a topic."""
        return json.loads(self.messages[topic][-1][1])

    def _take(self, received: str | bytes) -> None:
        if isinstance(received, bytes):
            if received[0] == _DATA:
                _, subscription, time_ns = _MESSAGE.unpack_from(received)
                topic = self.channels[subscription]["topic"]
                self.messages.setdefault(topic, []).append((time_ns, received[_MESSAGE.size :]))
            return
        said = json.loads(received)
        if said["op"] == "serverInfo":
            self.info = said
        elif said["op"] == "advertise":
            self.channels |= {channel["id"]: channel for channel in said["channels"]}
            wanted = [{"id": each["id"], "channelId": each["id"]} for each in said["channels"]]
            self._socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


@contextmanager
def _connected(port: int, patience_s: float) -> Iterator[ClientConnection]:
    url, until = f"ws://127.0.0.1:{port}", time.monotonic() + patience_s
    while True:
        with suppress(ConnectionRefusedError), socket.create_connection(("127.0.0.1", port)):
            break
        assert time.monotonic() < until, f"{url} does not answer"
        time.sleep(0.1)
    with connect(url, subprotocols=[PROTOCOL], max_size=None) as opened:
        yield opened


def _listening(port: int) -> set[str]:
    """By the kernel; an address of IPv6 as it has it."""
    found = set()
    for table in ("tcp", "tcp6"):
        for line in Path("/proc/net", table).read_text().splitlines()[1:]:
            address, _, at = line.split()[1].partition(":")
            if int(at, 16) == port and line.split()[3] == _LISTENS:
                packed = bytes.fromhex(address)[::-1]
                found.add(socket.inet_ntoa(packed) if table == "tcp" else address)
    return found
