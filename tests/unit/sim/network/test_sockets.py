"""Sockets of a vehicle: TCP clients come and go, UDP may speak first; streams cut anywhere lose
nothing."""

from __future__ import annotations

import contextlib
import select
import socket
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_sim.network.codec import Codec, split_stream
from swarm_sim.network.sockets import TcpSocket, UdpSocket, VehicleSocket, open_socket
from tests.unit.sim.test_codec import GOOD


@pytest.fixture
def server() -> Iterator[tuple[TcpSocket, int]]:
    port = TcpSocket(("127.0.0.1", 0))
    with contextlib.closing(port):
        yield port, port._listener.getsockname()[1]


def take(port: VehicleSocket) -> bytes:
    """What is there, once something is."""
    readable, _, _ = select.select([port], [], [], 10.0)
    assert readable
    return b"".join(data for data, _ in port.receive())


def test_a_tcp_client_is_a_peer_at_once_and_gets_what_is_sent(
    server: tuple[TcpSocket, int],
) -> None:
    port, number = server
    with socket.create_connection(("127.0.0.1", number)) as client:
        assert take(port) == b""
        assert port.peers() == [client.getsockname()]
        port.send(b"hello", client.getsockname())
        assert client.recv(99) == b"hello"
        client.sendall(GOOD + GOOD[:10])
        assert take(port) == GOOD
        client.sendall(GOOD[10:])
        assert take(port) == GOOD
    assert take(port) == b""
    assert port.peers() == []


def test_a_tcp_client_that_does_not_read_loses_and_blocks_no_other(
    server: tuple[TcpSocket, int],
) -> None:
    port, number = server
    with socket.create_connection(("127.0.0.1", number)) as client:
        take(port)
        for _ in range(2000):
            port.send(bytes(5000), client.getsockname())
        assert port.unsent > 0


def test_a_reset_connection_is_forgotten(server: tuple[TcpSocket, int]) -> None:
    port, number = server
    client = socket.create_connection(("127.0.0.1", number))
    take(port)
    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
    client.close()
    take(port)
    assert port.peers() == []
    port.send(b"x", ("127.0.0.1", 1))
    assert port.unsent == 1


def test_udpout_speaks_first() -> None:
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as station:
        station.bind(("127.0.0.1", 0))
        where = station.getsockname()
        port = open_socket(f"udpout:127.0.0.1:{where[1]}")
        with contextlib.closing(port):
            assert port.peers() == [where]
            port.send(b"hello", where)
            data, sender = station.recvfrom(99)
            assert data == b"hello"
            station.sendto(b"answer", sender)
            assert take(port) == b"answer"


@given(data=st.data())
def test_a_stream_cut_anywhere_gives_all_its_frames(data: st.DataObject) -> None:
    text = data.draw(st.binary(max_size=20).filter(lambda b: not {0xFD, 0xFE} & set(b)))
    stream = text + GOOD * 3
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=6)))
    codec, kept, found = Codec(1), b"", 0
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        whole, kept = split_stream(kept + stream[start:end])
        found += len(list(codec.messages(whole)))
    assert (found, kept) == (3, b"")


def test_silent_connections_take_no_place_from_one_that_speaks(
    server: tuple[TcpSocket, int],
) -> None:
    port, number = server
    with contextlib.ExitStack() as opened:
        agent = opened.enter_context(socket.create_connection(("127.0.0.1", number)))
        for _ in range(100):
            opened.enter_context(socket.create_connection(("127.0.0.1", number)))
            agent.sendall(GOOD)
            list(port.receive())
        assert len(port.peers()) <= 32
        assert agent.getsockname() in port.peers()


def test_one_that_speaks_first_is_reached_on_the_network_of_its_peer_alone() -> None:
    with contextlib.closing(open_socket("udpout:127.0.0.2:14550")) as opened:
        assert isinstance(opened, UdpSocket)
        assert opened._socket.getsockname()[0] == "127.0.0.1"
