"""Between bytes and world: the clients of each vehicle, and frames packed once for all of them. No
sockets, no clock.

The same hub serves real sockets (`swarm_sim.network.server`) and tests that carry the bytes in
memory on a virtual clock.
"""

from __future__ import annotations

import functools
import heapq
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import TypeVar

from swarm_sim.config import SimConfig, VehicleConfig
from swarm_sim.firmware.autopilot import Outgoing
from swarm_sim.firmware.message import Message
from swarm_sim.network.codec import Codec
from swarm_sim.network.signing import KEY_BYTES, VehicleSigning
from swarm_sim.network.sockets import Address
from swarm_sim.world.faults import Radio
from swarm_sim.world.truth_recorder import TruthRecorder
from swarm_sim.world.world import World

Send = Callable[[int, bytes, Address], None]
"""Sends bytes on a link to an address."""

T = TypeVar("T")

_DATAGRAM = 1400
_FORGET_EVERY_S = 1.0


class Hub:
    """A world with clients.

    Links are numbered: first the endpoint of each vehicle in their order, then the further
    endpoints of the first vehicle, of the second, and so on.
    """

    def __init__(
        self,
        config: SimConfig,
        now: float,
        send: Send,
        signing: Callable[[VehicleConfig], VehicleSigning] = lambda _: VehicleSigning(None, int),
    ) -> None:
        self.world = World(config, now)
        self.recorder: TruthRecorder | None = None
        self.links = [(index, 0) for index in range(len(config.vehicles))]
        """Place and channel of each link."""
        self.links += [
            (index, channel)
            for index, vehicle in enumerate(config.vehicles)
            for channel in range(1, 1 + len(vehicle.also))
        ]
        self._links_of: list[list[tuple[int, int]]] = [[] for _ in config.vehicles]
        for link, (index, channel) in enumerate(self.links):
            self._links_of[index].append((link, channel))
        self._signing = [signing(vehicle) for vehicle in config.vehicles]
        self.codecs = [
            Codec(config.vehicles[index].sysid, self._signing[index], channel)
            for index, channel in self.links
        ]
        self._clients = [
            Clients(
                one_partner=_one_partner(config.vehicles[p], c),
                connected=_endpoint(config.vehicles[p], c).startswith("tcp"),
            )
            for p, c in self.links
        ]
        self._boots_s = [0.0 for _ in self.links]
        self._speaks_first = [
            _endpoint(config.vehicles[p], c).startswith("udpout:") for p, c in self.links
        ]
        """Links that go to one address, whether it speaks or not."""
        self._forget_s = 0.0
        self._send = send
        self._waiting: list[tuple[float, int, Callable[[], None]]] = []
        self._waiting_count = 0

    def receive(self, link: int, data: bytes, sender: Address) -> None:
        """A datagram on a link; its sender becomes a client, if there is a place for it."""
        index, channel = self.links[link]
        messages = list(self.codecs[link].messages(data))
        self._forget_after_boot(link)
        signed = self._signing[index].active
        proven = bool(messages) and signed
        sender = self._clients[link].hear(sender, self.world.time_s, proven=proven, signed=signed)
        self.world.vehicles[index].firmware.hear(channel)
        radio = self.world.vehicles[index].faults.radio
        if radio is None:
            self._handle(link, messages, sender)
            return
        messages = self._survivors(index, messages, radio)
        self._later(radio, lambda: self._handle(link, messages, sender))

    def _forget_after_boot(self, link: int) -> None:
        if not self._clients[link].one_partner:
            return
        boot_s = self.world.vehicles[self.links[link][0]].firmware.boot_s
        if boot_s != self._boots_s[link]:
            self._boots_s[link] = boot_s
            self._clients[link].clear()

    def _handle(self, link: int, messages: list[Message], sender: Address) -> None:
        index, channel = self.links[link]
        for message in messages:
            if message.name == "SETUP_SIGNING":
                self._set_up_signing(index, message)
            else:
                self.world.handle(index, message, channel)
        self._flush(index, (link, sender))

    def _set_up_signing(self, index: int, message: Message) -> None:
        """As both firmwares: on any link, only while disarmed; with a key, only if signed with it.
        No link here is ArduPilot's USB port, where it takes unsigned frames, too."""
        fields, firmware = message.fields, self.world.vehicles[index].firmware
        if fields["target_system"] in (0, firmware.sysid) and not firmware.armed:
            key = bytes(fields["secret_key"])
            self._signing[index].set_up(key[:KEY_BYTES], fields["initial_timestamp"])

    def _survivors(self, index: int, frames: list[T], radio: Radio) -> list[T]:
        """The frames that a lossy radio lets through."""
        if not radio.loss:
            return frames
        draws = self.world.vehicles[index].faults.radio_rng.random(len(frames)).tolist()
        return [frame for frame, draw in zip(frames, draws, strict=True) if draw >= radio.loss]

    def _later(self, radio: Radio, what: Callable[[], None]) -> None:
        if not radio.delay_s:
            what()
            return
        self._waiting_count += 1
        due_s = self.world.time_s + radio.delay_s
        heapq.heappush(self._waiting, (due_s, self._waiting_count, what))

    def listen(self, link: int, peers: list[Address]) -> None:
        """Makes clients of addresses that are configured, or connected, and have said nothing
        yet."""
        self._clients[link].keep(peers)
        signed = self._signing[self.links[link][0]].active
        for peer in peers:
            if peer not in self._clients[link]:
                invited = self._speaks_first[link]
                self._clients[link].hear(
                    peer, self.world.time_s, proven=False, signed=signed, stays=invited
                )

    def _forget_clients(self) -> None:
        self._forget_s = self.world.time_s + _FORGET_EVERY_S
        for clients, (index, _) in zip(self._clients, self.links, strict=True):
            clients.forget(self.world.time_s, signed=self._signing[index].active)

    def step(self) -> None:
        """One step of the world, and what the vehicles have to say after it."""
        if self.world.time_s >= self._forget_s:
            self._forget_clients()
        for index in self.world.step():
            self._flush(index, None)
        while self._waiting and self._waiting[0][0] <= self.world.time_s:
            heapq.heappop(self._waiting)[2]()
        if self.recorder is not None:
            self.recorder.after_step()

    def _flush(self, index: int, asker: tuple[int, Address] | None) -> None:
        said = self.world.outbox(index)
        if not said:
            return
        radio = self.world.vehicles[index].faults.radio
        if radio is not None and radio.mute_heartbeat:
            said = [out for out in said if out.message.name != "HEARTBEAT"]
        for link, channel in self._links_of[index]:
            if self._clients[link]:
                heard = [out for out in said if out.channel is None or out.channel == channel]
                self._flush_link(link, heard, asker)

    def _flush_link(
        self, link: int, said: list[Outgoing], asker: tuple[int, Address] | None
    ) -> None:
        index = self.links[link][0]
        radio = self.world.vehicles[index].faults.radio
        public, answers = [], []
        for out in said:
            frame = self.codecs[link].pack(out.message)
            answers.append(frame)
            if not out.private or asker is None:  # a reminder: it names its target itself
                public.append(frame)
        for client in self._clients[link]:
            frames = answers if (link, client) == asker else public
            if radio is None:
                self._transmit(link, frames, client)
            else:
                heard = self._survivors(index, frames, radio)
                self._later(radio, functools.partial(self._transmit, link, heard, client))

    def _transmit(self, link: int, frames: list[bytes], client: Address) -> None:
        for datagram in _datagrams(frames):
            self._send(link, datagram, client)


def _one_partner(vehicle: VehicleConfig, channel: int) -> bool:
    """A PX4 answers on UDP only the address that it heard first, until it reboots. It obeys
    others, too."""
    return vehicle.persona == "px4" and _endpoint(vehicle, channel).startswith("udp")


def _endpoint(vehicle: VehicleConfig, channel: int) -> str:
    return (vehicle.endpoint, *vehicle.also)[channel]


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


MAX_CLIENTS = 16
SILENT_S = 5.0
"""A client that was not heard for so long (mission time) gives its place to a new one."""
FORGET_S = 60.0
"""One that was not heard for so long gets nothing more."""


@dataclass(slots=True)
class _Client:
    heard_s: float
    proven: bool
    stays: bool
    """It is there by configuration: not forgotten."""


class Clients:
    """At most `MAX_CLIENTS`. One that has signed (`proven`) takes the place of one that has not,
    and gives its own to none of those. On a signed link of which others are not `local`, they get
    nothing at all.

    `one_partner`: as a PX4 on UDP, which answers the first address alone, until it reboots.
    `connected`: clients of a TCP port, which are there as long as their connection.
    """

    def __init__(self, *, one_partner: bool = False, connected: bool = False) -> None:
        self.one_partner = one_partner
        self.connected = connected
        self._clients: dict[Address, _Client] = {}

    def __iter__(self) -> Iterator[Address]:
        return iter(tuple(self._clients))

    def __contains__(self, address: Address) -> bool:
        return address in self._clients

    def __len__(self) -> int:
        return len(self._clients)

    def clear(self) -> None:
        """Forget all."""
        self._clients.clear()

    def hear(
        self,
        sender: Address,
        now_s: float,
        *,
        proven: bool,
        signed: bool = False,
        stays: bool = False,
    ) -> Address:
        """A datagram of `sender`; the address that it is answered to, if that is a client.

        `signed`: the vehicle obeys only who has its key. Of others, it serves those of its own
        computer, where a ground station's relay listens without a key.
        """
        known = self._clients.get(sender)
        if known is not None:
            known.heard_s, known.proven = now_s, known.proven or proven
        elif (proven or stays or not signed or _local(sender)) and self._has_room(
            now_s, proven=proven
        ):
            self._clients[sender] = _Client(now_s, proven, stays)
        return next(iter(self._clients), sender) if self.one_partner else sender

    def keep(self, peers: Collection[Address]) -> None:
        """Of connections, those that are still there."""
        if self.connected:
            for address in self._clients.keys() - set(peers):
                del self._clients[address]

    def forget(self, now_s: float, *, signed: bool) -> None:
        """Those that have fallen silent and, on a link that is signed by now, strangers. One
        partner and connections may be silent."""
        for address, client in tuple(self._clients.items()):
            may_be_silent = self.one_partner or self.connected
            silent = now_s - client.heard_s > FORGET_S and not may_be_silent
            strange = signed and not client.proven and not _local(address)
            if (silent or strange) and not client.stays:
                del self._clients[address]

    def _has_room(self, now_s: float, *, proven: bool) -> bool:
        """There is a place, or one that is given up now."""
        if len(self._clients) < (1 if self.one_partner else MAX_CLIENTS):
            return True
        longest = sorted(self._clients, key=lambda each: self._clients[each].heard_s)
        for address in longest:
            old = self._clients[address]
            silent = not self.one_partner and now_s - old.heard_s > SILENT_S
            if proven > old.proven or (silent and proven >= old.proven):
                del self._clients[address]
                return True
        return False


def _local(address: Address) -> bool:
    """A program of this computer."""
    return address[0].startswith("127.")
