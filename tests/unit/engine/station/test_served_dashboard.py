"""The dashboard for browsers: who gets one, and that its process ends with its visitor."""

from __future__ import annotations

import contextlib
import http.client
import shlex
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from swarm_ctl.cli.shared.options import without
from swarm_ctl.engine.launch.ports import free_ports

pytest.importorskip("textual_serve", reason="the extra `web` is not installed")
client = pytest.importorskip("websockets.sync.client", reason="websockets is not installed")
exceptions = pytest.importorskip("websockets.exceptions")

pytestmark = pytest.mark.realtime

PATIENCE_S = 30.0
APP = """
from textual.app import App
from textual.widgets import Static

class Shown(App):
    def compose(self):
        yield Static("a swarm")

    def on_key(self, event):
        self.query_one(Static).update(f"key {event.key}")

Shown().run()
"""
"""In the place of a visitor's station."""
SERVER = """
import sys
from swarm_ctl.engine.station.served_dashboard import DashboardServer

server = DashboardServer([], int(sys.argv[1]))
server.command = sys.argv[2]
print(server.link, flush=True)
server.serve()
"""


class Served:
    """A server in a process of its own."""

    def __init__(self, folder: Path) -> None:
        (self.port,) = free_ports(1, socket.SOCK_STREAM)
        app = folder / "app.py"
        app.write_text(APP)
        command = f"exec {shlex.join([sys.executable, str(app)])}"
        self.process = subprocess.Popen(
            [sys.executable, "-c", SERVER, str(self.port), command],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        self.link = self.process.stdout.readline().strip()
        self.path = self.link.removeprefix(f"http://127.0.0.1:{self.port}")
        until(lambda: self.get("/") == 404)

    def get(self, path: str, **headers: str) -> int:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        try:
            connection.request("GET", path, headers=headers)
            with connection.getresponse() as answer:
                answer.read()
                if answer.status == 200 and not path.endswith(".js"):
                    assert "default-src 'none'" in str(answer.headers["Content-Security-Policy"])
                return answer.status
        except ConnectionRefusedError:
            return 0
        finally:
            connection.close()

    def visit(self, **more: Any) -> Any:
        address = f"ws://127.0.0.1:{self.port}{self.path}ws?width=40&height=5"
        return client.connect(address, proxy=None, **more)

    def visitors(self) -> list[str]:
        """The processes of those that are there."""
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        return children.read_text().split()


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    made = Served(tmp_path)
    try:
        yield made
    finally:
        made.process.kill()
        made.process.wait()
        assert made.process.stdout is not None
        made.process.stdout.close()


def until(what: Callable[[], Any]) -> None:
    limit = time.monotonic() + PATIENCE_S
    while not what():
        assert time.monotonic() < limit
        time.sleep(0.05)


def read_until(visit: Any, words: bytes) -> None:
    found = b""
    while words not in found:
        data = visit.recv(timeout=PATIENCE_S)
        found += data if isinstance(data, bytes) else data.encode()


def test_only_its_link_opens_it(served: Served) -> None:
    """No page of another site gets a station, nor one whose name was made to mean this machine,
    not even with the link."""
    assert served.get(served.path) == 200
    assert served.get(f"{served.path}static/js/textual.js") == 200
    for path in ("/", "/ws", "/static/js/textual.js", "/AAAAAAAAAAAAAAAAAAAAAA/"):
        assert served.get(path) == 404
    for headers in ({"Host": "swarm.example"}, {"Origin": "https://elsewhere.example"}):
        assert served.get(served.path, **headers) == 403
    for origin in ("https://elsewhere.example", "null"):
        with pytest.raises(exceptions.InvalidStatus) as caught, served.visit(origin=origin):
            pass
        assert caught.value.response.status_code == 403
    assert served.visitors() == []


def test_a_visitor_has_a_process_that_ends_with_the_visit(served: Served) -> None:
    with served.visit() as visit:
        read_until(visit, b"a swarm")
        assert len(served.visitors()) == 1
        visit.send('["stdin", "x"]')
        read_until(visit, b"key x")
    until(lambda: not served.visitors())


def test_a_signal_ends_it_and_its_visitors(served: Served) -> None:
    with served.visit() as visit:
        read_until(visit, b"a swarm")
        (visitor,) = served.visitors()
        served.process.send_signal(signal.SIGINT)
        assert served.process.wait(PATIENCE_S) == 0
        until(lambda: not Path(f"/proc/{visitor}").exists())
        with pytest.raises(exceptions.ConnectionClosed):
            read_until(visit, b"never")


def test_more_visitors_than_it_has_room_for_are_turned_away(served: Served) -> None:
    with contextlib.ExitStack() as visits:
        for _ in range(4):
            visits.enter_context(served.visit())
        with pytest.raises(exceptions.InvalidStatus) as caught, served.visit():
            pass
        assert caught.value.response.status_code == 503
    until(lambda: not served.visitors())


@pytest.mark.parametrize(
    ("typed", "left"),
    [
        (["hexagon", "--web-dashboard"], ["hexagon"]),
        (["--web-dashboard", "hexagon"], ["hexagon"]),
        (["--web-dashboard", "8702", "hexagon"], ["hexagon"]),
        (["--mission", "a b.yaml", "--web-dashboard=8702"], ["--mission", "a b.yaml"]),
    ],
)
def test_a_visitors_station_has_the_same_arguments(typed: list[str], left: list[str]) -> None:
    assert without(typed, "--web-dashboard") == left
