"""An agent's end of a link that it shares with ground control software: bounded, and it never
waits."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Iterator

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.vehicle import StandbyGoal
from swarm_ctl.errors import LinkError
from swarm_ctl.mavlink.link import VehicleLink
from swarm_ctl.mavlink.mirror import FRAMES_A_TICK, Mirror
from swarm_ctl.mavlink.signing import LinkSigning
from swarm_ctl.mavlink.wires import memory_wires
from tests.unit.mavlink import wire

SECRET = bytes(range(16))


@pytest.fixture
def relay() -> Iterator[socket.socket]:
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as found:
        found.bind(("127.0.0.1", 0))
        found.setblocking(False)
        yield found


@pytest.fixture
def mirror(relay: socket.socket) -> Iterator[Mirror]:
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with contextlib.closing(Mirror(port, SECRET)) as found:
        relay.connect(("127.0.0.1", port))
        yield found


FRAME = b"\xfd" + bytes(20)


def test_frames_go_to_the_relay_once_it_has_greeted(mirror: Mirror, relay: socket.socket) -> None:
    mirror.keep(FRAME)
    assert mirror.exchange() == []
    relay.send(SECRET)
    assert mirror.exchange() == []
    for _ in range(3):
        mirror.keep(FRAME)
    mirror.exchange()
    assert relay.recv(4096) == 3 * FRAME


def test_a_flood_costs_a_tick_a_few_frames_alone(mirror: Mirror, relay: socket.socket) -> None:
    relay.send(SECRET)
    mirror.exchange()
    for _ in range(500):
        relay.send(FRAME)
    assert len(mirror.exchange()) == FRAMES_A_TICK
    started = time.perf_counter()
    for _ in range(20):
        mirror.exchange()
    assert (time.perf_counter() - started) / 20 < 0.005  # a tenth of a tick, on a busy machine


def test_only_frames_and_only_those_of_the_relay_pass(mirror: Mirror, relay: socket.socket) -> None:
    relay.send(SECRET)
    mirror.exchange()
    for data in (b"", b"no frame", b"\xfd" + bytes(400), FRAME):
        relay.send(data)
    assert mirror.exchange() == [FRAME]
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as stranger:
        stranger.sendto(FRAME, relay.getpeername())
        assert mirror.exchange() == []


def test_a_taken_port_is_named(relay: socket.socket) -> None:
    port = relay.getsockname()[1]
    with pytest.raises(LinkError, match=f"port {port} for ground control software"):
        Mirror(port, SECRET)


def test_a_link_shares_what_its_vehicle_sends_and_passes_on_what_comes_back(
    mirror: Mirror, relay: socket.socket
) -> None:
    ours, theirs = memory_wires()
    link, vehicle = VehicleLink(ours, "ardupilot", 1, mirror=mirror), wire.Vehicle(theirs)
    relay.send(SECRET)
    link.share(0.0)
    vehicle.say(wire.heartbeat())
    link.receive(0.1)
    link.pursue(StandbyGoal(), 0.1)
    relay.send(FRAME)
    link.share(0.1)
    assert relay.recv(4096)[0] == 0xFD
    chunks = []
    while (chunk := theirs.read()) is not None:
        chunks.append(chunk)
    assert chunks[-1] == FRAME  # behind all that the agent itself had to send
    assert len(chunks) > 1
    link.close()


def test_a_signed_link_passes_on_signed_and_new_frames_alone(
    mirror: Mirror, relay: socket.socket
) -> None:
    """An ArduPilot on USB would obey the others, too."""
    key = bytes(range(32))
    ours, theirs = memory_wires()
    link = VehicleLink(ours, "ardupilot", 1, mirror=mirror, signing=LinkSigning(key, 10**12))
    codec = dialect.MAVLink(None, 255, 190)
    codec.signing.secret_key, codec.signing.sign_outgoing = key, True
    codec.signing.timestamp = 10**12
    signed = bytes(wire.heartbeat().pack(codec))
    unsigned = bytes(wire.heartbeat().pack(dialect.MAVLink(None, 255, 190)))
    for frame in (SECRET, FRAME, unsigned, unsigned + signed, signed, signed):
        relay.send(frame)
        link.share(0.0)
    assert list(iter(theirs.read, None)) == [signed]
    assert link.counters.refused == 3
    link.close()


def test_who_speaks_first_is_not_the_relay(mirror: Mirror, relay: socket.socket) -> None:
    """Another program of the machine hears nothing, moves nothing, and keeps the relay's place
    from nobody."""
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as stranger:
        stranger.settimeout(0.2)
        for data in (b"", FRAME, bytes(16), SECRET[:-1]):
            stranger.sendto(data, relay.getpeername())
        assert mirror.exchange() == []
        mirror.keep(FRAME)
        mirror.exchange()
        with pytest.raises(TimeoutError):
            stranger.recv(4096)
    relay.send(SECRET)
    relay.send(FRAME)
    assert mirror.exchange() == [FRAME]
    mirror.keep(FRAME)
    mirror.exchange()
    assert relay.recv(4096) == FRAME
