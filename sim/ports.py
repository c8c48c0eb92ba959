"""Where one vehicle is reached: sockets that never wait and never raise in flight."""

from __future__ import annotations

import socket
from collections.abc import Iterator

Address = tuple[str, int]
_BURST = 256
"""Datagrams taken at once, so that one flood can't stop the others."""


class UdpPort:
    """A bound, non-blocking UDP socket."""

    def __init__(self, address: Address) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.socket.setblocking(False)
            self.socket.bind(address)
        except OSError:
            self.socket.close()
            raise
        self.unsent = 0
        """Datagrams the system had no room for."""

    def receive(self) -> Iterator[tuple[bytes, Address]]:
        """Everything that waits, with its sender; at most `_BURST` so that one flood can't stop the others."""
        for _ in range(_BURST):
            try:
                yield self.socket.recvfrom(65535)
            except BlockingIOError:
                return
            except OSError:
                continue

    def send(self, data: bytes, to: Address) -> None:
        """Never waits, never raises: what can't be sent is lost, as on a radio."""
        try:
            self.socket.sendto(data, to)
        except OSError:
            self.unsent += 1

    def close(self) -> None:
        """Frees the port."""
        self.socket.close()
