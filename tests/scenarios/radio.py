"""A telemetry radio on a virtual clock, with the simulator's vehicles behind it.

As a SiK radio does, it has one channel for both directions: the ground and the vehicles speak in
turn, each from a buffer of its own that drops what does not fit. All vehicles hear all that the
ground sends.
"""

from __future__ import annotations

from collections import deque
from typing import Any, Final

from swarm_ctl.core.swarm.radio import budget
from swarm_ctl.engine.radio.load import RadioLoad
from swarm_ctl.engine.radio.switch import RadioRoute, Switch
from swarm_ctl.mavlink.framer import Framer
from swarm_ctl.mavlink.wires import memory_wires
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_sim.world.world import STEP_S
from tests.scenarios.swarm import VirtualSwarm

_AGENT: Final = ("agent", 1)
_TURN_BYTES: Final = 256
_BUFFER_BYTES: Final = 2048
_LATENCY_S: Final = 0.03
"""From the end of a packet to its bytes at the other end's serial port."""
_LOCAL_POSITION: Final = 32


class Channel:
    """Half duplex. Sender 0 is the ground, the others are vehicles."""

    def __init__(self, bytes_per_s: float, senders: int) -> None:
        self.bytes_per_s = bytes_per_s
        self._buffers = [deque[bytes]() for _ in range(senders)]
        self._sizes = [0] * senders
        self._turn = 0
        self._free_s = 0.0
        self._under_way: deque[tuple[float, int, bytes]] = deque()
        self.overflows = 0

    def send(self, sender: int, data: bytes) -> None:
        if self._sizes[sender] + len(data) > _BUFFER_BYTES:
            self.overflows += 1
            return
        self._buffers[sender].append(data)
        self._sizes[sender] += len(data)

    def step(self, now: float) -> list[tuple[int, bytes]]:
        """What has arrived by now, with its sender."""
        self._free_s = max(self._free_s, now - STEP_S)
        while self._free_s < now and any(self._sizes):
            self._turn = (self._turn + 1) % len(self._buffers)
            packet = b""
            while self._buffers[self._turn] and len(packet) < _TURN_BYTES:
                packet += self._buffers[self._turn].popleft()
            self._sizes[self._turn] -= len(packet)
            self._free_s += len(packet) / self.bytes_per_s
            if packet:
                self._under_way.append((self._free_s + _LATENCY_S, self._turn, packet))
        arrived = []
        while self._under_way and self._under_way[0][0] <= now:
            arrived.append(self._under_way.popleft()[1:])
        return arrived


class RadioSwarm(VirtualSwarm):
    """All vehicles of the mission's fleet are behind one radio, and their agents at its link."""

    def __init__(self, mission: LoadedMission, **more: Any) -> None:
        self._channel: Channel | None = None
        super().__init__(mission, **more)
        entries = mission.fleet.agents
        share = entries[0].radio
        assert share is not None
        signed = more.get("signed_from") is not None
        self.channel = self._channel = Channel(share.bytes_per_s, len(entries) + 1)
        ground, self._ground = memory_wires()
        places = [
            RadioRoute(entry, far, budget(share, entry.autopilot, signed=signed).hz)
            for entry, far in zip(entries, self._far, strict=True)
        ]
        self.switch = Switch(ground, places, share.endpoint, share.bytes_per_s)
        self.link_alive = True
        self.position_ages_s: list[float] = []
        """Of each position that reached the ground."""

    def _transmit(self, link: int, data: bytes, to: Any) -> None:
        if to == _AGENT and self._channel is not None:
            self._channel.send(link + 1, data)

    def _run_world(self) -> None:
        while self.hub.world.next_s <= self.now + STEP_S / 2:
            self._pass(self.hub.world.next_s)
            self.hub.step()
            self._watch_distances()

    def _pass(self, now: float) -> None:
        while (data := self._ground.read()) is not None:
            self.channel.send(0, data)
        for sender, data in self.channel.step(now):
            if sender:
                self._note_ages(data, now)
                self._ground.write(data)
            else:
                for place in range(len(self._far)):
                    self.hub.receive(place, data, _AGENT)
        if self.link_alive:
            self.switch.turn(now)

    def _note_ages(self, data: bytes, now: float) -> None:
        for frame in Framer().feed(data):
            if frame.message_id == _LOCAL_POSITION:
                self.position_ages_s.append(now - int.from_bytes(frame.raw[10:14], "little") * 1e-3)

    def load(self) -> RadioLoad:
        return self.switch.load(self.now)
