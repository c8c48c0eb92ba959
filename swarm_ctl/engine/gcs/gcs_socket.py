"""A UDP socket for ground control software: sends to the GCS that `--gcs` names, and to those that
have written. It never waits."""

from __future__ import annotations

import math
import socket
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final, TypeAlias

from swarm_ctl.engine.gcs.config import GcsAddress
from swarm_ctl.errors import LinkError
from swarm_ctl.mavlink.framer import Framer, MavlinkFrame


class Throttle:
    """Lets `rate_hz` frames a second through, `burst` of them at once; as many may wait. Where more
    come, the oldest are dropped."""

    def __init__(self, rate_hz: float, burst: int) -> None:
        self._rate_hz = rate_hz
        self._burst = burst
        self._tokens = float(burst)
        self._at_s: float | None = None
        self._queue: deque[bytes] = deque(maxlen=burst)
        self.dropped = 0

    def put(self, frame: bytes) -> None:
        """Queue a frame."""
        self.dropped += len(self._queue) == self._burst
        self._queue.append(frame)

    def take(self, now: float) -> list[bytes]:
        """The frames that may go now, oldest first."""
        since_s = 0.0 if self._at_s is None else max(0.0, now - self._at_s)
        self._at_s = now
        self._tokens = min(float(self._burst), self._tokens + since_s * self._rate_hz)
        count = min(int(self._tokens), len(self._queue))
        self._tokens -= count
        return [self._queue.popleft() for _ in range(count)]


Address: TypeAlias = tuple[str, int]

BURST: Final = 32
"""Datagrams read at once: at 100 turns a second, 3,200 a second. What more a GCS sends is lost in
the system's buffer, and takes no time from others."""
_LEARNED: Final = 4
"""GCSs that have written without being named, at most; the one silent longest gives way."""
_FORGOTTEN_S: Final = 60.0
_DATAGRAM: Final = 1400
_CHUNK: Final = 65535


@dataclass(slots=True)
class GcsClient:
    """One GCS."""

    address: Address
    heard_s: float
    framer: Framer = field(default_factory=lambda: Framer(unknown=True))
    throttles: dict[int, Throttle] = field(default_factory=dict)
    """By the system id of the vehicle that frames go to."""
    introduced: bool = False
    answered_s: float = -math.inf
    """When it was last told that something was refused."""
    told: set[str] = field(default_factory=set)
    """Warnings that were given about it."""

    def __str__(self) -> str:
        return f"{self.address[0]}:{self.address[1]}"


class GcsSocket:
    """The GCSs behind one `--gcs`. A loopback one is served from the loopback interface alone, one
    on another machine to that machine alone. LinkError where the socket can't be opened."""

    def __init__(self, config: GcsAddress, now: float) -> None:
        self.unsent = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._host = socket.gethostbyname(config.host)
            local = self._host.startswith("127.")
            self._socket.bind(("127.0.0.1" if local else "", config.own_port))
        except OSError as error:
            self._socket.close()
            raise LinkError(f"--gcs {config}: can't be opened: {error}") from error
        named = (self._host, config.port)
        self._peers = {named: GcsClient(named, now)}
        self._named = named

    @property
    def peers(self) -> list[GcsClient]:
        """All GCSs that hear the vehicles."""
        return list(self._peers.values())

    def take(self, now: float) -> Iterator[tuple[GcsClient, MavlinkFrame]]:
        """The frames that have come, each with its sender."""
        for _ in range(BURST):
            try:
                data, sender = self._socket.recvfrom(_CHUNK)
            except BlockingIOError:
                break
            except OSError:
                continue
            if sender[0] == self._host or self._host.startswith("127."):
                peer = self._peer(sender, now)
                for frame in peer.framer.feed(data):
                    yield peer, frame
        self._forget(now)

    def _peer(self, sender: Address, now: float) -> GcsClient:
        peer = self._peers.get(sender)
        if peer is None:
            learned = [each for each in self.peers if each.address != self._named]
            if len(learned) >= _LEARNED:
                del self._peers[min(learned, key=lambda each: each.heard_s).address]
            peer = self._peers[sender] = GcsClient(sender, now)
        peer.heard_s = now
        return peer

    def _forget(self, now: float) -> None:
        for peer in self.peers:
            if peer.address != self._named and now - peer.heard_s > _FORGOTTEN_S:
                del self._peers[peer.address]

    def send(self, frames: Sequence[bytes]) -> None:
        """To all; what the system has no room for is lost."""
        for datagram in _datagrams(frames):
            for address in self._peers:
                try:
                    self._socket.sendto(datagram, address)
                except OSError:
                    self.unsent += 1

    def answer(self, peer: GcsClient, frame: bytes) -> None:
        """To this one alone."""
        try:
            self._socket.sendto(frame, peer.address)
        except OSError:
            self.unsent += 1

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _datagrams(frames: Sequence[bytes]) -> Iterator[bytes]:
    """Whole frames, in as few datagrams as fit an Ethernet packet."""
    joined = b""
    for frame in frames:
        if joined and len(joined) + len(frame) > _DATAGRAM:
            yield joined
            joined = b""
        joined += frame
    if joined:
        yield joined
