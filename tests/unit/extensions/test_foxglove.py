"""The server for Foxglove: where it can't start it says why, and no client holds up a write."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable

import pytest

from swarm_ctl import installed
from swarm_ctl.cli.shared import options
from swarm_ctl.errors import StartError
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


def _read_to_the_end(client: socket.socket) -> None:
    while client.recv(65536):
        pass


def test_a_port_that_is_taken_is_named() -> None:
    """The first server has it; the error says which, and what to do."""
    port = free_port()
    first = FoxgloveServer(port, PLAN)
    with pytest.raises(StartError, match=f"foxglove: 127.0.0.1:{port}: .*name another port"):
        FoxgloveServer(port, PLAN)
    first.close()


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """--foxglove without its package: which one, and how to install it."""
    monkeypatch.setattr(installed, "packages", lambda extra: [f"no-such-{extra}"])
    with pytest.raises(StartError, match=r"--foxglove needs no-such-foxglove.*swarm-ctl\[foxglove"):
        options.served(None, 8765)
    assert options.served(9100, None).metrics == 9100


def test_a_client_that_does_not_read_holds_up_no_write() -> None:
    """It subscribes and reads no more; 200 MB are written all the same, in less than 5 s."""
    server = FoxgloveServer(port := free_port(), PLAN)
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
    server = FoxgloveServer(port := free_port(), PLAN)
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


def test_the_server_may_be_ended_by_two_threads_while_a_third_one_writes() -> None:
    """The SDK alone says "Already borrowed" to one of them."""
    for _ in range(5):
        server, errors = FoxgloveServer(free_port(), PLAN), list[BaseException]()
        over = threading.Event()

        def guarded(call: Callable[[], None], errors: list[BaseException] = errors) -> None:
            try:
                call()
            except BaseException as error:
                errors.append(error)

        def write(server: FoxgloveServer = server, over: threading.Event = over) -> None:
            now_ns = 10**18
            while not over.is_set():
                now_ns += 10**9
                server.write(FIGURES, None, now_ns, now_ns, b"{}")

        calls = [write, server.close, server.close]
        threads = [threading.Thread(target=guarded, args=(call,)) for call in calls]
        threads[0].start()
        time.sleep(0.02)
        for thread in threads[1:]:
            thread.start()
        for thread in threads[1:]:
            thread.join()
        over.set()
        threads[0].join()
        assert errors == []
