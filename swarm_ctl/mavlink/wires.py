"""Carry the bytes of a vehicle's link: UDP, TCP, a serial port, or memory.

pymavlink's `mavutil` has such connections, too, but costs twice the memory of a dialect alone,
blocks while it connects, and hides socket errors. Endpoints are spelled as there (serial ports get
the prefix `serial:`).
"""

from __future__ import annotations

import contextlib
import importlib
import socket
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from swarm_ctl.core.model.fleet import plain_endpoint
from swarm_ctl.errors import LinkError

ALLOWED = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT, serial:DEVICE[:BAUD]"

_CHUNK = 4096
"""Longer than a datagram of MAVLink frames (280 bytes each, a few in one)."""
_RECONNECT_S = 1.0
_TCP_SEND_BUFFER = 4096
"""Small: a setpoint that waits in the kernel's buffer would arrive after the vehicle's time-out."""
_DEFAULT_BAUD = 57600
"""The default of telemetry radios."""
_FIRST_PORT, _PORTS = 10000, 3000
"""Local ports of `udpout`: away from those of autopilots and ground stations (14000 and up)."""


class NameUnknownYetError(LinkError):
    """The resolver can't tell the host's address for now: a container engine's while containers
    start."""


class Wire(Protocol):
    """Non-blocking bytes both ways. `now` is the caller's clock [s]; errors are OSError."""

    warning: str = ""
    """What the operator should know of this wire, or ''."""
    port: int = 0
    """The own UDP port, where the wire has one from the start."""
    sources: int = 1
    """Senders whose chunks must not be mixed, at most."""
    source: int = 0
    """Which of them sent the last chunk."""

    def read(self, now: float) -> bytes | None:
        """The next pending chunk (a datagram, or a part of a stream), None when none is pending."""

    def write(self, data: bytes, now: float) -> None:
        """Send a frame now, or drop it: no frame is kept to be sent later."""

    def confirm(self) -> None:
        """The last chunk came from the vehicle: send to its sender. For wires with a choice."""
        return

    def close(self) -> None:
        """Idempotent."""
        return


class MemoryWire(Wire):
    """One end of an in-memory wire, for tests on a virtual clock; keeps the newest chunks."""

    def __init__(self, inbox: deque[bytes], outbox: deque[bytes]) -> None:
        self._inbox = inbox
        self._outbox = outbox

    def read(self, now: float = 0.0) -> bytes | None:  # noqa: ARG002
        return self._inbox.popleft() if self._inbox else None

    def write(self, data: bytes, now: float = 0.0) -> None:  # noqa: ARG002
        self._outbox.append(data)


def memory_wires(limit: int = 4096) -> tuple[MemoryWire, MemoryWire]:
    """Both ends of a wire in memory; each direction keeps the newest `limit` chunks."""
    one, two = deque[bytes](maxlen=limit), deque[bytes](maxlen=limit)
    return MemoryWire(one, two), MemoryWire(two, one)


def open_wire(endpoint: str) -> Wire:
    """Open `endpoint`; LinkError for a wrong spelling, or when the machine refuses it.

    Blocks while a name is looked up; NameUnknownYetError where that may work later.
    """
    scheme, _, rest = plain_endpoint(endpoint).partition(":")
    try:
        if scheme == "serial" and rest:
            return _SerialWire(*_device_and_baud(rest))
        if scheme not in _SCHEMES:
            raise LinkError(f"endpoint {endpoint!r} has no known scheme; allowed: {ALLOWED}")
        return _SCHEMES[scheme](_address(endpoint, rest))
    except OSError as error:
        later = isinstance(error, socket.gaierror) and error.errno == socket.EAI_AGAIN
        kind = NameUnknownYetError if later else LinkError
        raise kind(f"endpoint {endpoint}: can't be opened: {error}") from error


def _address(endpoint: str, rest: str) -> tuple[str, int]:
    host, _, port = rest.rpartition(":")
    if not host or not port.isdecimal() or not 1 <= int(port) <= 65535:
        raise LinkError(
            f"endpoint {endpoint!r} has no HOST:PORT; allowed: {ALLOWED}, PORT 1..65535"
        )
    return socket.gethostbyname(host), int(port)


def local_port(address: tuple[str, int]) -> int:
    """The port from which a `udpout` wire talks to `address` (IPv4). Neighbouring ports of a host,
    and neighbouring hosts, get different ones."""
    host = int.from_bytes(socket.inet_aton(address[0]), "big")
    return _FIRST_PORT + (host + address[1]) % _PORTS


def _device_and_baud(rest: str) -> tuple[str, int]:
    device, _, baud = rest.rpartition(":")
    return (device, int(baud)) if device and baud.isdecimal() else (rest, _DEFAULT_BAUD)


class _UdpWire(Wire):
    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._sender: Any = None

    def read(self, now: float) -> bytes | None:  # noqa: ARG002
        try:
            data, self._sender = self._socket.recvfrom(_CHUNK)
        except BlockingIOError:
            return None
        return data

    def close(self) -> None:
        self._socket.close()


class _UdpOutWire(_UdpWire):
    """A connected socket: the kernel drops the datagrams of other senders, and reports an endpoint
    where no process listens.

    Its own port is the same whenever it talks to `address`: a PX4 answers the port of its first
    partner until it reboots.
    """

    def __init__(self, address: tuple[str, int]) -> None:
        super().__init__()
        port = local_port(address)
        with _closing_on_error(self._socket):
            try:
                self._socket.bind(("", port))
            except OSError as error:
                self.warning = (
                    f"UDP port {port} can't be used ({error.strerror}; does another process speak"
                    " to this vehicle?): a PX4 that has heard from it answers no other port"
                )
            self._socket.connect(address)
        self.port = self._socket.getsockname()[1]

    def write(self, data: bytes, now: float) -> None:  # noqa: ARG002
        self._socket.send(data)


class _UdpInWire(_UdpWire):
    """Listens, and sends to the address from which the vehicle was heard last, none before."""

    def __init__(self, address: tuple[str, int]) -> None:
        super().__init__()
        self._vehicle: Any = None
        with _closing_on_error(self._socket):
            self._socket.bind(address)

    def write(self, data: bytes, now: float) -> None:  # noqa: ARG002
        if self._vehicle is not None:
            self._socket.sendto(data, self._vehicle)

    def confirm(self) -> None:
        self._vehicle = self._sender


class _Stream:
    """One TCP connection. A frame is sent whole or not at all; an error ends it."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _TCP_SEND_BUFFER)
        self.connection = connection
        self.ended = False
        self._unsent = b""

    def read(self) -> bytes | None:
        with self._ended_on_error():
            try:
                data = self.connection.recv(_CHUNK)
            except BlockingIOError:
                return None
        if not data:
            self.close()
        return data or None

    def write(self, data: bytes) -> None:
        with self._ended_on_error():
            if self._unsent:
                self._unsent = self._unsent[self.connection.send(self._unsent) :]
            if self._unsent:
                raise BlockingIOError("the stream is full; a frame was dropped")
            self._unsent = data[self.connection.send(data) :]

    def close(self) -> None:
        self.ended = True
        self.connection.close()

    @contextlib.contextmanager
    def _ended_on_error(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if not isinstance(error, BlockingIOError):
                self.close()
            raise


class _TcpWire(Wire):
    """A client that connects without blocking, and tries again every second."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._address = address
        self._retry_s = float("-inf")
        self._stream: _Stream | None = None

    def _connected(self, now: float) -> _Stream | None:
        if (self._stream is None or self._stream.ended) and now >= self._retry_s:
            self._retry_s = now + _RECONNECT_S
            self._stream = _Stream(socket.socket(socket.AF_INET, socket.SOCK_STREAM))
            self._stream.connection.connect_ex(self._address)
        return None if self._stream is None or self._stream.ended else self._stream

    def read(self, now: float) -> bytes | None:
        stream = self._connected(now)
        return None if stream is None else stream.read()

    def write(self, data: bytes, now: float) -> None:
        stream = self._connected(now)
        if stream is not None:
            stream.write(data)

    def close(self) -> None:
        if self._stream is not None:
            self._stream.close()


class _TcpInWire(Wire):
    """A server for one vehicle. The client that a frame of the vehicle came from last has the link
    (`confirm`): one that is silent, or a stranger, takes it from no vehicle. Before the first such
    frame, the newest client is spoken to."""

    sources = 4

    def __init__(self, address: tuple[str, int]) -> None:
        self._server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._server.setblocking(False)
        with _closing_on_error(self._server):
            self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._server.bind(address)
            self._server.listen(self.sources)
        self._streams: list[_Stream | None] = [None] * self.sources
        self._order: list[int] = []
        """Places of the streams, the newest client last."""
        self._vehicle: _Stream | None = None

    def read(self, now: float) -> bytes | None:  # noqa: ARG002
        self._accept()
        for step in range(1, self.sources + 1):
            place = (self.source + step) % self.sources
            stream = self._streams[place]
            if stream is None or stream.ended:
                continue
            with contextlib.suppress(OSError):  # that client has gone
                if data := stream.read():
                    self.source = place
                    return data
        return None

    def _accept(self) -> None:
        """A client, in the place of the oldest one that does not have the link."""
        try:
            connection, _ = self._server.accept()
        except OSError:
            return
        place = self._free_place()
        old = self._streams[place]
        if old is not None:
            old.close()
        self._streams[place] = _Stream(connection)
        self._order = [*(each for each in self._order if each != place), place]

    def _free_place(self) -> int:
        for place, stream in enumerate(self._streams):
            if stream is None or stream.ended:
                return place
        return next(place for place in self._order if self._streams[place] is not self._vehicle)

    def confirm(self) -> None:
        stream = self._streams[self.source]
        if stream is not self._vehicle and self._vehicle is not None:
            self._vehicle.close()
        self._vehicle = stream

    def write(self, data: bytes, now: float) -> None:  # noqa: ARG002
        stream = self._vehicle
        if stream is None and self._order:
            stream = self._streams[self._order[-1]]
        if stream is not None and not stream.ended:
            stream.write(data)

    def close(self) -> None:
        for stream in self._streams:
            if stream is not None:
                stream.close()
        self._server.close()


class _SerialWire(Wire):
    """A serial port (needs the package pyserial)."""

    def __init__(self, device: str, baud: int) -> None:
        try:
            serial = importlib.import_module("serial")
        except ImportError as error:
            allowed = "pip install 'swarm-ctl[serial]'"
            raise LinkError(f"serial:{device} needs the package pyserial: {allowed}") from error
        self._port = serial.Serial(device, baud, timeout=0, write_timeout=0)

    def read(self, now: float) -> bytes | None:  # noqa: ARG002
        data: bytes = self._port.read(_CHUNK)
        return data or None

    def write(self, data: bytes, now: float) -> None:  # noqa: ARG002
        self._port.write(data)

    def close(self) -> None:
        self._port.close()


@contextlib.contextmanager
def _closing_on_error(owned: socket.socket) -> Iterator[None]:
    try:
        yield
    except OSError:
        owned.close()
        raise


_SCHEMES: dict[str, Callable[[tuple[str, int]], Wire]] = {
    "udpin": _UdpInWire,
    "udpout": _UdpOutWire,
    "tcp": _TcpWire,
    "tcpin": _TcpInWire,
}
