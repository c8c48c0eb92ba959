"""Bytes in memory: a client's pymavlink against a vehicle, without a socket, and the truth it
leaves."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_sim.network.hub import FORGET_S, MAX_CLIENTS, Hub
from swarm_sim.network.sockets import Address
from swarm_sim.world.truth_recorder import TruthFile, TruthRecorder
from swarm_sim.world.world import STEP_S
from tests.unit.sim.harness import GUIDED, config


class Clients:
    """A hub, and what each address has received from it."""

    def __init__(self, n: int = 1, **more: Any) -> None:
        self.datagrams: dict[Address, list[bytes]] = {}
        self.hub = Hub(config(n, **more), 0.0, self._take)
        self._mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)

    def tell(self, place: int, sender: Address, message: Any) -> None:
        self.hub.receive(place, bytes(message.pack(self._mav)), sender)

    def command(self, place: int, sender: Address, command: int, *p: float) -> None:
        numbers = [*p, *[0.0] * (7 - len(p))]
        self.tell(
            place, sender, mavlink.MAVLink_command_long_message(place + 1, 1, command, 0, *numbers)
        )

    def heard(self, address: Address) -> list[Any]:
        parser = mavlink.MAVLink(None)
        return [
            m for data in self.datagrams.get(address, []) for m in parser.parse_buffer(data) or []
        ]

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.hub.step()

    def _take(self, _place: int, data: bytes, to: Address) -> None:
        self.datagrams.setdefault(to, []).append(data)


A, B = ("127.0.0.1", 1), ("127.0.0.1", 2)
HELLO = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def test_a_px4_answers_its_first_partner_alone_until_it_reboots() -> None:
    clients = Clients(persona="px4")
    clients.tell(0, A, HELLO)
    clients.run(4.0)
    clients.command(0, B, 400, 1.0)
    assert clients.hub.world.vehicles[0].firmware.armed, "it obeys the other one"
    assert [m.command for m in clients.heard(A) if m.get_type() == "COMMAND_ACK"] == [400]
    assert B not in clients.datagrams
    clients.hub.world.vehicles[0].firmware.parameters.set("SIM_REBOOT", 1.0)
    clients.run(10.0)
    clients.tell(0, B, HELLO)
    clients.run(2.0)
    assert clients.heard(B)


def test_frames_of_one_step_share_a_datagram_within_a_packet_s_size() -> None:
    clients = Clients()
    clients.tell(0, A, mavlink.MAVLink_param_request_list_message(1, 1))
    clients.run(1.0)
    assert max(map(len, clients.datagrams[A])) <= 1400
    values = [m for m in clients.heard(A) if m.get_type() == "PARAM_VALUE"]
    assert len(values) == values[0].param_count
    assert len(clients.datagrams[A]) < len(values) / 5


def test_a_new_client_takes_the_place_of_one_that_is_silent_and_of_no_other() -> None:
    """40 ground stations at once take no place from those that are there."""
    clients = Clients()
    for i in range(MAX_CLIENTS):
        clients.tell(0, ("127.0.0.1", i), HELLO)
    for i in range(100, 140):
        clients.tell(0, ("127.0.0.1", i), HELLO)
    clients.run(2.0)
    assert set(clients.datagrams) == {("127.0.0.1", i) for i in range(MAX_CLIENTS)}
    clients.run(4.0)
    clients.tell(0, ("127.0.0.1", 0), HELLO)
    clients.tell(0, ("127.0.0.1", 99), HELLO)
    clients.datagrams.clear()
    clients.run(2.0)
    assert ("127.0.0.1", 1) not in clients.datagrams
    assert {("127.0.0.1", 0), ("127.0.0.1", 99)} <= set(clients.datagrams)


def read(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_truth_is_readable_at_any_time_and_says_what_the_brief_says(tmp_path: Path) -> None:
    path = tmp_path / "run" / "truth.jsonl"
    clients = Clients(2, spacing_m=4.0)
    settings = config(2, spacing_m=4.0)
    recorder = TruthRecorder(clients.hub.world, settings, TruthFile(path), clocked=True)
    clients.hub.recorder = recorder
    clients.command(0, A, 176, 1, GUIDED)
    clients.command(0, A, 400, 1)
    clients.command(0, A, 22, 0, 0, 0, 0, 0, 0, 3.0)
    clients.run(10.0)
    (before_end, header) = (read(path), read(path)[0])
    assert header == {
        "type": "header",
        "version": 1,
        "t": 0.0,
        "origin": settings.origin.model_dump(),
        "sysids": [1, 2],
        "epoch_s": settings.epoch_s,
        "speedup": settings.speedup,
    }
    states = [line for line in before_end if line["type"] == "state"]
    assert len(states) == pytest.approx(100, abs=1)
    assert {k: len(states[0][k]) for k in ("ned", "vel", "armed", "airborne")} == dict.fromkeys(
        ("ned", "vel", "armed", "airborne"), 2
    )
    assert all(state["sysids"] == [1, 2] for state in states)
    assert states[-1]["armed"] == states[-1]["airborne"] == [1, 0]
    assert states[-1]["ned"][0] == pytest.approx([0.0, 0.0, -3.0], abs=0.2)
    minima = [pair for line in before_end if line["type"] == "min" for pair in line["pairs"]]
    assert minima
    assert minima[0][:2] == [1, 2]
    assert minima[-1][2] == pytest.approx(4.0, abs=0.01)
    assert [(x["sysid"], x["event"]) for x in before_end if x["type"] == "event"] == [
        (1, "liftoff")
    ]
    recorder.close()
    assert read(path)[-1] == {"type": "end", "t": clients.hub.world.time_s}


def _two_channels(persona: str) -> Clients:
    """One vehicle with a further endpoint, which is link 1."""
    clients = Clients(1, persona=persona)
    vehicle = config(1, persona).vehicles[0]
    further = vehicle.model_copy(update={"also": ("udpin:127.0.0.1:14701",)})
    both = config(1, persona).model_copy(update={"vehicles": (further,)})
    clients.hub = Hub(both, 0.0, clients._take)
    return clients


def test_a_channel_keeps_its_stream_rates_whatever_is_asked_on_another() -> None:
    clients = _two_channels("px4")
    clients.tell(0, A, HELLO)
    clients.tell(1, B, HELLO)
    slow = mavlink.MAVLink_command_long_message(1, 1, 511, 0, 32, 1e6, 0, 0, 0, 0, 0)
    clients.tell(1, B, slow)
    clients.run(2.0)
    clients.datagrams.clear()
    clients.run(2.0)
    names = {at: [m.get_type() for m in clients.heard(at)] for at in (A, B)}
    assert names[B].count("LOCAL_POSITION_NED") == 2
    assert names[A].count("LOCAL_POSITION_NED") == 60


def test_each_channel_counts_its_own_frames_so_that_no_client_sees_a_gap() -> None:
    clients = _two_channels("ardupilot")
    clients.tell(0, A, HELLO)
    clients.tell(1, B, mavlink.MAVLink_param_request_list_message(1, 1))
    clients.command(0, A, 512, 148)
    clients.run(2.0)
    for at in (A, B):
        counted = [m.get_seq() for m in clients.heard(at)]
        assert counted == list(range(len(counted)))
    assert "PARAM_VALUE" not in [m.get_type() for m in clients.heard(A)]
    parameters = len(clients.hub.world.vehicles[0].firmware.parameters)
    assert [m.get_type() for m in clients.heard(B)].count("PARAM_VALUE") == parameters


def test_a_further_channel_sends_heartbeats_alone_until_a_client_speaks_on_it() -> None:
    clients = _two_channels("px4")
    clients.run(1.0)
    clients.hub.listen(1, [B])
    clients.run(3.0)
    assert {m.get_type() for m in clients.heard(B)} == {"HEARTBEAT"}
    clients.tell(1, B, HELLO)
    clients.run(1.0)
    assert "ATTITUDE" in {m.get_type() for m in clients.heard(B)}


KEY = bytes(range(32))


def signed_clients(persona: str) -> tuple[Clients, Any]:
    """A vehicle with a key, and a codec that has it."""
    clients = Clients(persona=persona)
    clients.hub._signing[0].set_up(KEY, 10**9)
    codec = mavlink.MAVLink(None, 250, 191)
    codec.signing.secret_key, codec.signing.sign_outgoing = KEY, True
    codec.signing.timestamp = 10**9
    return clients, codec


@pytest.mark.parametrize("persona", ["ardupilot", "px4"])
def test_one_that_signs_takes_the_place_of_one_that_does_not(persona: str) -> None:
    clients, codec = signed_clients(persona)
    for i in range(40):
        clients.hub.receive(0, b"", ("127.0.0.1", 1000 + i))
    clients.hub.receive(0, bytes(HELLO.pack(codec)), A)
    clients.tell(0, B, HELLO)
    clients.run(2.0)
    assert A in clients.datagrams
    assert B not in clients.datagrams
    assert len(clients.hub._clients[0]) <= MAX_CLIENTS


AGENT = ("10.89.1.2", 6)


@pytest.mark.parametrize("persona", ["ardupilot", "px4"])
def test_from_another_computer_a_signed_vehicle_is_heard_only_with_its_key(persona: str) -> None:
    """Also by one that was there before the key, and by none with the key of another vehicle."""
    clients, codec = signed_clients(persona)
    other = mavlink.MAVLink(None, 250, 191)
    other.signing.secret_key, other.signing.sign_outgoing = bytes(32), True
    other.signing.timestamp = 10**9
    for i in range(40):
        clients.tell(0, ("10.89.1.7", 1000 + i), HELLO)
        clients.hub.receive(0, bytes(HELLO.pack(other)), ("10.89.1.7", 2000 + i))
    clients.run(2.0)
    assert not clients.datagrams
    assert len(clients.hub._clients[0]) == 0
    clients.hub.receive(0, bytes(HELLO.pack(codec)), AGENT)
    clients.run(2.0)
    assert set(clients.datagrams) == {AGENT}


def test_a_client_that_falls_silent_is_dropped_and_one_that_speaks_is_not() -> None:
    clients = Clients()
    clients.tell(0, A, HELLO)
    for _ in range(round(FORGET_S) + 2):
        clients.tell(0, B, HELLO)
        clients.run(1.0)
    clients.datagrams.clear()
    clients.run(2.0)
    assert set(clients.datagrams) == {B}


def test_one_partner_a_configured_address_and_a_connection_may_be_silent() -> None:
    for persona, endpoint in (("px4", "udpin"), ("ardupilot", "udpout"), ("ardupilot", "tcpin")):
        clients = Clients(persona=persona)
        vehicle = config(1, persona).vehicles[0]
        way = vehicle.model_copy(update={"endpoint": f"{endpoint}:127.0.0.1:14601"})
        both = config(1, persona).model_copy(update={"vehicles": (way,)})
        clients.hub = Hub(both, 0.0, clients._take)
        clients.hub.listen(0, [A])
        clients.run(FORGET_S + 3.0)
        clients.datagrams.clear()
        clients.run(2.0)
        assert A in clients.datagrams
        clients.hub.listen(0, [])
        assert (A in clients.hub._clients[0]) is (endpoint != "tcpin"), "disconnected"
