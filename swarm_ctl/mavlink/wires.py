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


class Wire(Protocol):
    """Non-blocking bytes both ways. `now` is the caller's clock [s]; errors are OSError."""

    warning: str = ""
    """What the operator should know of this wire, or ''."""
    port: int = 0
    """The own UDP port, where the wire has one from the start."""

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
    """Open `endpoint`; LinkError for a wrong spelling, or when the machine refuses it."""
    scheme, _, rest = endpoint.partition(":")
    try:
        if scheme == "serial" and rest:
            return _SerialWire(*_device_and_baud(rest))
        if scheme not in _SCHEMES:
            raise LinkError(f"endpoint {endpoint!r} has no known scheme; allowed: {ALLOWED}")
        return _SCHEMES[scheme](_address(endpoint, rest))
    except OSError as error:
        raise LinkError(f"endpoint {endpoint}: can't be opened: {error}") from error


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


class _StreamWire(Wire):
    """One TCP stream at a time; a frame is sent whole or not at all."""

    def __init__(self) -> None:
        self._stream: socket.socket | None = None
        self._unsent = b""

    def _connected(self, now: float) -> socket.socket | None:
        """The stream, if there is one now."""
        raise NotImplementedError

    def read(self, now: float) -> bytes | None:
        stream = self._connected(now)
        if stream is None:
            return None
        with self._dropped_on_error():
            try:
                data = stream.recv(_CHUNK)
            except BlockingIOError:
                return None
        if not data:
            self._drop()
        return data or None

    def write(self, data: bytes, now: float) -> None:
        stream = self._connected(now)
        if stream is None:
            return
        with self._dropped_on_error():
            if self._unsent:
                self._unsent = self._unsent[stream.send(self._unsent) :]
            if self._unsent:
                raise BlockingIOError("the stream is full; a frame was dropped")
            self._unsent = data[stream.send(data) :]

    def close(self) -> None:
        self._drop()

    @contextlib.contextmanager
    def _dropped_on_error(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if not isinstance(error, BlockingIOError):
                self._drop()
            raise

    def _drop(self) -> None:
        if self._stream is not None:
            self._stream.close()
        self._stream = None
        self._unsent = b""

    def _adopt(self, stream: socket.socket) -> None:
        self._drop()
        stream.setblocking(False)
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        stream.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _TCP_SEND_BUFFER)
        self._stream = stream


class _TcpWire(_StreamWire):
    """A client that connects without blocking, and tries again every second."""

    def __init__(self, address: tuple[str, int]) -> None:
        super().__init__()
        self._address = address
        self._retry_s = float("-inf")

    def _connected(self, now: float) -> socket.socket | None:
        if self._stream is None and now >= self._retry_s:
            self._retry_s = now + _RECONNECT_S
            stream = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
            self._adopt(stream)
            stream.connect_ex(self._address)
        return self._stream


class _TcpInWire(_StreamWire):
    """A server for one vehicle: the last client to connect takes the link."""

    def __init__(self, address: tuple[str, int]) -> None:
        super().__init__()
        self._server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._server.setblocking(False)
        with _closing_on_error(self._server):
            self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._server.bind(address)
            self._server.listen(1)

    def _connected(self, now: float) -> socket.socket | None:  # noqa: ARG002
        with contextlib.suppress(BlockingIOError):
            self._adopt(self._server.accept()[0])
        return self._stream

    def close(self) -> None:
        super().close()
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
