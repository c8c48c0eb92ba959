"""Between bytes and world: who listens to which vehicle, frames packed once for all of them. No sockets, no clock.

The same hub serves real UDP ports (`sim.server`) and tests that carry the bytes in memory on a virtual clock.
"""

from __future__ import annotations

from collections.abc import Callable

from sim.config import SimConfig
from sim.endpoint import Codec
from sim.ports import Address
from sim.recorder import Recorder
from sim.world import World

Send = Callable[[int, bytes, Address], None]
"""Sends bytes from the vehicle at a place to an address."""

MAX_CLIENTS = 16
"""Per vehicle; when one more comes, the one silent the longest is forgotten."""
_DATAGRAM = 1400


class Hub:
    """A world with clients."""

    def __init__(self, config: SimConfig, now: float, send: Send) -> None:
        self.world = World(config, now)
        self.recorder: Recorder | None = None
        self.codecs = [Codec(vehicle.sysid) for vehicle in self.world.vehicles]
        self._clients: list[dict[Address, None]] = [{} for _ in self.codecs]
        self._send = send

    def receive(self, place: int, data: bytes, sender: Address) -> None:
        """A datagram for the vehicle at `place`; whoever writes to it is listened to and told."""
        clients = self._clients[place]
        clients.pop(sender, None)
        clients[sender] = None
        if len(clients) > MAX_CLIENTS:
            del clients[next(iter(clients))]
        for message in self.codecs[place].messages(data):
            self.world.handle(place, message)
        self._flush(place, sender)

    def step(self) -> None:
        """One step of the world, and what the vehicles have to say after it."""
        for place in self.world.step():
            self._flush(place, None)
        if self.recorder is not None:
            self.recorder.after_step()

    def _flush(self, place: int, asker: Address | None) -> None:
        said = self.world.outbox(place)
        clients = self._clients[place]
        if not said or not clients:
            return
        codec = self.codecs[place]
        public, answers = [], []
        for out in said:
            frame = codec.pack(out.message)
            answers.append(frame)
            if not out.private:
                public.append(frame)
        for client in clients:
            for datagram in _datagrams(answers if client == asker else public):
                self._send(place, datagram, client)


def _datagrams(frames: list[bytes]) -> list[bytes]:
    """Frames joined to as few datagrams as fit an Ethernet packet."""
    if sum(map(len, frames)) <= _DATAGRAM:
        return [b"".join(frames)] if frames else []
    out, size = [b""], 0
    for frame in frames:
        if size + len(frame) > _DATAGRAM:
            out.append(b"")
            size = 0
        out[-1] += frame
        size += len(frame)
    return out
