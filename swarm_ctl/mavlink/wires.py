"""Open the wire to a vehicle by its endpoint: UDP here, TCP and serial ports in
`stream_wires.py`.

Each of them opens again by itself when it has broken.

pymavlink's `mavutil` has such connections, too, but costs twice the memory of a dialect alone,
blocks while it connects, and hides socket errors. Endpoints are spelled as there (serial ports get
the prefix `serial:`).
"""

from __future__ import annotations

import contextlib
import importlib
import os
import select
import socket
import termios
from collections.abc import Callable, Iterator
from typing import Any, Final, Protocol

from swarm_ctl.core.model.fleet import plain_endpoint
from swarm_ctl.errors import InputError, LinkError
from swarm_ctl.mavlink.wire import SILENT_S, MemoryWire, Partners, Wire, memory_wires

__all__ = ["ALLOWED", "MemoryWire", "NameUnknownYetError", "Wire", "memory_wires", "open_wire"]

ALLOWED = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT, serial:DEVICE[:BAUD]"

_CHUNK = 4096
"""Longer than a datagram of MAVLink frames (280 bytes each, a few in one)."""
_RENEW_S: Final = 1.0
"""Between two attempts at a UDP socket whose own address the computer has lost."""
_DEFAULT_BAUD = 57600
"""The default of telemetry radios."""
_FIRST_PORT, _PORTS = 10000, 3000
"""Local ports of `udpout`: away from those of autopilots and ground stations (14000 and up)."""


class SpellingError(InputError, LinkError):
    """An endpoint that is none, whatever the machine has: bad input."""


class NameUnknownYetError(LinkError):
    """The resolver can't tell the host's address for now: a container engine's while containers
    start."""


def open_wire(endpoint: str) -> Wire:
    """Open `endpoint`; SpellingError where it is none, another LinkError when the machine refuses
    it.

    Blocks while a name is looked up; NameUnknownYetError where that may work later.
    """
    scheme, _, rest = plain_endpoint(endpoint).partition(":")
    try:
        if scheme == "serial" and rest:
            return SerialWire(*_device_and_baud(rest))
        if scheme not in _SCHEMES:
            raise SpellingError(f"endpoint {endpoint!r} has no known scheme; allowed: {ALLOWED}")
        return _SCHEMES[scheme](_address(endpoint, rest))
    except OSError as error:
        later = isinstance(error, socket.gaierror) and error.errno == socket.EAI_AGAIN
        kind = NameUnknownYetError if later else LinkError
        raise kind(f"endpoint {endpoint}: can't be opened: {error}") from error


def _address(endpoint: str, rest: str) -> tuple[str, int]:
    host, _, port = rest.rpartition(":")
    if not host or not port.isdecimal() or not 1 <= int(port) <= 65535:
        raise SpellingError(
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


class _UdpOutWire(Wire):
    """A connected socket: the kernel drops the datagrams of other senders, and reports an endpoint
    where no process listens.

    Its own port is the same whenever it talks to `address`: a PX4 answers the port of its first
    partner until it reboots. A connected socket keeps the computer's own address, too: where that
    has changed, a new one is opened.
    """

    def __init__(self, address: tuple[str, int]) -> None:
        self._address = address
        self._renew_s = float("inf")
        self._open()

    def _open(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        port = local_port(self._address)
        try:
            try:
                self._socket.bind(("", port))
            except OSError as error:
                self.warning = (
                    f"UDP port {port} can't be used ({error.strerror}; does another process speak"
                    " to this vehicle?): a PX4 that has heard from it answers no other port"
                )
            self._socket.connect(self._address)
        except OSError:
            self._socket.close()
            raise
        self.port = self._socket.getsockname()[1]

    def read(self, now: float) -> bytes | None:  # noqa: ARG002
        try:
            return self._socket.recv(_CHUNK)
        except BlockingIOError:
            return None

    def write(self, data: bytes, now: float, system: int = 0) -> None:  # noqa: ARG002
        if now >= self._renew_s:
            self._renew_s = now + _RENEW_S
            self._socket.close()
            self._open()
            self._renew_s = float("inf")
        try:
            self._socket.send(data)
        except (BlockingIOError, ConnectionRefusedError):
            raise  # a full buffer, and a vehicle that is not there yet
        except OSError:
            self._renew_s = min(self._renew_s, now + _RENEW_S)
            raise

    def close(self) -> None:
        self._socket.close()


class _UdpInWire(Wire):
    """Listens, and sends to each vehicle at the address from which it was heard, to none before."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._sender: Any = None
        self._vehicles = Partners()
        self._now = 0.0
        try:
            self._socket.bind(address)
        except OSError:
            self._socket.close()
            raise

    def read(self, now: float) -> bytes | None:
        self._now = now
        try:
            data, self._sender = self._socket.recvfrom(_CHUNK)
        except BlockingIOError:
            return None
        return data

    def write(self, data: bytes, now: float, system: int = 0) -> None:  # noqa: ARG002
        address = self._vehicles.of(system)
        if address is not None:
            self._socket.sendto(data, address)

    def confirm(self, system: int = 0, *, proven: bool = False) -> None:
        self._vehicles.hear(system, self._sender, self._now, proven=proven)

    def close(self) -> None:
        self._socket.close()


_RECONNECT_S: Final = 1.0
_CONNECT_S: Final = 3.0
"""A connection that is not there by then is begun anew: the system asks a host that was away ever
more seldom, after a minute once in 30 s."""
_REOPEN_S: Final = 0.25
"""Between two attempts to open a serial port that has gone: a PX4 lands after 1 s without
setpoints. An attempt at a port that is not there takes microseconds."""
_UNANSWERED_MS: Final = 3000
"""What was sent and is not acknowledged after this time ends the connection: the host has lost its
power or its network. By itself the system would wait for a quarter of an hour."""
_SEND_BUFFER: Final = 4096
"""Small: a setpoint that waits in the kernel's buffer would arrive after the vehicle's time-out."""


class _Connection(Protocol):
    """A socket, or what speaks like one; it never blocks."""

    def recv(self, size: int, /) -> bytes: ...
    def send(self, data: bytes, /) -> int: ...
    def close(self) -> None: ...


class Stream:
    """One connection. A frame is sent whole or not at all; an error, and its end, end it."""

    def __init__(self, connection: _Connection) -> None:
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


def _tuned(connection: socket.socket) -> socket.socket:
    connection.setblocking(False)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
    if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNANSWERED_MS)
    return connection


class TcpWire(Wire):
    """A client that connects without blocking, and tries again every second."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._address = address
        self._tried_s = float("-inf")
        self._socket: socket.socket | None = None
        self._stream: Stream | None = None

    def _connected(self, now: float) -> Stream | None:
        stream, passed_s = self._stream, now - self._tried_s
        if stream is not None and not stream.ended:
            if passed_s < _CONNECT_S or self._answered():
                return stream
            stream.close()
        if passed_s < _RECONNECT_S:
            return None
        self._tried_s = now
        self._socket = _tuned(socket.socket(socket.AF_INET, socket.SOCK_STREAM))
        self._stream = Stream(self._socket)
        self._socket.connect_ex(self._address)
        return self._stream

    def _answered(self) -> bool:
        try:
            return self._socket is not None and bool(self._socket.getpeername())
        except OSError:
            return False

    def read(self, now: float) -> bytes | None:
        stream = self._connected(now)
        return None if stream is None else stream.read()

    def write(self, data: bytes, now: float, system: int = 0) -> None:  # noqa: ARG002
        stream = self._connected(now)
        if stream is not None:
            stream.write(data)

    def close(self) -> None:
        if self._stream is not None:
            self._stream.close()


class TcpInWire(Wire):
    """A server for vehicles. The client that a frame of a vehicle came from has that vehicle's link
    (`confirm`): one that is silent, or a stranger, takes it from no vehicle. A vehicle that was not
    heard yet is spoken to at the newest client."""

    sources = 16

    def __init__(self, address: tuple[str, int]) -> None:
        self._server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            self._server.setblocking(False)
            self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._server.bind(address)
            self._server.listen(self.sources)
        except OSError:
            self._server.close()
            raise
        self._streams: list[Stream | None] = [None] * self.sources
        self._order: list[int] = []
        """Places of the streams, the newest client last."""
        self._vehicles = Partners()
        self._now = 0.0

    def read(self, now: float) -> bytes | None:
        self._now = now
        self._accept()
        for step in range(1, self.sources + 1):
            index = (self.source + step) % self.sources
            stream = self._streams[index]
            if stream is None or stream.ended:
                continue
            with contextlib.suppress(OSError):  # that client has gone
                if data := stream.read():
                    self.source = index
                    return data
        self._vehicles.forget([each for each in self._streams if each and each.ended])
        return None

    def _accept(self) -> None:
        """A client, in the place of the oldest one that does not have a vehicle's link."""
        try:
            connection, _ = self._server.accept()
        except OSError:
            return
        index = self._free_index()
        if index is None:
            connection.close()
            return
        old = self._streams[index]
        if old is not None:
            old.close()
            self._vehicles.forget([old])
        self._streams[index] = Stream(_tuned(connection))
        self._order = [*(each for each in self._order if each != index), index]

    def _free_index(self) -> int | None:
        for index, stream in enumerate(self._streams):
            if stream is None or stream.ended:
                return index
        silent = (p for p in self._order if self._silent_s(self._streams[p]) > SILENT_S)
        return max(silent, key=lambda p: self._silent_s(self._streams[p]), default=None)

    def _silent_s(self, stream: Stream | None) -> float:
        return self._vehicles.silent_s(stream, self._now)

    def confirm(self, system: int = 0, *, proven: bool = False) -> None:
        stream = self._streams[self.source]
        left = self._vehicles.hear(system, stream, self._now, proven=proven)
        if left is not None:
            left.close()

    def write(self, data: bytes, now: float, system: int = 0) -> None:  # noqa: ARG002
        stream: Stream | None = self._vehicles.of(system)
        if stream is None or stream.ended:
            stream = self._newest_client()
        if stream is not None:
            stream.write(data)

    def _newest_client(self) -> Stream | None:
        """That is no vehicle that was heard."""
        streams = (self._streams[index] for index in reversed(self._order))
        free = (s for s in streams if s is not None and not s.ended)
        return next((s for s in free if self._silent_s(s) == float("inf")), None)

    def close(self) -> None:
        for stream in self._streams:
            if stream is not None:
                stream.close()
        self._server.close()


class _SerialPort:
    """A serial port that is open; pyserial's own `write` waits where the port takes nothing."""

    def __init__(self, serial: Any) -> None:
        self._serial = serial
        self._ready = select.poll()
        self._ready.register(serial.fileno(), select.POLLIN)

    def recv(self, size: int, /) -> bytes:
        """As of a socket: b"" is its end, which an idle terminal's `read` would give, too."""
        if not self._ready.poll(0):
            raise BlockingIOError
        return os.read(self._serial.fileno(), size)

    def send(self, data: bytes, /) -> int:
        return os.write(self._serial.fileno(), data)

    def close(self) -> None:
        self._serial.close()


class SerialWire(Wire):
    """A serial port (needs the package pyserial), opened again by its name when it comes back.

    Raises:
        LinkError: pyserial is missing.
        OSError: the port is not there at the start.
    """

    def __init__(self, device: str, baud: int) -> None:
        try:
            self._package = importlib.import_module("serial")
        except ImportError as error:
            allowed = "pip install 'swarm-ctl[serial]'"
            raise LinkError(f"serial:{device} needs the package pyserial: {allowed}") from error
        self._device, self._baud = device, baud
        self._tried_s = float("-inf")
        self._stream = self._opened()

    def _opened(self) -> Stream:
        try:
            serial = self._package.Serial(self._device, self._baud, timeout=0)
        except termios.error as error:  # it went while it was opened
            raise OSError(*error.args) from error
        return Stream(_SerialPort(serial))

    def read(self, now: float) -> bytes | None:
        if self._stream.ended and not self._open_again(now):
            return None
        try:
            data = self._stream.read()
        except OSError as error:
            self._lost(str(error), now)
            raise
        if data is None and self._stream.ended:
            self._lost("it has hung up", now)
        if data:
            self.trouble = ""
        return data

    def write(self, data: bytes, now: float, system: int = 0) -> None:  # noqa: ARG002
        if self._stream.ended and not self._open_again(now):
            raise OSError(self.trouble)
        try:
            self._stream.write(data)
        except BlockingIOError:
            raise
        except OSError as error:
            self._lost(str(error), now)
            raise

    def _open_again(self, now: float) -> bool:
        """It is named as in the fleet, so a port that comes back under its name is found."""
        if now - self._tried_s < _REOPEN_S:
            return False
        self._tried_s = now
        try:
            self._stream = self._opened()
        except OSError:
            return False
        return True

    def _lost(self, why: str, now: float) -> None:
        self._tried_s = now
        self.trouble = self.trouble or f"serial port {self._device} is gone: {why}"

    def close(self) -> None:
        self._stream.close()


_SCHEMES: dict[str, Callable[[tuple[str, int]], Wire]] = {
    "udpin": _UdpInWire,
    "udpout": _UdpOutWire,
    "tcp": TcpWire,
    "tcpin": TcpInWire,
}
