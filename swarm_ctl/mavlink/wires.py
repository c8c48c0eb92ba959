"""Where the bytes of a vehicle's link come from: UDP, TCP, a serial port, or memory.

pymavlink's `mavutil` has such connections, too, but costs twice the memory of a dialect alone,
blocks while it connects, and hides socket errors. The spelling of endpoints is its own (serial
ports get the prefix `serial:`).
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
"""Longer than any datagram of MAVLink frames (280 bytes each, a handful packed together)."""
_RECONNECT_S = 1.0
_TCP_SEND_BUFFER = 4096
"""Small on purpose: setpoints that wait in a kernel buffer would arrive late, after the deadman
should have acted."""
_DEFAULT_BAUD = 57600
"""What telemetry radios are set to when they are bought."""


class Wire(Protocol):
    """Non-blocking bytes in both directions. `now` is the caller's clock [s]; errors are
    OSError."""

    def read(self, now: float) -> bytes | None:
        """The next pending chunk (a datagram, or some of a stream), None when nothing is
        pending."""

    def write(self, data: bytes, now: float) -> None:
        """Send one frame now, or drop it: a frame is never kept to be sent later."""

    def confirm(self) -> None:
        """The chunk read last came from the vehicle: answer there."""

    def close(self) -> None:
        """Idempotent."""


class MemoryWire:
    """One end of an in-memory wire, for tests and for studies on a virtual clock. Bounded, newest
    kept."""

    def __init__(self, inbox: deque[bytes], outbox: deque[bytes]) -> None:
        self._inbox = inbox
        self._outbox = outbox

    def read(self, now: float = 0.0) -> bytes | None:  # noqa: ARG002
        """The oldest chunk that the other end wrote."""
        return self._inbox.popleft() if self._inbox else None

    def write(self, data: bytes, now: float = 0.0) -> None:  # noqa: ARG002
        """Seen by the other end's next read."""
        self._outbox.append(data)

    def confirm(self) -> None:
        """Nothing to choose: there is one other end."""

    def close(self) -> None:
        """Nothing to give back."""


def memory_wires(limit: int = 4096) -> tuple[MemoryWire, MemoryWire]:
    """Both ends of a wire in memory; each direction keeps the newest `limit` chunks."""
    one: deque[bytes] = deque(maxlen=limit)
    two: deque[bytes] = deque(maxlen=limit)
    return MemoryWire(one, two), MemoryWire(two, one)


def open_wire(endpoint: str) -> Wire:
    """Open what `endpoint` names. LinkError says what is allowed, or what the machine refused."""
    scheme, _, rest = endpoint.partition(":")
    try:
        if scheme == "serial" and rest:
            return _SerialWire(*_device_and_baud(rest))
        if scheme not in _SCHEMES:
            raise LinkError(f"endpoint {endpoint!r} is not one; allowed: {ALLOWED}")
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


def _device_and_baud(rest: str) -> tuple[str, int]:
    device, _, baud = rest.rpartition(":")
    return (device, int(baud)) if device and baud.isdecimal() else (rest, _DEFAULT_BAUD)


class _UdpOutWire:
    """A connected datagram socket: the kernel drops what others send, and tells when nobody listens
    there."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        with _closing_on_error(self._socket):
            self._socket.connect(address)

    def read(self, now: float) -> bytes | None:  # noqa: ARG002
        try:
            return self._socket.recv(_CHUNK)
        except BlockingIOError:
            return None

    def write(self, data: bytes, now: float) -> None:  # noqa: ARG002
        self._socket.send(data)

    def confirm(self) -> None:
        pass

    def close(self) -> None:
        self._socket.close()


class _UdpInWire:
    """Listens, and answers the address from which the vehicle was heard last; silent until it was
    heard."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._sender: Any = None
        self._vehicle: Any = None
        with _closing_on_error(self._socket):
            self._socket.bind(address)

    def read(self, now: float) -> bytes | None:  # noqa: ARG002
        try:
            data, self._sender = self._socket.recvfrom(_CHUNK)
        except BlockingIOError:
            return None
        return data

    def write(self, data: bytes, now: float) -> None:  # noqa: ARG002
        if self._vehicle is not None:
            self._socket.sendto(data, self._vehicle)

    def confirm(self) -> None:
        self._vehicle = self._sender

    def close(self) -> None:
        self._socket.close()


class _StreamWire:
    """What the TCP client and server share: one stream at a time, frames sent whole or not at
    all."""

    def __init__(self) -> None:
        self._stream: socket.socket | None = None
        self._unsent = b""

    def _connected(self, now: float) -> socket.socket | None:
        raise NotImplementedError

    def read(self, now: float) -> bytes | None:
        stream = self._connected(now)
        if stream is None:
            return None
        try:
            data = stream.recv(_CHUNK)
        except BlockingIOError:
            return None
        except OSError:
            self._drop()
            raise
        if not data:
            self._drop()
            return None
        return data

    def write(self, data: bytes, now: float) -> None:
        stream = self._connected(now)
        if stream is None:
            return
        try:
            if self._unsent:
                self._unsent = self._unsent[stream.send(self._unsent) :]
            if self._unsent:
                raise BlockingIOError("the stream is full; a frame was dropped")
            self._unsent = data[stream.send(data) :]
        except BlockingIOError:
            raise
        except OSError:
            self._drop()
            raise

    def confirm(self) -> None:
        pass

    def close(self) -> None:
        self._drop()

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
    """A TCP client that connects without waiting and tries again every second."""

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
    """A TCP server for one vehicle: whoever connects last takes the link."""

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


class _SerialWire:
    """A serial port (needs the package pyserial)."""

    def __init__(self, device: str, baud: int) -> None:
        try:
            serial = importlib.import_module("serial")
        except ImportError as error:
            raise LinkError(
                f"serial:{device} needs the package pyserial: pip install pyserial"
            ) from error
        self._port = serial.Serial(device, baud, timeout=0, write_timeout=0)

    def read(self, now: float) -> bytes | None:  # noqa: ARG002
        data: bytes = self._port.read(_CHUNK)
        return data or None

    def write(self, data: bytes, now: float) -> None:  # noqa: ARG002
        self._port.write(data)

    def confirm(self) -> None:
        pass

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
