"""From a receiver on a socket to words on the mesh."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.target.teller import Source, Told, open_source, tell
from swarm_ctl.errors import InputError, LinkError
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryHub, MemoryTransport
from swarm_ctl.mesh.node import Node
from tests.unit.engine.target.test_receivers import RMC

BOUND_S = 20.0


def source(spelled: str, **more: object) -> Source:
    given = {"late_s": 0.2, "system": 0, "icao": 0, "faster": 1.0} | more
    return open_source("boat", spelled, **given)  # type: ignore[arg-type]


class Receiver:
    """On a loopback port; each client gets the lines, one every 50 ms, and is then hung up on."""

    def __init__(self, *lines: bytes) -> None:
        self._lines, self._ends = lines, threading.Event()
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(0.05)
        self.spelled = f"tcp:127.0.0.1:{self._server.getsockname()[1]}"
        self.clients = 0
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        while not self._ends.is_set():
            with contextlib.suppress(TimeoutError, ConnectionError):
                client, _ = self._server.accept()
                self.clients += 1
                with client:
                    for line in self._lines:
                        client.sendall(line)
                        self._ends.wait(0.05)

    def close(self) -> None:
        self._ends.set()
        self._thread.join()
        self._server.close()


@contextlib.contextmanager
def receiver(*lines: bytes) -> Iterator[Receiver]:
    served = Receiver(*lines)
    try:
        yield served
    finally:
        served.close()


def told_by(news: Source, enough: int) -> tuple[Told, int]:
    """What was told at the end, and the words that a member of the mesh heard."""
    mesh, shown, began_s = MemoryHub(wall.wall_s), list[Told](), wall.wall_s()
    hears = Node(MemoryTransport(mesh), "lake", 1)
    hears.listen(keys.SIGHTING)
    heard = []

    def over() -> bool:
        heard.extend(hears.take(keys.SIGHTING))
        return len(heard) >= enough or wall.wall_s() - began_s > BOUND_S

    told = tell(Node(MemoryTransport(mesh), "lake", "target.1"), news, shown.append, over)
    news.close()
    assert all(word.station == "target.1" for word, _ in heard)
    assert shown
    return told, len(heard)


def test_a_receiver_is_told_and_tried_again_when_it_hangs_up() -> None:
    """It hangs up after three sentences; ten words need several calls."""
    with receiver(RMC, RMC, RMC) as served:
        told, heard = told_by(source(f"nmea:{served.spelled}"), 10)
    assert heard >= 10
    assert told.words == heard
    assert served.clients > 2


def test_a_source_that_is_not_there_is_said_to_be() -> None:
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
    news, began_s = source(f"gpsd:127.0.0.1:{port}"), wall.wall_s()
    node = Node(MemoryTransport(MemoryHub(wall.wall_s)), "lake", "target.1")
    told = tell(node, news, lambda _: None, lambda: wall.wall_s() - began_s > 1.0)
    news.close()
    assert told.words == 0
    assert "refused" in told.why


def test_a_track_is_played_to_its_end(tmp_path: Path) -> None:
    track = tmp_path / "t.csv"
    track.write_text("time,lat,lon\n0,47,8\n100,47.01,8\n")
    told, heard = told_by(source(str(track), faster=100.0), 1000)
    assert told.over
    assert heard == told.words >= 4


_NONE = ["", "boat", "nmea:", "gpsd:", "track.txt", "tcp:127.0.0.1:5"]
_NO_PORT = ["gpsd:127.0.0.1", "nmea:tcp:127.0.0.1", "mavlink:foo:1"]


@pytest.mark.parametrize("spelled", [*_NONE, *_NO_PORT])
def test_what_is_no_source_is_refused_with_what_is(spelled: str) -> None:
    with pytest.raises(InputError, match=f"^'{spelled}' is no source; allowed: nmea:ENDPOINT"):
        source(spelled)


@pytest.mark.parametrize("spelled", ["mavlink:udpin:192.0.2.1:9", "nmea:serial:/dev/no"])
def test_an_endpoint_that_cannot_be_opened_is_named(spelled: str) -> None:
    with pytest.raises(LinkError, match="endpoint"):
        source(spelled)
