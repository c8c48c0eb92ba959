"""Where one vehicle is reached: sockets that never wait and never raise in flight."""

from __future__ import annotations

import selectors
import socket
from collections.abc import Iterator
from dataclasses import dataclass, field

from swarm_sim.network.codec import split_stream

Address = tuple[str, int]
_BURST = 64
"""Datagrams taken at once, so that a flood of one vehicle's can't stop the others."""
_CHUNK = 4096
"""Of a longer datagram the rest is lost; a frame has 280 bytes."""
_CONNECTIONS = 32
"""Of one server; one more takes the place of the one silent the longest."""
_BACKLOG = 1 << 18
"""Bytes kept for a TCP client that doesn't read; more are lost, as on a radio."""


class UdpSocket:
    """UDP: bound to an address (`udpin`), or talking to one from the start (`udpout`).

    `receive` gives the whole frames that wait, with their sender. `send` never waits and never
    raises: what can't be sent is lost, as on a radio. `peers` are clients to serve before they
    speak. `unsent` counts packets the system had no room for.
    """

    def __init__(self, bind: Address, peer: Address | None = None) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setblocking(False)
            self._socket.bind(bind)
        except OSError:
            self._socket.close()
            raise
        self._peers = [] if peer is None else [peer]
        self.unsent = 0

    def fileno(self) -> int:
        return self._socket.fileno()

    def close(self) -> None:
        self._socket.close()

    def peers(self) -> list[Address]:
        return self._peers

    def receive(self) -> Iterator[tuple[bytes, Address]]:
        for _ in range(_BURST):
            try:
                yield self._socket.recvfrom(_CHUNK)
            except BlockingIOError:
                return
            except OSError:
                continue

    def send(self, data: bytes, to: Address) -> None:
        try:
            self._socket.sendto(data, to)
        except OSError:
            self.unsent += 1


@dataclass(slots=True)
class _Connection:
    socket: socket.socket
    received: bytes = b""
    waiting: bytearray = field(default_factory=bytearray)


class TcpSocket:
    """The same for a TCP server (`tcpin`); its clients hear the vehicle once they are connected."""

    def __init__(self, bind: Address) -> None:
        self._listener = socket.create_server(bind, backlog=16)
        self._listener.setblocking(False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ, None)
        self._connections: dict[Address, _Connection] = {}
        self.unsent = 0

    def fileno(self) -> int:
        """The selector's: one can wait for all its sockets at once."""
        return int(self._selector.fileno())

    def peers(self) -> list[Address]:
        return list(self._connections)

    def receive(self) -> Iterator[tuple[bytes, Address]]:
        for key, _ in self._selector.select(0):
            if key.data is None:
                self._accept()
            elif data := self._read(key.data):
                yield data, key.data

    def send(self, data: bytes, to: Address) -> None:
        connection = self._connections.get(to)
        if connection is None or len(connection.waiting) > _BACKLOG:
            self.unsent += 1
            return
        connection.waiting += data
        try:
            sent = connection.socket.send(connection.waiting)
            del connection.waiting[:sent]
        except BlockingIOError:
            return
        except OSError:
            self._drop(to)

    def close(self) -> None:
        for address in list(self._connections):
            self._drop(address)
        self._selector.close()
        self._listener.close()

    def _accept(self) -> None:
        try:
            connected, address = self._listener.accept()
        except OSError:
            return
        connected.setblocking(False)
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if len(self._connections) >= _CONNECTIONS:
            self._drop(next(iter(self._connections)))
        self._connections[address] = _Connection(connected)
        self._selector.register(connected, selectors.EVENT_READ, address)

    def _read(self, address: Address) -> bytes:
        connection = self._connections[address]
        try:
            data = connection.socket.recv(_CHUNK)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._drop(address)
            return b""
        self._connections[address] = self._connections.pop(address)  # heard last
        whole, connection.received = split_stream(connection.received + data)
        return whole

    def _drop(self, address: Address) -> None:
        connection = self._connections.pop(address, None)
        if connection is not None:
            self._selector.unregister(connection.socket)
            connection.socket.close()


VehicleSocket = UdpSocket | TcpSocket


def open_socket(endpoint: str) -> VehicleSocket:
    """The socket of `udpin:`, `udpout:` or `tcpin:` HOST:PORT; OSError where the system refuses.

    `udpout:HOST:PORT:OWN` sends from the port OWN.
    """
    kind, host, port, *own_port = endpoint.split(":")
    address = (host, int(port))
    if kind == "udpin":
        return UdpSocket(address)
    if kind == "tcpin":
        return TcpSocket(address)
    peer = (socket.gethostbyname(host), int(port))
    bind = (_way_to(peer), int(own_port[0]) if own_port else 0)
    return UdpSocket(bind, peer)


def _way_to(peer: Address) -> str:
    """The own address on the network of `peer`: computers of other networks don't reach the
    socket."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(peer)  # sends nothing
        return str(probe.getsockname()[0])
