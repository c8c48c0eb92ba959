"""Hostile bytes at full rate: whatever comes, nothing raises, nothing grows, and a good frame right
after is served."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_sim.firmware.flying.mission_items import MAX_ITEMS
from swarm_sim.firmware.message import Message
from swarm_sim.firmware.protocol.handlers import HANDLERS
from swarm_sim.network.codec import _BY_NAME, Codec
from swarm_sim.network.hub import MAX_CLIENTS
from tests.unit.sim.network.test_hub import A, Clients
from tests.unit.sim.test_codec import random_value

BAD_NUMBERS = (math.nan, math.inf, -math.inf, 3.4e38, -3.4e38, 1e-45, -0.0, 2.0**31, 250.0, 65535.0)
COMMANDS = (
    11,
    16,
    20,
    21,
    22,
    176,
    178,
    179,
    192,
    193,
    224,
    246,
    300,
    400,
    410,
    511,
    512,
    520,
    31999,
)


class Attacker:
    """Makes frames that no client should send."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self._codec = Codec(255)
        self._sent: list[bytes] = []
        self._kinds = [
            (self._truncated, 1),
            (self._flipped, 2),
            (self._unknown, 1),
            (self._too_long, 1),
            (self._replayed, 2),
            (self._noise, 1),
            (self._spiteful, 8),
            (self._any, 3),
        ]

    def datagram(self) -> bytes:
        """One to three of them."""
        kinds, weights = zip(*self._kinds, strict=True)
        made = b"".join(
            kind() for kind in self.rng.choices(kinds, weights, k=self.rng.randint(1, 3))
        )
        self._sent = [*self._sent[-50:], made]
        return made

    def _fields(self, name: str) -> dict[str, Any]:
        kind = mavlink.mavlink_map[_BY_NAME[name].id]
        sizes = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
        fields = {
            field: random_value(self.rng, of, sizes[field])
            for field, of in zip(kind.fieldnames, kind.fieldtypes, strict=True)
        }
        for field, of in zip(kind.fieldnames, kind.fieldtypes, strict=True):
            if of == "float" and not sizes[field] and self.rng.random() < 0.5:
                fields[field] = self.rng.choice(BAD_NUMBERS)
        if "target_system" in fields:
            fields["target_system"] = self.rng.choice([1, 1, 1, 0, 2, 255])
        return fields

    def _spiteful(self) -> bytes:
        name = self.rng.choice(sorted(HANDLERS))
        fields = self._fields(name)
        if "command" in fields:
            fields["command"] = self.rng.choice(COMMANDS)
        if "mission_type" in fields and self.rng.random() < 0.8:
            fields["mission_type"] = self.rng.choice([0, 0, 1, 2])
        if "count" in fields and self.rng.random() < 0.8:
            fields["count"] = self.rng.randint(0, 4)
        if "seq" in fields and self.rng.random() < 0.8:
            fields["seq"] = self.rng.randint(0, 4)
        if "param_id" in fields and self.rng.random() < 0.8:
            fields["param_id"] = self.rng.choice(
                [b"GUID_TIMEOUT", b"SIM_WIND_SPD", b"RTL_ALT", b"SIM_GPS_NOISE"]
            )
        return self._codec.pack(Message(name, fields))

    def _any(self) -> bytes:
        known = (name for name, kind in _BY_NAME.items() if kind.id in mavlink.mavlink_map)
        # A key would lock the good client out, too: tests/security has that row.
        known = (name for name in known if name != "SETUP_SIGNING")
        name = self.rng.choice(sorted(known))
        return self._codec.pack(Message(name, self._fields(name)))

    def _truncated(self) -> bytes:
        frame = self._spiteful()
        return frame[: self.rng.randint(1, len(frame) - 1)]

    def _flipped(self) -> bytes:
        frame = bytearray(self._spiteful())
        for _ in range(self.rng.randint(1, 4)):
            frame[self.rng.randrange(len(frame))] ^= 1 << self.rng.randrange(8)
        return bytes(frame)

    def _unknown(self) -> bytes:
        frame = bytearray(self._spiteful())
        frame[7:10] = self.rng.randrange(60000, 2**24).to_bytes(3, "little")
        return bytes(frame)

    def _too_long(self) -> bytes:
        layout = _BY_NAME[self.rng.choice(sorted(HANDLERS))]
        payload = self.rng.randbytes(255)
        head = bytes([0xFD, 255, 0, 0, 0, 255, 190]) + layout.id.to_bytes(3, "little")
        return (
            head
            + payload
            + mavlink.x25crc(head[1:] + payload + layout.extra).crc.to_bytes(2, "little")
        )

    def _replayed(self) -> bytes:
        return self.rng.choice(self._sent) if self._sent else b""

    def _noise(self) -> bytes:
        return self.rng.randbytes(self.rng.choice([0, 1, 7, 40, 300, 1400]))


def assault(persona: str, seed: int, datagrams: int) -> None:
    """Attacks a vehicle that flies, then asks something honest."""
    clients = Clients(2, persona=persona)
    attacker = Attacker(seed)
    clients.run(0.2)
    for k in range(datagrams):
        sender = ("10.0.0.1", attacker.rng.randrange(40))
        clients.hub.receive(0, attacker.datagram(), sender)
        if k % 10 == 0:
            clients.hub.step()
        if k % 200 == 0:
            clients.datagrams.clear()
            check(clients)
    for vehicle in clients.hub.world.vehicles:
        assert all(math.isfinite(x) for x in vehicle.sense().position_ned_m)


def check(clients: Clients) -> None:
    """Nothing has grown out of bounds; an honest question is answered."""
    firmware = clients.hub.world.vehicles[0].firmware
    assert len(clients.hub._clients[0]) <= MAX_CLIENTS
    assert len(firmware.outbox) == 0
    assert len(firmware.pending_parameters) <= len(firmware.parameters)
    assert all(len(items) <= MAX_ITEMS for items in firmware.missions.lists.values())
    assert all(math.isfinite(firmware.parameters[name]) for name in firmware.parameters.names)
    if clients.hub.world.time_s >= firmware.boot_s:  # not just restarting
        clients.command(0, A, 512, 148)
        there = clients.hub._clients[0]
        answered = next(iter(there)) if there.one_partner else A
        assert "AUTOPILOT_VERSION" in [m.get_type() for m in clients.heard(answered)]


@pytest.mark.parametrize("persona", ["ardupilot", "px4"])
def test_a_seeded_assault(persona: str) -> None:
    assault(persona, 1, 2500)


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("persona", ["ardupilot", "px4"])
@pytest.mark.parametrize("seed", range(100, 130))
def test_a_longer_assault(persona: str, seed: int) -> None:
    assault(persona, seed, 60_000)
