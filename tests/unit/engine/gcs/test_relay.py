"""The relay: who hears what, what is refused, and that no ground control software holds it up."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_ctl.engine.gcs.config import GcsAddress, RelayVehicle
from swarm_ctl.engine.gcs.gcs_process import BURST, RATE_HZ, GcsRelay, VehiclePort
from swarm_ctl.engine.gcs.gcs_socket import GcsSocket
from swarm_ctl.errors import LinkError
from swarm_ctl.mavlink.wires import MemoryWire, memory_wires

HELLO = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
ARMED = mavlink.MAVLink_heartbeat_message(2, 3, 128 | 1, 4, 4, 3)
DISARMED = mavlink.MAVLink_heartbeat_message(2, 3, 1, 4, 3, 3)


class Gcs:
    """A GCS on a port of its own."""

    def __init__(self, system: int = 255) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(2.0)
        self.port = int(self.socket.getsockname()[1])
        self._mav = mavlink.MAVLink(None, system, 190)

    def tell(self, message: Any, port: int) -> None:
        self.tell_bytes(message.pack(self._mav), port)

    def tell_bytes(self, data: bytes, port: int) -> None:
        self.socket.sendto(data, ("127.0.0.1", port))

    def heard(self) -> list[Any]:
        """All that waits for it."""
        parser, found = mavlink.MAVLink(None), []
        self.socket.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while True:
                found += parser.parse_buffer(self.socket.recv(65535)) or []
        return found


class Bench:
    """Vehicles 1 and 2 (and a third behind its agent's only link), one GCS, the relay between."""

    def __init__(self) -> None:
        self.gcs = Gcs()
        self.own_port = _free_port()
        self.vehicles: dict[int, MemoryWire] = {}
        ports = []
        for sysid in (1, 2, 3):
            here, there = memory_wires()
            self.vehicles[sysid] = there
            config = RelayVehicle(sysid, sysid, 251 - sysid, "memory", shared=sysid == 3)
            ports.append(VehiclePort(config, here))
        self.sockets = [GcsSocket(GcsAddress("127.0.0.1", self.gcs.port, self.own_port), 0.0)]
        self.relay = GcsRelay(ports, self.sockets)
        self.now = 0.0

    def step(self, seconds: float = 0.01) -> None:
        self.now += seconds
        self.relay.step(self.now)

    def says(self, sysid: int, message: Any, component: int = 1, by: int | None = None) -> None:
        """A vehicle sends; `by`: it forwards a frame of another system."""
        self.vehicles[sysid].write(message.pack(mavlink.MAVLink(None, by or sysid, component)))

    def got(self, sysid: int) -> list[Any]:
        """What the vehicle has received."""
        parser, wire, found = mavlink.MAVLink(None), self.vehicles[sysid], []
        while (chunk := wire.read()) is not None:
            found += parser.parse_buffer(chunk) or []
        return found


def _free_port() -> int:
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    for each in bench.sockets:
        each.close()
    bench.gcs.socket.close()


def command(target: int, number: int = 400) -> Any:
    return mavlink.MAVLink_command_long_message(target, 1, number, 0, 1, 0, 0, 0, 0, 0, 0)


def test_a_gcs_that_has_not_spoken_hears_all_vehicles_and_their_components(bench: Bench) -> None:
    bench.says(1, DISARMED)
    bench.says(2, DISARMED, component=154)
    bench.step()
    assert [(m.get_srcSystem(), m.get_srcComponent()) for m in bench.gcs.heard()] == [
        (1, 1),
        (2, 154),
    ]


def test_what_a_vehicle_forwards_of_other_systems_is_not_passed_on(bench: Bench) -> None:
    """An ArduPilot forwards its agent's heartbeats: a GCS would show a vehicle more."""
    bench.says(1, HELLO, by=250)
    bench.step()
    assert bench.gcs.heard() == []


def test_messages_that_the_dialect_does_not_know_pass_both_ways(bench: Bench) -> None:
    """AVAILABLE_MODES (435) is newer than the dialect; a GCS asks every vehicle for it."""
    newer = bytes([0xFD, 3, 0, 0, 0, 1, 1, 435 & 0xFF, 435 >> 8, 0]) + b"abc" + b"\x12\x34"
    bench.vehicles[1].write(newer)
    bench.step()
    assert bench.gcs.socket.recv(1000) == newer
    theirs = newer[:5] + bytes([255, 190]) + newer[7:]
    bench.gcs.tell_bytes(theirs, bench.own_port)
    bench.step()
    assert bench.vehicles[1].read() == bench.vehicles[2].read() == theirs


def test_a_frame_with_a_target_goes_to_that_vehicle_and_others_to_all(bench: Bench) -> None:
    bench.gcs.tell(command(2), bench.own_port)
    bench.step()
    assert [len(bench.got(i)) for i in (1, 2, 3)] == [0, 1, 0]
    bench.gcs.tell(HELLO, bench.own_port)
    bench.gcs.tell(command(0), bench.own_port)
    bench.step()
    assert [len(bench.got(i)) for i in (1, 2, 3)] == [2, 2, 2]


def test_a_frame_for_another_system_goes_to_no_vehicle(bench: Bench) -> None:
    bench.gcs.tell(command(77), bench.own_port)
    bench.step()
    assert [bench.got(i) for i in (1, 2, 3)] == [[], [], []]
    assert bench.relay.astray == 1


def test_who_speaks_with_an_agents_or_a_vehicles_id_is_refused_and_named(bench: Bench) -> None:
    """An agent's heartbeats hold its vehicle's failsafe back: no GCS may fake them."""
    for system, owner in ((249, "agent 2"), (1, "vehicle 1")):
        impostor = Gcs(system)
        impostor.tell(HELLO, bench.own_port)
        bench.step()
        assert any(f"id of {owner}, {system}" in note for note in bench.relay.notes)
        impostor.socket.close()
    assert [bench.got(i) for i in (1, 2, 3)] == [[], [], []]
    assert bench.relay.refused == 2


def test_a_second_gcs_that_writes_hears_the_vehicles_too_and_is_forgotten(bench: Bench) -> None:
    other = Gcs()
    other.tell(HELLO, bench.own_port)
    bench.step()
    bench.says(1, DISARMED)
    bench.step()
    assert len(other.heard()) == 1
    bench.step(100.0)
    bench.says(1, DISARMED)
    bench.step()
    assert other.heard() == []
    assert len(bench.gcs.heard()) == 2
    other.socket.close()


def test_a_flood_is_cut_to_the_rate_and_the_other_gcs_is_heard_at_once(bench: Bench) -> None:
    pilot = Gcs(254)
    sent = 0
    for _ in range(100):  # one second, 5,000 frames
        for _ in range(50):
            bench.gcs.tell(command(1), bench.own_port)
            sent += 1
        bench.step()
    assert len(bench.got(1)) <= RATE_HZ + BURST
    assert sent == 5000
    pilot.tell(command(1, 176), bench.own_port)
    for _ in range(20):  # the flood before it waits in the system's buffer
        bench.step()
    assert [m.command for m in bench.got(1) if m.get_srcSystem() == 254] == [176]
    assert any("more than 100 frames a second to vehicle 1" in n for n in bench.relay.notes)
    pilot.socket.close()


def test_stream_rates_of_an_agents_only_link_are_the_agents(bench: Bench) -> None:
    streams = mavlink.MAVLink_request_data_stream_message(0, 0, 0, 4, 1)
    interval = mavlink.MAVLink_command_long_message(3, 1, 511, 0, 32, 1e6, 0, 0, 0, 0, 0)
    bench.gcs.tell(streams, bench.own_port)
    bench.gcs.tell(interval, bench.own_port)
    bench.gcs.tell(command(3, 512), bench.own_port)
    bench.step()
    assert [m.get_type() for m in bench.got(1)] == ["REQUEST_DATA_STREAM"]
    assert [m.command for m in bench.got(3)] == [512]


def test_it_knows_whether_a_vehicle_flies(bench: Bench) -> None:
    assert not bench.relay.flying(bench.now)
    bench.says(2, ARMED)
    bench.step()
    assert bench.relay.flying(bench.now)
    assert not bench.relay.flying(bench.now + 6.0)
    bench.says(2, DISARMED)
    bench.step()
    assert not bench.relay.flying(bench.now)


def test_a_vehicle_that_listens_is_greeted_by_an_empty_datagram() -> None:
    """It sends to those that it has heard; a heartbeat would count as a GCS that lives."""
    vehicle = Gcs()
    port = VehiclePort(RelayVehicle(1, 1, 250, f"udpout:127.0.0.1:{vehicle.port}"))
    port.take(0.0)
    assert vehicle.socket.recv(100) == b""
    port.close()
    vehicle.socket.close()


def test_a_taken_port_is_named() -> None:
    holder = Gcs()
    with pytest.raises(LinkError, match=r"--gcs 127\.0\.0\.1:14550: can.t be opened"):
        GcsSocket(GcsAddress("127.0.0.1", 14550, holder.port), 0.0)
    holder.socket.close()


def test_a_gcs_without_the_key_hears_a_signed_vehicle_and_is_told_that_it_commands_none(
    bench: Bench,
) -> None:
    """Its frames pass as they are: the vehicle judges them."""
    codec = mavlink.MAVLink(None, 1, 1)
    codec.signing.secret_key, codec.signing.sign_outgoing = bytes(32), True
    bench.vehicles[1].write(bytes(ARMED.pack(codec)))
    bench.step()
    bench.gcs.tell(HELLO, bench.own_port)
    bench.step()
    assert [message.get_header().incompat_flags for message in bench.gcs.heard()] == [1]
    found = [note for note in bench.relay.notes if "does not sign" in note]
    assert len(found) == 1
    assert "vehicle 1 does not obey it (its key, or the RC, takes it over)" in found[0]


# --- what keeps a vehicle safe ---

PX4_FLOWN = mavlink.MAVLink_heartbeat_message(2, 12, 128 | 1, 6 << 16, 4, 3)
POSCTL = mavlink.MAVLink_heartbeat_message(2, 12, 128 | 1, 3 << 16, 4, 3)


def setting(name: str, target: int = 1) -> Any:
    return mavlink.MAVLink_param_set_message(target, 1, name.encode(), 0.0, 9)


def ftp(opcode: int) -> Any:
    payload = [1, 0, 0, opcode, 0, 0, *bytes(245)]
    return mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload)


@pytest.mark.parametrize(
    "message",
    [
        setting("FS_GCS_ENABLE"),
        setting("fs_gcs_enable"),
        setting("BATT_FS_LOW_ACT"),
        ftp(6),
        ftp(7),
    ],
)
def test_what_keeps_a_vehicle_safe_is_not_changed_while_an_agent_flies_it(
    bench: Bench, message: Any
) -> None:
    """FS_GCS_ENABLE 0 went through, the agent died, and the vehicle hovered for ever."""
    bench.says(1, ARMED)
    bench.step()
    bench.gcs.heard()
    for _ in range(3):
        bench.gcs.tell(message, bench.own_port)
        bench.step()
    assert bench.got(1) == []
    (answer,) = bench.gcs.heard()
    assert (answer.get_type(), answer.get_srcSystem()) == ("STATUSTEXT", 1)
    assert answer.text.startswith("refused: ")
    assert "while an agent flies" in answer.text
    assert len([note for note in bench.relay.notes if note.endswith("flies: refused")]) == 1
    assert bench.relay.refused == 3


def test_a_change_to_all_vehicles_reaches_those_alone_that_no_agent_flies(bench: Bench) -> None:
    bench.says(1, ARMED)
    bench.says(2, PX4_FLOWN)
    bench.says(3, DISARMED)
    bench.step()
    bench.gcs.tell(setting("COM_OBL_RC_ACT", 0), bench.own_port)
    bench.step()
    assert [len(bench.got(i)) for i in (1, 2, 3)] == [0, 0, 1]


@pytest.mark.parametrize("told", [DISARMED, POSCTL])
def test_a_pilot_and_an_owner_on_the_ground_may_set_all(bench: Bench, told: Any) -> None:
    bench.says(1, ARMED)
    bench.step()
    bench.says(1, told)
    bench.step()
    bench.gcs.tell(setting("FS_GCS_ENABLE"), bench.own_port)
    bench.gcs.tell(ftp(6), bench.own_port)
    bench.step()
    assert len(bench.got(1)) == 2


def test_other_parameters_and_reading_files_pass_while_an_agent_flies(bench: Bench) -> None:
    bench.says(1, ARMED)
    bench.step()
    for message in (setting("WPNAV_SPEED"), ftp(4), command(1)):
        bench.gcs.tell(message, bench.own_port)
    bench.step()
    assert len(bench.got(1)) == 3
