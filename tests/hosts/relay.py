"""A bad network between namespaces: every frame from one side goes on to the others late, or never.

    python -m tests.hosts.relay SIDE SIDE ...

Runs where one end of each side's veth pair is, and carries the frames between those ends through
its own hands, as the kernel's netem would (which this machine's kernel may not have). Each line of
stdin is JSON, fields of `Air`, and holds from then on; the answer is a line with what it has
carried so far. Ends with its stdin.
"""

from __future__ import annotations

import heapq
import json
import os
import random
import select
import socket
import sys
import time
from dataclasses import asdict, dataclass, replace

_ETH_P_ALL = 3
_SOL_PACKET, _PACKET_VNET_HDR = 263, 15
"""From linux/if_packet.h; not in the socket module. Each frame comes and goes with what is known of
its checksums: a veth leaves them to be filled in by hardware that is not there, and drops what
comes with wrong ones."""
_LARGEST = 70_000
_RATE_QUEUE_S = 0.5
"""What a slow link keeps waiting at most; the rest is dropped, as a router's queue does it."""


@dataclass(frozen=True)
class Air:
    """What becomes of a frame. Times on the wall clock."""

    cut: bool = False
    """Nothing passes; what is under way is lost, too."""
    loss: float = 0.0
    """Share from 0 to 1."""
    delay_s: float = 0.0
    jitter_s: float = 0.0
    """Evenly spread, so much more or less than the delay: frames overtake each other."""
    rate_bps: float = 0.0
    """Bits a second in each direction; 0: no bound."""
    apart: tuple[int, ...] = ()
    """These sides hear each other alone, and so do the others."""


@dataclass
class Count:
    """Frames so far."""

    carried: int = 0
    dropped: int = 0


class Relay:
    """The sides' sockets, and what is under way between them."""

    def __init__(self, sides: list[str], seed: int = 1) -> None:
        self._sockets = [_opened(side) for side in sides]
        self._under_way: list[tuple[float, int, int, bytes]] = []
        self._free_s = [0.0] * len(sides)
        self._dice = random.Random(seed)
        self._number = 0
        self.air = Air()
        self.count = Count()

    def serve(self) -> None:
        """Carry frames and obey stdin until that ends."""
        while True:
            waits = [max(0.0, self._under_way[0][0] - time.monotonic())] if self._under_way else []
            ready = select.select([*self._sockets, sys.stdin.fileno()], [], [], *waits)[0]
            for side, one in enumerate(self._sockets):
                if one in ready:
                    self._take(side)
            self._deliver()
            if sys.stdin.fileno() in ready and not self._obey():
                return

    def _take(self, side: int) -> None:
        """All that waits on a side, each frame with its hour of arrival on the others."""
        now = time.monotonic()
        while True:
            try:
                frame, (_, _, kind, *_) = self._sockets[side].recvfrom(_LARGEST)
            except BlockingIOError:
                return
            if kind == socket.PACKET_OUTGOING:
                continue  # what we have sent there ourselves
            for other in range(len(self._sockets)):
                if other != side:
                    self._send(side, other, frame, now)

    def _send(self, side: int, other: int, frame: bytes, now: float) -> None:
        air = self.air
        waits_s = max(0.0, self._free_s[side] - now) if air.rate_bps else 0.0
        parted = (side in air.apart) != (other in air.apart)
        if air.cut or parted or self._dice.random() < air.loss or waits_s > _RATE_QUEUE_S:
            self.count.dropped += 1
            return
        if air.rate_bps:
            waits_s += len(frame) * 8 / air.rate_bps
            self._free_s[side] = now + waits_s
        at = now + waits_s + max(0.0, air.delay_s + air.jitter_s * self._dice.uniform(-1.0, 1.0))
        self._number += 1
        heapq.heappush(self._under_way, (at, self._number, other, frame))

    def _deliver(self) -> None:
        while self._under_way and self._under_way[0][0] <= time.monotonic():
            _, _, other, frame = heapq.heappop(self._under_way)
            try:
                self._sockets[other].send(frame)
                self.count.carried += 1
            except OSError:
                self.count.dropped += 1  # its queue is full, or its namespace is on its way out

    def _obey(self) -> bool:
        """Read one line: False at the end."""
        line = sys.stdin.buffer.raw.readline()  # type: ignore[attr-defined]  # unbuffered: select sees what is left
        if not line:
            return False
        self.air = replace(Air(), **json.loads(line))
        if self.air.cut:
            self.count.dropped += len(self._under_way)
            self._under_way.clear()
        os.write(1, json.dumps(asdict(self.count)).encode() + b"\n")
        return True


def _opened(side: str) -> socket.socket:
    one = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(_ETH_P_ALL))
    one.bind((side, 0))
    one.setsockopt(_SOL_PACKET, _PACKET_VNET_HDR, 1)
    one.setblocking(False)
    return one


if __name__ == "__main__":
    Relay(sys.argv[1:]).serve()
