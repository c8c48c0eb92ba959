"""Open the wire to a vehicle by its endpoint: UDP here, TCP and serial ports in
`stream_wires.py`.

Each of them opens again by itself when it has broken.

pymavlink's `mavutil` has such connections, too, but costs twice the memory of a dialect alone,
blocks while it connects, and hides socket errors. Endpoints are spelled as there (serial ports get
the prefix `serial:`).
"""

from __future__ import annotations

import socket
from collections.abc import Callable
from typing import Any, Final

from swarm_ctl.core.model.fleet import plain_endpoint
from swarm_ctl.errors import LinkError
from swarm_ctl.mavlink.stream_wires import SerialWire, TcpInWire, TcpWire
from swarm_ctl.mavlink.wire import MemoryWire, Partners, Wire, memory_wires

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


class NameUnknownYetError(LinkError):
    """The resolver can't tell the host's address for now: a container engine's while containers
    start."""


def open_wire(endpoint: str) -> Wire:
    """Open `endpoint`; LinkError for a wrong spelling, or when the machine refuses it.

    Blocks while a name is looked up; NameUnknownYetError where that may work later.
    """
    scheme, _, rest = plain_endpoint(endpoint).partition(":")
    try:
        if scheme == "serial" and rest:
            return SerialWire(*_device_and_baud(rest))
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


_SCHEMES: dict[str, Callable[[tuple[str, int]], Wire]] = {
    "udpin": _UdpInWire,
    "udpout": _UdpOutWire,
    "tcp": TcpWire,
    "tcpin": TcpInWire,
}
