"""Endpoints on the loopback: each kind in both directions, peers that vanish, and what is
refused."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarm_ctl.core.model.vehicle import FlyGoal, StandbyGoal
from swarm_ctl.errors import LinkError
from swarm_ctl.mavlink import wires
from swarm_ctl.mavlink.link import VehicleLink
from swarm_ctl.mavlink.wires import Stream, Wire, local_port, memory_wires, open_wire
from tests.unit.mavlink import wire
from tests.unit.mavlink.test_framer import BANNER

HOST = "127.0.0.1"


@pytest.fixture
def udp() -> Iterator[socket.socket]:
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as made:
        made.bind((HOST, 0))
        made.settimeout(5.0)
        yield made


@pytest.fixture
def server() -> Iterator[socket.socket]:
    with contextlib.closing(socket.create_server((HOST, 0))) as made:
        made.settimeout(5.0)
        yield made


def free_port(kind: socket.SocketKind) -> int:
    with contextlib.closing(socket.socket(socket.AF_INET, kind)) as probe:
        probe.bind((HOST, 0))
        port: int = probe.getsockname()[1]
        return port


def wait_readable(opened: socket.socket | int) -> None:
    """Until the kernel has something for it: loopback delivery is not instantaneous for streams."""
    assert select.select([opened], [], [], 5.0)[0]


def frame_from(sysid: int = 7) -> bytes:
    return wire.Vehicle(memory_wires()[0], sysid).bytes_of(wire.heartbeat())


# --- refused ---


@pytest.mark.parametrize(
    "endpoint",
    [
        "",
        "14601",
        "http://127.0.0.1",
        "udpout:",
        "udpout:127.0.0.1",
        "udpout:127.0.0.1:0",
        "udpin:127.0.0.1:65536",
        "tcp:127.0.0.1:x",
        "tcpin::5760",
        "serial:",
    ],
)
def test_what_is_no_endpoint_is_refused_with_what_is_allowed(endpoint: str) -> None:
    with pytest.raises(LinkError, match="allowed: udpin:HOST:PORT, udpout:HOST:PORT, tcp:") as none:
        open_wire(endpoint)
    assert none.value.exit_code == 2  # bad input: the machine was not asked


def test_a_busy_port_is_refused_by_name(udp: socket.socket) -> None:
    endpoint = f"udpin:{HOST}:{udp.getsockname()[1]}"
    with pytest.raises(LinkError, match=endpoint):
        open_wire(endpoint)


def test_a_resolver_that_fails_for_now_is_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    def answer(_host: str) -> str:
        raise socket.gaierror(socket.EAI_AGAIN, "Temporary failure in name resolution")

    monkeypatch.setattr(socket, "gethostbyname", answer)
    words = r"udpout:vehicle-3:9: can't be opened: .*Temporary"
    with pytest.raises(wires.NameUnknownYetError, match=words):
        open_wire("udpout:vehicle-3:9")


# --- udp ---


def test_udpout_speaks_from_the_same_port_again(udp: socket.socket) -> None:
    """A PX4 answers the port of its first partner until it reboots."""
    endpoint, heard_from = f"udpout:{HOST}:{udp.getsockname()[1]}", set()
    for _ in range(3):
        with contextlib.closing(open_wire(endpoint)) as opened:
            assert opened.warning == ""
            opened.write(b"hello", 0.0)
            heard_from.add(udp.recvfrom(100)[1])
    assert heard_from == {(HOST, local_port(udp.getsockname()))}


def test_a_second_process_gets_another_port_and_a_warning(udp: socket.socket) -> None:
    endpoint = f"udpout:{HOST}:{udp.getsockname()[1]}"
    with contextlib.closing(open_wire(endpoint)) as first:
        with contextlib.closing(VehicleLink(endpoint, "px4", 7)) as link:
            (text,) = link.view().texts
            assert f"UDP port {local_port(udp.getsockname())} can't be used" in text
            link.pursue(StandbyGoal(), 0.0)
            other = udp.recvfrom(4096)[1]
        first.write(b"hello", 0.0)
        assert udp.recvfrom(100)[1] != other


def test_a_udp_port_where_no_process_listens_is_counted_and_healed() -> None:
    port = free_port(socket.SOCK_DGRAM)
    with contextlib.closing(VehicleLink(f"udpout:{HOST}:{port}", "ardupilot", 7)) as link:
        for tick in range(5):
            link.pursue(StandbyGoal(), float(tick))
            link.receive(float(tick))
        assert link.counters.errors >= 4
        with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as late:
            late.bind((HOST, port))
            late.settimeout(5.0)
            link.pursue(StandbyGoal(), 5.0)
            link.pursue(StandbyGoal(), 6.0)  # the first may still have met the last refusal
            assert late.recv(4096)[0] == 0xFD


def test_udpout_hears_its_own_endpoint_alone(udp: socket.socket) -> None:
    with contextlib.closing(open_wire(f"udpout:{HOST}:{udp.getsockname()[1]}")) as opened:
        opened.write(b"hello", 0.0)
        _, address = udp.recvfrom(100)
        with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as stranger:
            stranger.sendto(b"stranger", address)
        udp.sendto(b"vehicle", address)
        wait_readable(opened._socket)  # type: ignore[attr-defined]
        assert opened.read(0.0) == b"vehicle"


def test_udpin_is_silent_until_it_heard_its_vehicle_and_answers_it_alone(
    udp: socket.socket,
) -> None:
    port = free_port(socket.SOCK_DGRAM)
    with (
        contextlib.closing(VehicleLink(f"udpin:{HOST}:{port}", "ardupilot", 7)) as link,
        contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as stranger,
    ):
        stranger.settimeout(0.0)
        stranger.bind((HOST, 0))
        stranger.sendto(frame_from(8), (HOST, port))
        udp.sendto(frame_from(7), (HOST, port))
        stranger.sendto(b"noise", (HOST, port))
        wait_readable(link._wire._socket)  # type: ignore[attr-defined]
        link.receive(1.0)
        link.pursue(StandbyGoal(), 1.0)
        assert udp.recv(4096)[0] == 0xFD
        with pytest.raises(BlockingIOError):
            stranger.recv(4096)
        assert link.counters.foreign == 1


# --- tcp ---


def test_tcp_survives_text_between_frames_and_a_server_that_goes_and_comes(
    server: socket.socket,
) -> None:
    port = server.getsockname()[1]
    with contextlib.closing(VehicleLink(f"tcp:{HOST}:{port}", "ardupilot", 7)) as link:
        link.receive(0.0)
        with contextlib.closing(server.accept()[0]) as peer:
            peer.sendall(BANNER + frame_from() + b"more text\n" + frame_from())
            wait_readable(link._wire._stream.connection)  # type: ignore[attr-defined]
            link.receive(0.1)
            assert link.view().heartbeat_s == 0.1
            link.pursue(StandbyGoal(), 0.2)
            assert peer.recv(4096)[0] == 0xFD
        wait_readable(link._wire._stream.connection)  # type: ignore[attr-defined]
        link.receive(0.3)  # sees the end
        link.receive(0.4)
        link.receive(1.5)  # a second after the first attempt: again
        with contextlib.closing(server.accept()[0]) as peer:
            peer.sendall(frame_from())
            wait_readable(link._wire._stream.connection)  # type: ignore[attr-defined]
            link.receive(2.0)
            assert link.view().heartbeat_s == 2.0


class Narrow:
    """A stream that takes only so many bytes before it is full."""

    def __init__(self, room: int) -> None:
        self.room, self.taken = room, b""

    def send(self, data: bytes) -> int:
        if data and not self.room:
            raise BlockingIOError
        took = data[: self.room]
        self.room -= len(took)
        self.taken += took
        return len(took)

    def setblocking(self, _: bool) -> None:
        pass

    def setsockopt(self, *_: int) -> None:
        pass


def test_a_frame_that_went_out_in_part_is_finished_before_another_begins() -> None:
    stream = Narrow(room=4)
    opened = Stream(stream)  # type: ignore[arg-type]
    opened.write(b"first!")
    for _ in range(3):
        with pytest.raises(BlockingIOError):
            opened.write(b"dropped")
    stream.room = 1
    with pytest.raises(BlockingIOError):
        opened.write(b"dropped")
    stream.room = 100
    opened.write(b"second")
    assert stream.taken == b"first!second"


@contextlib.contextmanager
def tcpin() -> Iterator[tuple[Wire, int]]:
    port = free_port(socket.SOCK_STREAM)
    with contextlib.closing(open_wire(f"tcpin:{HOST}:{port}")) as opened:
        yield opened, port


def read_soon(wire: Wire, now: float = 0.0) -> bytes:
    """The next chunk, which is on its way."""
    until = time.monotonic() + 5.0
    while (chunk := wire.read(now)) is None:
        assert time.monotonic() < until
        time.sleep(0.001)
    return chunk


def test_tcpin_speaks_to_the_newest_client_until_the_vehicle_was_heard() -> None:
    with tcpin() as (opened, port):
        assert opened.read(0.0) is None
        opened.write(b"into the void", 0.0)
        for name in (b"first", b"second"):
            with contextlib.closing(socket.create_connection((HOST, port), timeout=5.0)) as client:
                client.sendall(name)
                assert read_soon(opened) == name
                opened.write(b"hello", 0.0)
                assert client.recv(100) == b"hello"


def test_a_client_takes_the_link_of_a_vehicle_only_by_a_frame_of_the_vehicle() -> None:
    """500 silent or strange clients leave the vehicle its link; its own new connection gets it."""
    with tcpin() as (opened, port), contextlib.ExitStack() as stack:
        vehicle = stack.enter_context(socket.create_connection((HOST, port), timeout=5.0))
        vehicle.sendall(b"good")
        assert read_soon(opened) == b"good"
        opened.confirm()
        for number in range(500):
            with contextlib.closing(socket.create_connection((HOST, port))) as stranger:
                if number % 2:
                    stranger.sendall(b"noise")
                opened.read(0.0)
        opened.write(b"setpoint", 0.0)
        assert vehicle.recv(100) == b"setpoint"
        again = stack.enter_context(socket.create_connection((HOST, port), timeout=5.0))
        again.sendall(b"good")
        while read_soon(opened, 1.0) != b"good":
            pass
        opened.confirm()
        opened.write(b"setpoint", 0.0)
        assert (again.recv(100), vehicle.recv(100)) == (b"setpoint", b"")


# --- serial ---


def test_serial_without_pyserial_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(LinkError, match=r"pip install 'swarm-ctl\[serial\]'"):
        open_wire("serial:/dev/ttyACM0:57600")


def test_a_serial_port_carries_frames() -> None:
    pytest.importorskip("serial", reason="pyserial is not installed")
    master, slave = pty.openpty()
    try:
        with contextlib.closing(
            VehicleLink(f"serial:{os.ttyname(slave)}:57600", "ardupilot", 7)
        ) as link:
            os.write(master, frame_from())
            wait_readable(slave)
            link.receive(1.0)
            assert link.view().heartbeat_s == 1.0
            link.pursue(FlyGoal((0.0, 0.0, 0.0)), 1.0)
            assert os.read(master, 1)[0] == 0xFD
    finally:
        os.close(master)
        os.close(slave)


# --- each opens again by itself ---


class Pluggable:
    """A serial port with a name that stays, as /dev/serial/by-id has them; the vehicle's end."""

    def __init__(self, name: Path) -> None:
        self.name = name
        self.master = self.slave = -1

    def plug_in(self) -> None:
        self.master, self.slave = pty.openpty()
        self.name.unlink(missing_ok=True)
        self.name.symlink_to(os.ttyname(self.slave))

    def pull_out(self) -> None:
        """The name goes, and what was open hangs up."""
        self.name.unlink()
        os.close(self.slave)
        os.close(self.master)


def hear(link: VehicleLink, now: float) -> float:
    """When the link heard the vehicle last, by then."""
    time.sleep(0.02)
    link.receive(now)
    return link.view().heartbeat_s


def test_a_serial_port_that_comes_back_is_opened_again_by_its_name(tmp_path: Path) -> None:
    """It was never opened again; 0.5 s of gap in flight ended the flight."""
    pytest.importorskip("serial", reason="pyserial is not installed")
    port = Pluggable(tmp_path / "vehicle")
    port.plug_in()
    with contextlib.closing(VehicleLink(f"serial:{port.name}:57600", "ardupilot", 7)) as link:
        os.write(port.master, frame_from())
        assert hear(link, 1.0) == 1.0
        for gap in (1, 2):
            port.pull_out()
            for tick in range(10):
                link.receive(gap * 10 + tick * 0.05)
                link.pursue(FlyGoal((0.0, 0.0, 0.0)), gap * 10 + tick * 0.05)
            (text,) = link.view().texts
            assert f"serial port {port.name} is gone" in text
            port.plug_in()
            link.receive(gap * 10 + 0.75)
            os.write(port.master, frame_from())
            assert hear(link, gap * 10 + 0.8) == gap * 10 + 0.8
            link.pursue(FlyGoal((0.0, 0.0, 0.0)), gap * 10 + 1.5)  # a heartbeat is due
            wait_readable(port.master)
            assert os.read(port.master, 1)[0] == 0xFD
    port.pull_out()


def test_a_vehicle_whose_serial_port_stays_away_says_why_it_is_not_ready(tmp_path: Path) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed")
    port = Pluggable(tmp_path / "vehicle")
    port.plug_in()
    with contextlib.closing(VehicleLink(f"serial:{port.name}:57600", "ardupilot", 7)) as link:
        port.pull_out()
        for now in (0.0, 1.0, 2.0):
            link.receive(now)
        assert f"serial port {port.name} is gone" in link.view().health_reason


def test_a_serial_port_that_takes_nothing_never_holds_the_loop_up(tmp_path: Path) -> None:
    """pyserial's own write turns in a circle until there is room."""
    pytest.importorskip("serial", reason="pyserial is not installed")
    port = Pluggable(tmp_path / "vehicle")
    port.plug_in()
    with contextlib.closing(open_wire(f"serial:{port.name}:57600")) as opened:
        begun, dropped = time.monotonic(), 0
        for _ in range(2000):
            try:
                opened.write(bytes(200), 0.0)
            except BlockingIOError:
                dropped += 1
        assert dropped > 1000
        assert time.monotonic() - begun < 5.0
    port.pull_out()


@pytest.mark.skipif(not hasattr(socket, "TCP_USER_TIMEOUT"), reason="Linux alone")
@pytest.mark.parametrize("scheme", ["tcp", "tcpin"])
def test_a_tcp_host_that_acknowledges_nothing_is_left_after_three_seconds(scheme: str) -> None:
    """It has lost its power or its network. By itself the system waits for a quarter of an hour,
    with the agent's newest setpoints behind the oldest; the kernel is told, for both ends."""
    with contextlib.ExitStack() as stack:
        if scheme == "tcp":
            server = stack.enter_context(contextlib.closing(socket.create_server((HOST, 0))))
            port = server.getsockname()[1]
            opened = stack.enter_context(contextlib.closing(open_wire(f"tcp:{HOST}:{port}")))
            opened.read(0.0)
            stream = opened._stream  # type: ignore[attr-defined]
        else:
            opened, port = stack.enter_context(tcpin())
            client = stack.enter_context(socket.create_connection((HOST, port), timeout=5.0))
            client.sendall(b"here")
            assert read_soon(opened) == b"here"
            stream = opened._streams[opened.source]  # type: ignore[attr-defined]
        told_ms = stream.connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT)
        assert told_ms == 3000


def test_a_tcp_host_that_does_not_answer_is_asked_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """By itself the system asks ever more seldom, and the vehicle is back long before."""
    tries: list[object] = []

    class Silent(socket.socket):
        def connect_ex(self, address: object) -> int:
            tries.append(address)
            return 115  # in progress, for ever

    monkeypatch.setattr(socket, "socket", Silent)
    with contextlib.closing(open_wire("tcp:127.0.0.1:9")) as opened:
        for tick in range(120):
            with contextlib.suppress(OSError):
                opened.read(tick * 0.1)
    assert 3 <= len(tries) <= 12


def test_udpout_gets_a_new_socket_where_the_computers_address_has_gone(udp: socket.socket) -> None:
    class Lost:
        """Linux: a socket that is bound to an address which the computer has no more."""

        def __init__(self, inner: socket.socket) -> None:
            self.close = inner.close

        def send(self, _: bytes) -> int:
            raise OSError(22, "Invalid argument")

    with contextlib.closing(open_wire(f"udpout:{HOST}:{udp.getsockname()[1]}")) as opened:
        opened._socket = Lost(opened._socket)  # type: ignore[attr-defined]
        for now in (0.0, 0.5):
            with pytest.raises(OSError, match="Invalid"):
                opened.write(b"hello", now)
        opened.write(b"hello", 1.1)
        assert udp.recv(100) == b"hello"


def test_a_stranger_takes_a_vehicle_from_no_address_where_it_is_heard(udp: socket.socket) -> None:
    """On an open link a frame that says the vehicle's id turned all setpoints away."""
    port = free_port(socket.SOCK_DGRAM)
    with (
        contextlib.closing(VehicleLink(f"udpin:{HOST}:{port}", "ardupilot", 7)) as link,
        contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as stranger,
    ):
        stranger.settimeout(0.0)
        stranger.bind((HOST, 0))
        udp.sendto(frame_from(7), (HOST, port))
        assert hear(link, 1.0) == 1.0
        stranger.sendto(frame_from(7), (HOST, port))
        assert hear(link, 1.2) == 1.2
        link.pursue(StandbyGoal(), 1.2)
        assert udp.recv(4096)[0] == 0xFD
        with pytest.raises(BlockingIOError):
            stranger.recv(4096)


# --- several vehicles behind one port ---


@pytest.mark.parametrize("scheme", ["udpin", "tcpin"])
def test_each_vehicle_behind_one_port_gets_its_own_frames(scheme: str) -> None:
    """The link answered whoever spoke last: 939 of 1,126 frames went to a wrong vehicle."""
    kind = socket.SOCK_DGRAM if scheme == "udpin" else socket.SOCK_STREAM
    port = free_port(kind)
    with contextlib.ExitStack() as stack:
        opened = stack.enter_context(contextlib.closing(open_wire(f"{scheme}:{HOST}:{port}")))
        vehicles = {}
        for system in range(1, 7):
            made = stack.enter_context(socket.socket(socket.AF_INET, kind))
            made.connect((HOST, port))
            made.settimeout(5.0)
            made.send(bytes([system]))
            assert read_soon(opened) == bytes([system])
            opened.confirm(system)
            vehicles[system] = made
        for system in (3, 1, 6, 2, 5, 4):
            opened.write(bytes([100 + system]), 0.0, system)
        assert {s: v.recv(100) for s, v in vehicles.items()} == {
            s: bytes([100 + s]) for s in vehicles
        }


def test_a_tcp_vehicle_that_connects_again_is_found_among_the_others() -> None:
    with tcpin() as (opened, port), contextlib.ExitStack() as stack:

        def connect(system: int, now: float) -> socket.socket:
            made = stack.enter_context(socket.create_connection((HOST, port), timeout=5.0))
            made.send(bytes([system]))
            while read_soon(opened, now) != bytes([system]):
                pass
            opened.confirm(system)
            return made

        first, second = connect(1, 0.0), connect(2, 0.0)
        first.close()
        time.sleep(0.02)
        opened.read(0.1)
        first = connect(1, 0.2)
        opened.write(b"one", 0.2, 1)
        opened.write(b"two", 0.2, 2)
        assert (first.recv(100), second.recv(100)) == (b"one", b"two")
