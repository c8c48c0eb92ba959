"""The ports that a station serves: pages of other sites are turned away, and no client holds up
another one."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator

import pytest

from swarm_ctl.engine import local_server
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.engine.local_server import HOST, LocalServer, answer, refusal
from swarm_ctl.errors import StartError

pytestmark = pytest.mark.realtime


@pytest.fixture
def port() -> Iterator[int]:
    """Of a server that says hello."""
    (free,) = free_ports(1, socket.SOCK_STREAM)
    server = LocalServer("hello", free, lambda client, _: answer(client, "200 OK", b"hello"))
    yield free
    server.close()
    server.close()


def asked(port: int, *fields: str, wait_s: float = 10.0) -> bytes:
    """The whole answer to a request with these fields; b"" where the client is turned away."""
    with socket.create_connection((HOST, port), wait_s) as client:
        try:
            client.sendall("\r\n".join(("GET / HTTP/1.1", *fields, "", "")).encode())
            got = b""
            while data := client.recv(4096):
                got += data
        except ConnectionError:
            return b""
        return got


@pytest.mark.parametrize(
    ("fields", "status"),
    [
        (("Host: 127.0.0.1:9100",), b"200"),
        (("host: LOCALHOST",), b"200"),
        (("Host: [::1]:9100", "Origin: http://localhost:8080"), b"200"),
        ((), b"200"),
        (("Host: evil.example",), b"403"),
        (("Host: 127.0.0.1.evil.example",), b"403"),
        (("Host: localhost", "Host: evil.example"), b"403"),
        (("Host: localhost", "Origin: https://evil.example"), b"403"),
        (("Host: localhost", "ORIGIN: http://localhost.evil.example"), b"403"),
        (("Host: localhost", "Origin: null"), b"403"),
        (("Host: localhost", "Origin: http://localhost", "Origin: http://evil.example"), b"403"),
    ],
)
def test_a_page_of_another_site_gets_nothing(
    port: int, fields: tuple[str, ...], status: bytes
) -> None:
    """By its Origin, or by the name under which it asks."""
    got = asked(port, *fields)
    assert got.startswith(b"HTTP/1.1 " + status)
    assert (b"hello" in got) == (status == b"200")


@pytest.mark.parametrize(
    ("origin", "may"),
    [
        ("https://app.foxglove.dev", True),
        ("https://foxglove.dev", True),
        ("file://", True),
        ("https://named.example", True),
        ("http://app.foxglove.dev", False),
        ("https://app.foxglove.dev.evil.example", False),
        ("https://evilfoxglove.dev", False),
        ("null", False),
        ("", False),
    ],
)
def test_foxgloves_own_pages_may_ask(
    origin: str, may: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And those that the user names."""
    pytest.importorskip("foxglove", reason="the extra `foxglove` is not installed")
    from swarm_ctl.extensions.foxglove import ORIGINS, _may_ask

    monkeypatch.setenv(ORIGINS, "https://named.example,null")
    head = f"GET / HTTP/1.1\r\nHost: localhost\r\nOrigin: {origin}\r\n\r\n".encode()
    assert (refusal(head, _may_ask) == "") == may


def test_silent_clients_go_and_make_room(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sixteen that say nothing keep a seventeenth out for a moment, not for good."""
    monkeypatch.setattr(local_server, "_HEAD_WALL_S", 0.5)
    silent = [socket.create_connection((HOST, port)) for _ in range(16)]
    until = time.monotonic() + 20.0
    while not asked(port, "Host: localhost") and time.monotonic() < until:
        time.sleep(0.05)
    assert asked(port, "Host: localhost").startswith(b"HTTP/1.1 200")
    for client in silent:
        client.settimeout(5.0)
        assert client.recv(1) == b""
        client.close()


def test_a_client_that_says_too_much_is_turned_away(port: int) -> None:
    """A head without an end."""
    assert asked(port, "X: " + "x" * 100_000) == b""


def test_an_error_in_an_answer_costs_that_answer_alone() -> None:
    """The next client is served."""
    (free,) = free_ports(1, socket.SOCK_STREAM)
    calls = threading.Semaphore(1)

    def serve(client: socket.socket, _: bytes) -> None:
        if calls.acquire(blocking=False):
            raise IndexError("tuple index out of range")
        answer(client, "200 OK", b"hello")

    server = LocalServer("hello", free, serve)
    assert asked(free, "Host: localhost") == b""
    assert b"hello" in asked(free, "Host: localhost")
    server.close()


def test_a_taken_port_is_named(port: int) -> None:
    with pytest.raises(StartError, match=f"it: 127.0.0.1:{port}: .*; name another port"):
        LocalServer("it", port, lambda *_: None)
