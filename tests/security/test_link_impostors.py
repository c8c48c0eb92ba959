"""Impostors on a vehicle's link: each row flies an open link, where the attack does harm, and a
signed one, where the flight is the one without an attack.

At the vehicle the attack is a forced disarm, at the agent a place 4 m under the true one.
"""

from __future__ import annotations

import contextlib
import math
import socket
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.vehicle import StandbyGoal
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.mavlink.framer import Framer, MavlinkFrame
from swarm_ctl.mavlink.link import VehicleLink
from swarm_ctl.mavlink.outgoing import ARM_DISARM, FORCE, command
from swarm_ctl.mavlink.signing import UNITS_S, LinkSigning, SigningRefusal
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm, key_of
from swarm_sim.network.hub import MAX_CLIENTS
from tests.scenarios.swarm import flown_once
from tests.unit.mavlink import wire

SYSID: Final = 1
START: Final = 10**12
STRANGER: Final = ("attacker", 1)
ATTACK_S: Final = (12.5, 14.5)
END_S: Final = 15.5
MISSION: Final = """
version: 1
name: alone
origin: {{lat_deg: -35.363262, lon_deg: 149.165237, alt_m: 584}}
lengths: metres
law: {{r: 40, r_out: 7, r_in: 2.5}}
fleet: {{agents: [{{id: 1, autopilot: {persona}}}]}}
agents: [{{id: 1, start: [0, 0]}}]
shapes: {{row: {{kind: line, spacing: 10}}}}
steps:
  - takeoff: {{height_m: 6}}
  - form: {{shape: row, tolerance_m: 1, settle_s: 1}}
  - hold: {{duration_s: 60}}
  - land
"""


def mission(persona: str = "ardupilot") -> LoadedMission:
    return loads(MISSION.format(persona=persona))


# --- what a stranger makes ---


def codec(source: tuple[int, int], key: bytes | None = None, stamp: int = 0) -> Any:
    made = dialect.MAVLink(None, *source)
    if key is not None:
        made.signing.secret_key, made.signing.sign_outgoing = key, True
        made.signing.timestamp = stamp
    return made


@dataclass(frozen=True)
class Forgery:
    """How a frame is forged, and by which reason a signed agent refuses it."""

    name: str
    why: SigningRefusal
    make: Callable[[Any, tuple[int, int], int], bytes]
    """Of a message, a sender (system, component), and the stamp of now."""


OTHER_KEY: Final = bytes(range(32))
FORGERIES: Final = (
    Forgery("unsigned", SigningRefusal.UNSIGNED, lambda m, s, _: m.pack(codec(s))),
    Forgery(
        "MAVLink 1", SigningRefusal.MAVLINK_1, lambda m, s, _: m.pack(codec(s), force_mavlink1=True)
    ),
    Forgery(
        "wrong key",
        SigningRefusal.WRONG_KEY,
        lambda m, s, now: m.pack(codec(s, OTHER_KEY, now + 1)),
    ),
    Forgery(
        "the last stamp",
        SigningRefusal.WRONG_KEY,
        lambda m, s, _: m.pack(codec(s, OTHER_KEY, 2**48 - 1)),
    ),
    Forgery(
        "another vehicle's key",
        SigningRefusal.WRONG_KEY,
        lambda m, s, now: m.pack(codec(s, key_of(SYSID + 1), now + 1)),
    ),
)


# --- the flight ---


class Flight(VirtualSwarm):
    """One vehicle that takes off and holds."""

    def __init__(self, *, signed: bool, persona: str = "ardupilot", start: int = START) -> None:
        self.to_vehicle: list[bytes] = []
        self.to_agent: list[bytes] = []
        self.path: list[tuple[float, float, float]] = []
        self._ambush = b""
        super().__init__(mission(persona), signed_from=start if signed else None)

    @property
    def link(self) -> VehicleLink:
        return self.members[1].link

    @property
    def stamp(self) -> int:
        return START + round(self.now * UNITS_S)

    def hold(
        self, attack: Callable[[Flight], None] = lambda _: None, until_s: float = END_S
    ) -> None:
        """The attack is made each tick of `ATTACK_S`."""
        while self.now < until_s and self.members[1].alive:
            if ATTACK_S[0] <= self.now < ATTACK_S[1]:
                attack(self)
            self.tick()
            self.path.append(tuple(self.hub.world.positions()[0]))

    def _run_world(self) -> None:
        waiting = list(self._far[0]._inbox)
        self.to_vehicle += waiting
        super()._run_world()
        if self._ambush:
            self._far[0].write(self._ambush)
        self._ambush = b""

    def _transmit(self, link: int, data: bytes, to: Any) -> None:
        self.to_agent.append(data)
        super()._transmit(link, data, to)

    def strike_vehicle(self, data: bytes) -> None:
        self.hub.receive(0, data, STRANGER)

    def strike_agent(self, data: bytes) -> None:
        """Behind what the vehicle says in this tick."""
        self._ambush = data

    def off_m(self) -> float:
        """How far it was from where it is without an attack, at most."""
        return max(math.dist(a, b) for a, b in zip(self.path, unharmed(), strict=False))


@cache
def unharmed() -> tuple[tuple[float, float, float], ...]:
    flight = holding(signed=False)
    flight.hold()
    assert flight.members[1].alive
    return tuple(flight.path)


@flown_once
def holding(*, signed: bool, start: int = START) -> Flight:
    """A flight up to the attack."""
    flight = Flight(signed=signed, start=start)
    flight.hold(until_s=ATTACK_S[0])
    return flight


def assert_unharmed(flight: Flight, why: SigningRefusal | None = None) -> None:
    assert flight.members[1].alive
    assert len(flight.path) == len(unharmed())
    assert flight.off_m() < 0.05
    if why is not None:
        status = flight.members[1].status
        assert status is not None
        assert status.vehicle_link is not None
        assert status.vehicle_link.refusals[why] >= 20
        assert f"{why} frames for vehicle {SYSID} refused: " in status.vehicle_link.refused


def agent_source(flight: Flight) -> tuple[int, int]:
    return flight._mission.fleet.agent(1).agent_sysid, 191


def disarm() -> Any:
    return command(SYSID, ARM_DISARM, 0.0, FORCE)


def places(flight: Flight) -> list[MavlinkFrame]:
    """What the vehicle has said of its place."""
    return [frame for data in flight.to_agent for frame in in_place(data)]


def in_place(data: bytes) -> list[MavlinkFrame]:
    """The frames that say a place."""
    number = dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    return [frame for frame in Framer().feed(data) if frame.message_id == number]


def false_place(flight: Flight) -> Any:
    newest = next(frames[-1] for data in reversed(flight.to_agent) if (frames := in_place(data)))
    true = dialect.MAVLink(None).decode(bytearray(newest.raw))
    return wire.local_position((true.x, true.y, true.z + 4.0), (0, 0, 0), true.time_boot_ms)


# --- rows ---


@pytest.mark.parametrize("forgery", FORGERIES, ids=lambda each: each.name)
def test_a_forged_disarm(forgery: Forgery) -> None:
    def attack(flight: Flight) -> None:
        sender = agent_source(flight) if round(flight.now * 20) % 2 else (255, 190)
        flight.strike_vehicle(forgery.make(disarm(), sender, flight.stamp))

    harmed, signed = holding(signed=False), holding(signed=True)
    harmed.hold(attack)
    assert harmed.off_m() > 3.0
    signed.hold(attack)
    assert_unharmed(signed)
    assert signed.hub.codecs[0].unsigned >= 20


@pytest.mark.parametrize("forgery", FORGERIES, ids=lambda each: each.name)
def test_a_forged_position(forgery: Forgery) -> None:
    def attack(flight: Flight) -> None:
        flight.strike_agent(forgery.make(false_place(flight), (SYSID, 1), flight.stamp))

    harmed, signed = holding(signed=False), holding(signed=True)
    harmed.hold(attack)
    assert harmed.off_m() > 1.0
    signed.hold(attack)
    assert_unharmed(signed, forgery.why)


def test_a_replayed_landing() -> None:
    """What the agent sent at the end of its last flight, with the same key."""
    for is_signed in (False, True):
        before = Flight(signed=is_signed, start=START - 3600 * UNITS_S)
        before.hold()
        before.to_vehicle.clear()
        before.command("land")
        before.run(2.0)
        recorded = b"".join(before.to_vehicle)

        def attack(flight: Flight, recorded: bytes = recorded) -> None:
            flight.strike_vehicle(recorded)

        flight = holding(signed=is_signed)
        flight.hold(attack)
        if is_signed:
            assert_unharmed(flight)
            assert flight.hub.codecs[0].unsigned >= 20
        else:
            assert flight.off_m() > 1.0


def test_replayed_positions() -> None:
    """What the vehicle said on its way up, in this very flight."""
    for is_signed in (False, True):
        flight = holding(signed=is_signed)

        def attack(flight: Flight) -> None:
            flight.strike_agent(places(flight)[120 + round(flight.now * 20) % 20].raw)

        flight.hold(attack)
        if is_signed:
            assert_unharmed(flight, SigningRefusal.REPLAYED)
        else:
            assert flight.off_m() > 1.0


def test_a_stranger_that_is_there_first_keeps_the_agent_from_no_signed_vehicle() -> None:
    """A PX4 answers its first partner alone."""
    for is_signed in (False, True):
        flight = Flight(signed=is_signed, persona="px4")
        for _ in range(200):
            flight.strike_vehicle(wire.heartbeat().pack(codec((255, 190))))
            flight.tick()
        heard = math.isfinite(flight.link.view().heartbeat_s)
        assert heard is is_signed


def test_forty_ground_stations_take_no_signed_agent_its_place() -> None:
    """They are there first, and flood its port."""
    for is_signed in (False, True):
        flight = Flight(signed=is_signed)
        for _ in range(200):
            for number in range(40):
                frame = wire.heartbeat().pack(codec((200, number)))
                flight.hub.receive(0, frame, ("attacker", number))
            flight.tick()
        assert len(flight.hub._clients[0]) <= MAX_CLIENTS
        heard = math.isfinite(flight.link.view().heartbeat_s)
        assert heard is is_signed


def test_a_stranger_sets_no_key_where_there_is_one() -> None:
    """On an open link the first key is anyone's, as the firmwares have it."""
    message = dialect.MAVLink_setup_signing_message(SYSID, 1, list(OTHER_KEY), START)
    for is_signed in (False, True):
        flight = Flight(signed=is_signed)
        flight.strike_vehicle(message.pack(codec((255, 190))))
        flight.hold()
        if is_signed:
            assert_unharmed(flight)
        else:
            assert flight.off_m() > 1.0, "the vehicle listens to the stranger alone"


@pytest.mark.parametrize("is_signed", [False, True])
def test_a_stranger_on_the_agent_s_port_gets_setpoints_of_a_silent_vehicle_on_an_open_link_alone(
    is_signed: bool,
) -> None:
    """While the vehicle is heard, it stays the partner; without signatures nothing tells the
    stranger from a vehicle that has moved to another address."""
    (port,) = free_ports(1, socket.SOCK_DGRAM)
    signing = LinkSigning(key_of(SYSID), START) if is_signed else None
    vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link = VehicleLink(f"udpin:127.0.0.1:{port}", "ardupilot", SYSID, signing=signing)
    with vehicle, stranger, contextlib.closing(link):
        key = key_of(SYSID) if is_signed else None
        vehicle.settimeout(2.0)
        stranger.settimeout(2.0)

        def hears_setpoints(now: float, *senders: tuple[socket.socket, bytes | None]) -> None:
            for sender, own_key in senders:
                frame = wire.heartbeat().pack(codec((SYSID, 1), own_key, START + 1))
                sender.sendto(frame, ("127.0.0.1", port))
                link.receive(now)
            link.pursue(StandbyGoal(), now)

        hears_setpoints(1.0, (vehicle, key), (stranger, None))
        assert vehicle.recv(300)[0] == 0xFD
        hears_setpoints(3.0, (stranger, None))
        assert (stranger if not is_signed else vehicle).recv(300)[0] == 0xFD
