"""Between bytes and world: the clients of each vehicle, and frames packed once for all of them. No
sockets, no clock.

The same hub serves real sockets (`sim.network.server`) and tests that carry the bytes in memory on
a virtual clock.
"""

from __future__ import annotations

import functools
import heapq
from collections.abc import Callable
from typing import TypeVar

from sim.config import SimConfig
from sim.firmware.message import Message
from sim.network.codec import Codec
from sim.network.signing import Signing
from sim.network.sockets import Address
from sim.world.faults import Radio
from sim.world.truth_recorder import TruthRecorder
from sim.world.world import World

Send = Callable[[int, bytes, Address], None]
"""Sends bytes from the vehicle at a place to an address."""

T = TypeVar("T")

MAX_CLIENTS = 16
"""Per vehicle; one more takes the place of the one silent the longest."""
_DATAGRAM = 1400


class Hub:
    """A world with clients."""

    def __init__(
        self,
        config: SimConfig,
        now: float,
        send: Send,
        signing: Callable[[], Signing | None] = lambda: None,
    ) -> None:
        self.world = World(config, now)
        self.recorder: TruthRecorder | None = None
        self.codecs = [Codec(vehicle.sysid, signing()) for vehicle in self.world.vehicles]
        self._clients: list[dict[Address, None]] = [{} for _ in self.codecs]
        self._send = send
        self._waiting: list[tuple[float, int, Callable[[], None]]] = []
        self._waiting_count = 0

    def receive(self, place: int, data: bytes, sender: Address) -> None:
        """A datagram for the vehicle at `place`; its sender becomes a client."""
        clients = self._clients[place]
        clients.pop(sender, None)
        clients[sender] = None
        if len(clients) > MAX_CLIENTS:
            del clients[next(iter(clients))]
        messages = list(self.codecs[place].messages(data))
        radio = self.world.vehicles[place].faults.radio
        if radio is None:
            self._handle(place, messages, sender)
            return
        messages = self._survivors(place, messages, radio)
        self._later(radio, lambda: self._handle(place, messages, sender))

    def _handle(self, place: int, messages: list[Message], sender: Address) -> None:
        for message in messages:
            self.world.handle(place, message)
        self._flush(place, sender)

    def _survivors(self, place: int, frames: list[T], radio: Radio) -> list[T]:
        """The frames that a lossy radio lets through."""
        if not radio.loss:
            return frames
        draws = self.world.vehicles[place].faults.radio_rng.random(len(frames)).tolist()
        return [frame for frame, draw in zip(frames, draws, strict=True) if draw >= radio.loss]

    def _later(self, radio: Radio, what: Callable[[], None]) -> None:
        if not radio.delay_s:
            what()
            return
        self._waiting_count += 1
        due_s = self.world.time_s + radio.delay_s
        heapq.heappush(self._waiting, (due_s, self._waiting_count, what))

    def listen(self, place: int, peers: list[Address]) -> None:
        """Makes clients of addresses that are connected and have said nothing yet."""
        for peer in peers:
            self._clients[place].setdefault(peer)

    def step(self) -> None:
        """One step of the world, and what the vehicles have to say after it."""
        for place in self.world.step():
            self._flush(place, None)
        while self._waiting and self._waiting[0][0] <= self.world.time_s:
            heapq.heappop(self._waiting)[2]()
        if self.recorder is not None:
            self.recorder.after_step()

    def _flush(self, place: int, asker: Address | None) -> None:
        said = self.world.outbox(place)
        clients = self._clients[place]
        if not said or not clients:
            return
        radio = self.world.vehicles[place].faults.radio
        if radio is not None and radio.mute_heartbeat:
            said = [out for out in said if out.message.name != "HEARTBEAT"]
        public, answers = [], []
        for out in said:
            frame = self.codecs[place].pack(out.message)
            answers.append(frame)
            if not out.private:
                public.append(frame)
        for client in clients:
            frames = answers if client == asker else public
            if radio is None:
                self._transmit(place, frames, client)
            else:
                heard = self._survivors(place, frames, radio)
                self._later(radio, functools.partial(self._transmit, place, heard, client))

    def _transmit(self, place: int, frames: list[bytes], client: Address) -> None:
        for datagram in _datagrams(frames):
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
