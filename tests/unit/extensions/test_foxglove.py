"""The server for Foxglove: where it can't start it says why, and no client holds up a write."""

from __future__ import annotations

import json
import socket
import time
from types import SimpleNamespace

import pytest

from swarm_ctl.errors import InputError, StartError
from swarm_ctl.station.foxglove.desk import FIGURES
from tests.unit.station.swarm import hexagon_plan

pytest.importorskip("foxglove", reason="the extra `foxglove` is not installed")

from swarm_ctl.extensions import foxglove as foxglove_server
from swarm_ctl.extensions.foxglove import FoxgloveServer

pytestmark = pytest.mark.realtime

PLAN = hexagon_plan()
HELLO = (
    "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
)
MASK = bytes(4)
_TEXT = json.dumps(
    {"op": "subscribe", "subscriptions": [{"id": k, "channelId": k} for k in range(1, 1500)]}
).encode()
SUBSCRIBE = bytes([0x81, 0xFE]) + len(_TEXT).to_bytes(2, "big") + MASK + _TEXT
"""A client's frame: to all channels that there may be."""
PATIENCE_S = 60.0
"""For the server to take the subscription, on a busy machine."""


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def server_on(port: int) -> FoxgloveServer:
    return FoxgloveServer(str(port), SimpleNamespace(plan=PLAN))


def _read_to_the_end(client: socket.socket) -> None:
    while client.recv(65536):
        pass


def test_a_port_that_is_taken_is_named() -> None:
    """The first server has it; the error says which, and what to do."""
    port = free_port()
    first = server_on(port)
    with pytest.raises(StartError, match=f"foxglove: 127.0.0.1:{port}: .*name another port"):
        server_on(port)
    first.close()


@pytest.mark.parametrize("argument", ["x", "0", "70000", "8765 "])
def test_what_is_no_port_is_refused(argument: str) -> None:
    with pytest.raises(InputError, match="allowed: a port, 1 to 65535"):
        FoxgloveServer(argument, SimpleNamespace(plan=PLAN))


def test_a_client_that_does_not_read_holds_up_no_write() -> None:
    """It subscribes and reads no more; 200 MB are written all the same, in less than 5 s."""
    server = server_on(port := free_port())
    with socket.create_connection(("127.0.0.1", port)) as client:
        client.sendall(HELLO.encode())
        assert client.recv(20).startswith(b"HTTP/1.1 101")
        until, channel = time.monotonic() + PATIENCE_S, server._channels["swarm", None]
        while not channel.has_sinks() and time.monotonic() < until:
            # once more: before the server has told its channels, it knows none to subscribe to
            client.sendall(SUBSCRIBE)
            time.sleep(0.2)
        assert channel.has_sinks()  # it has subscribed
        began, data = time.monotonic(), b'{"x":"' + bytes(100_000) + b'"}'
        for k in range(2000):
            server.write(FIGURES, None, 10**18 + k, 10**18 + k, data)
        assert time.monotonic() - began < 5.0
    server.close()


def test_a_client_that_only_reads_is_not_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """A browser sends nothing once it has subscribed. It stays for several times what is waited
    for a client that takes nothing, and then gets what is written."""
    monkeypatch.setattr(foxglove_server, "SEND_WALL_S", 0.2)
    server = server_on(port := free_port())
    with socket.create_connection(("127.0.0.1", port)) as client:
        client.sendall(HELLO.encode())
        assert client.recv(20).startswith(b"HTTP/1.1 101")
        client.sendall(SUBSCRIBE)
        client.settimeout(1.0)
        with pytest.raises(TimeoutError):  # nothing comes any more, not even the end
            _read_to_the_end(client)
        server.write(FIGURES, None, 10**18, 10**18, b"{}")  # with the time, which is for all
        client.settimeout(PATIENCE_S)
        assert client.recv(65536)
    server.close()
