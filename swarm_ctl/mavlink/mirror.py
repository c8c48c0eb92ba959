"""A vehicle's only link, shared with ground control software.

The agent copies the vehicle's frames to a relay on this machine, and passes on a few of the frames
that come back, at the end of its tick. Nothing here waits: what does not go at once is lost.
"""

from __future__ import annotations

import hmac
import socket
from typing import Any, Final

from swarm_ctl.errors import LinkError

FRAMES_A_TICK: Final = 4
"""From the relay to the vehicle, at most."""
_DATAGRAM: Final = 1400
_LONGEST: Final = 280
_MAGIC: Final = (0xFD, 0xFE)


class Mirror:
    """The agent's end: a UDP socket on the loopback interface. LinkError where the port is taken.

    The relay is the program that wrote the secret, which `run` tells both: any program of the
    machine may write to the port. What others write is dropped.
    """

    def __init__(self, port: int, secret: bytes) -> None:
        self._secret = secret
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(("127.0.0.1", port))
        except OSError as error:
            self._socket.close()
            raise LinkError(f"port {port} for ground control software: {error}") from error
        self._relay: Any = None
        self._kept: list[bytes] = []

    def keep(self, frame: bytes) -> None:
        """A frame of the vehicle, to go at the next `exchange`."""
        if self._relay is not None:
            self._kept.append(frame)

    def exchange(self) -> list[bytes]:
        """Send what was kept; the frames to pass on to the vehicle now."""
        for datagram in self._datagrams():
            try:
                self._socket.sendto(datagram, self._relay)
            except OSError:
                break
        self._kept.clear()
        return self._received()

    def _datagrams(self) -> list[bytes]:
        joined = [b""]
        for frame in self._kept:
            if len(joined[-1]) + len(frame) > _DATAGRAM:
                joined.append(b"")
            joined[-1] += frame
        return [datagram for datagram in joined if datagram]

    def _received(self) -> list[bytes]:
        frames: list[bytes] = []
        for _ in range(FRAMES_A_TICK):
            try:
                data, sender = self._socket.recvfrom(_LONGEST + 1)
            except OSError:
                break
            if hmac.compare_digest(data, self._secret):
                self._relay = sender
            elif sender == self._relay and 0 < len(data) <= _LONGEST and data[0] in _MAGIC:
                frames.append(data)
        return frames

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
