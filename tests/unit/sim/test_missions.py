"""Missions, fences and rally points: up, down, cleared; and the mission flown by both personas.
What two stations may do to each other's transfers: `tests/protocol/services.py`."""

from __future__ import annotations

import math
from typing import Any

import pytest

from swarm_sim.firmware.ardupilot_persona import ArdupilotPersona
from swarm_sim.firmware.flying.mission_items import MissionResult
from swarm_sim.firmware.message import Message
from swarm_sim.firmware.px4_persona import Px4Persona
from tests.unit.sim.harness import ARM, GUIDED, ORIGIN, SET_MODE, Flight, Rig, config

Persona = type[ArdupilotPersona | Px4Persona]
BOTH = pytest.mark.parametrize("persona", [ArdupilotPersona, Px4Persona])
NAMES = pytest.mark.parametrize("persona", ["ardupilot", "px4"])
TO: dict[str, Any] = {"target_system": 1, "target_component": 1}
WAYPOINT, RTL, LAND, TAKEOFF, START, PAUSE = 16, 20, 21, 22, 300, 193
SET_CURRENT, SPEED, JUMP, PX4_HOLD, PX4_MISSION = 224, 178, 177, (4, 3), (4, 4)


def item(
    command: int, north: float = 0.0, east: float = 0.0, up: float = 0.0, *p: float
) -> dict[str, Any]:
    """An item `north` and `east` [m] of the origin, `up` above home; no place where both are 0."""
    lat = round((ORIGIN.lat_deg + north / 111_200.0) * 1e7)
    lon = round(
        (ORIGIN.lon_deg + east / (111_320.0 * math.cos(math.radians(ORIGIN.lat_deg)))) * 1e7
    )
    here = north == east == 0.0
    numbers = {f"param{i + 1}": v for i, v in enumerate([*p, *[0.0] * (4 - len(p))])}
    place = {"x": 0 if here else lat, "y": 0 if here else lon, "z": up}
    frame = 2 if command in (RTL, JUMP, SPEED) else 6
    return {"frame": frame, "command": command, "current": 0, "autocontinue": 1} | numbers | place


def upload(rig: Rig, items: list[dict[str, Any]], kind: int = 0) -> list[int]:
    """Answers each request; the types of the acknowledgements."""
    rig.said.clear()
    rig.tell("MISSION_COUNT", **TO, count=len(items), mission_type=kind)
    for _ in range(len(items)):
        asked = [m for m in rig.said if m.name in ("MISSION_REQUEST", "MISSION_REQUEST_INT")]
        if not asked:
            break
        rig.said.clear()
        seq = asked[-1].fields["seq"]
        rig.tell("MISSION_ITEM_INT", **TO, **items[seq], seq=seq, mission_type=kind)
    return [m["type"] for m in rig.heard("MISSION_ACK")]


def download(rig: Rig, kind: int = 0, name: str = "MISSION_REQUEST_INT") -> list[dict[str, Any]]:
    """The whole list."""
    rig.said.clear()
    rig.tell("MISSION_REQUEST_LIST", **TO, mission_type=kind)
    (count,) = rig.heard("MISSION_COUNT")
    for seq in range(count["count"]):
        rig.tell(name, **TO, seq=seq, mission_type=kind)
    return rig.heard("MISSION_ITEM_INT" if name.endswith("INT") else "MISSION_ITEM")


def ready(persona: Persona) -> Rig:
    rig = Rig(persona)
    rig.run(3.0)
    return rig


HOME = item(WAYPOINT, 1.0, 1.0)
ROUND = [
    item(TAKEOFF, up=5.0),
    item(WAYPOINT, 20.0, 0.1, 5.0),
    item(WAYPOINT, 20.0, 15.0, 8.0),
    item(RTL),
]


@BOTH
@pytest.mark.parametrize("kind", [0, 1, 2])
def test_what_goes_up_comes_down(persona: Persona, kind: int) -> None:
    rig = ready(persona)
    command = {0: WAYPOINT, 1: 5001, 2: 5100}[kind]
    items = [item(command, 5.0 * i, 3.0 * i + 1.0, 10.0, 1.0, 2.0) for i in range(1, 6)]
    assert upload(rig, items, kind) == [MissionResult.ACCEPTED]
    got = download(rig, kind)
    assert [g["seq"] for g in got] == list(range(5))
    first = 1 if persona is ArdupilotPersona and kind == 0 else 0
    for sent, found in list(zip(items, got, strict=True))[first:]:
        assert {k: found[k] for k in sent if k != "current"} == {
            k: v for k, v in sent.items() if k != "current"
        }
    if first:
        here = (got[0]["x"] * 1e-7, got[0]["y"] * 1e-7)
        home = rig.firmware.plane.geodetic_from_ned(rig.firmware.home_ned)
        assert here == pytest.approx((home.lat_deg, home.lon_deg), abs=1e-7)
    others = {0, 1, 2} - {kind}
    assert all(download(rig, other) == [] for other in others)


def test_px4_asks_otherwise_when_its_client_does_not_know_the_request() -> None:
    """MAVSDK takes no MISSION_REQUEST from PX4, and says so."""
    rig = ready(Px4Persona)
    rig.tell("MISSION_COUNT", **TO, count=2, mission_type=0)
    for expected in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
        rig.said.clear()
        rig.tell("MISSION_ACK", **TO, type=3, mission_type=0)
        assert [(m.name, m.fields["seq"]) for m in rig.said] == [(expected, 0)]
    rig.said.clear()
    rig.tell("MISSION_ACK", (9, 9), **TO, type=3, mission_type=0)
    rig.tell("MISSION_ACK", **TO, type=0, mission_type=0)
    assert {m.name for m in rig.said} == {"STATUSTEXT"}, "the other partner"


@BOTH
def test_an_item_that_does_not_come_is_asked_for_again_then_the_upload_forgotten(
    persona: Persona,
) -> None:
    rig = ready(persona)
    assert upload(rig, [HOME, *ROUND]) == [0]
    rig.said.clear()
    rig.tell("MISSION_COUNT", **TO, count=3, mission_type=0)
    rig.run(4.5)
    asked = [m for m in rig.said if m.name.startswith("MISSION_REQUEST")]
    assert len(asked) >= 4
    rig.run(10.0)
    told = persona is ArdupilotPersona
    assert [m["type"] for m in rig.heard("MISSION_ACK")] == [MissionResult.CANCELLED] * told
    rig.said.clear()
    rig.run(5.0)
    assert not [m for m in rig.said if m.name.startswith("MISSION_REQUEST")]
    assert len(download(rig)) == 5, "the old list stays"


def test_a_part_of_a_list_is_replaced_by_arducopter() -> None:
    rig = ready(ArdupilotPersona)
    upload(rig, [HOME, *ROUND])
    before = download(rig)
    rig.said.clear()
    rig.tell("MISSION_WRITE_PARTIAL_LIST", **TO, start_index=2, end_index=3, mission_type=0)
    for seq in (2, 3):
        assert rig.heard("MISSION_REQUEST")[-1]["seq"] == seq
        new = item(WAYPOINT, 7.0, 7.0, 3.0)
        rig.tell("MISSION_ITEM_INT", **TO, **new, seq=seq, mission_type=0)
    assert [m["type"] for m in rig.heard("MISSION_ACK")] == [0]
    after = download(rig)
    assert [a == b for a, b in zip(after, before, strict=True)] == [True, True, False, False, True]
    rig.tell("MISSION_COUNT", **TO, count=3, mission_type=0)
    rig.said.clear()
    part = {"start_index": 0, "end_index": 0, "mission_type": 0}
    rig.tell("MISSION_WRITE_PARTIAL_LIST", (254, 190), **TO, **part)
    assert [m["type"] for m in rig.heard("MISSION_ACK")] == [MissionResult.DENIED], "another's"


@BOTH
def test_file_transfer_is_refused_at_once(persona: Persona) -> None:
    rig = ready(persona)
    payload = [7, 0, 0, 4, 0, 0, 0, 0] + [0] * 243
    rig.said.clear()
    rig.tell("FILE_TRANSFER_PROTOCOL", target_network=0, **TO, payload=payload)
    (answer,) = rig.heard("FILE_TRANSFER_PROTOCOL")
    assert (answer["payload"][0], answer["payload"][3], answer["payload"][5]) == (8, 129, 4)
    assert len(answer["payload"]) == 251


class Mission(Flight):
    """A flight of one vehicle with an uploaded mission."""

    def __init__(self, persona: str, items: list[dict[str, Any]]) -> None:
        super().__init__(config(1, persona))
        self.persona = persona
        self.reached: list[int] = []
        self.run(0.5)
        self.put([HOME, *items] if persona == "ardupilot" else items)

    def put(self, items: list[dict[str, Any]]) -> None:
        self.tell(0, "MISSION_COUNT", **TO, count=len(items), mission_type=0)
        for seq, each in enumerate(items):
            said = self.tell(0, "MISSION_ITEM_INT", **TO, **each, seq=seq, mission_type=0)
        assert [m.fields["type"] for m in said if m.name == "MISSION_ACK"] == [0]

    def start(self) -> None:
        if self.persona == "ardupilot":
            assert self.command(0, SET_MODE, 1, GUIDED) == 0
            assert self.command(0, ARM, 1) == 0
        assert self.command(0, START) == 0

    def collect(self) -> list[Message]:
        said = super().collect()
        self.reached += [m.fields["seq"] for m in said if m.name == "MISSION_ITEM_REACHED"]
        return said

    def current(self) -> dict[str, Any]:
        said = self.tell(0, "COMMAND_LONG", **TO, command=512, confirmation=0, param1=42.0, **_REST)
        return next(m.fields for m in said if m.name == "MISSION_CURRENT")


_REST = {f"param{i}": 0.0 for i in range(2, 8)}


@NAMES
def test_upload_start_finished(persona: str) -> None:
    flight = Mission(persona, ROUND)
    flight.start()
    first = 1 if persona == "ardupilot" else 0
    farthest = 0.0
    for _ in range(1500):
        flight.run(0.1)
        farthest = max(farthest, flight.ned()[0])
        if flight.world.parked():
            break
    assert flight.world.parked()
    assert flight.reached == [first, first + 1, first + 2, first + 3]
    assert farthest == pytest.approx(20.0, abs=2.5)
    assert flight.ned() == pytest.approx([0.0, 0.0, 0.0], abs=0.5)
    assert flight.current()["mission_state"] == 5


@NAMES
def test_a_mission_that_ends_in_the_air_hovers_there(persona: str) -> None:
    flight = Mission(persona, ROUND[:3])
    flight.start()
    flight.run(60.0)
    assert flight.ned() == pytest.approx([20.0, 15.0, -8.0], abs=1.0)
    assert flight.world.armed() == [True]
    if persona == "px4":
        assert flight.world.vehicles[0].firmware.mode.custom == 4 << 16 | 3 << 24


@NAMES
def test_land_at_a_place_disarms_there(persona: str) -> None:
    flight = Mission(persona, [ROUND[0], item(LAND, 12.0, -6.0)])
    flight.start()
    flight.run(90.0)
    assert flight.world.parked()
    assert flight.ned() == pytest.approx([12.0, -6.0, 0.0], abs=0.7)


@NAMES
def test_pause_and_go_on(persona: str) -> None:
    flight = Mission(persona, ROUND)
    flight.start()
    flight.run(12.0)
    px4 = persona == "px4"  # it is paused by its mode
    assert flight.command(0, PAUSE, 0) == (3 if px4 else 0)
    assert not px4 or flight.command(0, SET_MODE, 1, *PX4_HOLD) == 0
    flight.run(8.0)
    here = flight.ned()
    flight.run(10.0)
    assert flight.ned() == pytest.approx(here, abs=0.5)
    assert flight.current()["mission_state"] == 4
    assert (
        flight.command(0, SET_MODE, 1, *PX4_MISSION) if px4 else flight.command(0, PAUSE, 1)
    ) == 0
    flight.run(120.0)
    assert flight.world.parked()


@NAMES
def test_set_current_skips(persona: str) -> None:
    flight = Mission(persona, ROUND)
    flight.start()
    flight.run(8.0)
    last = 4 if persona == "ardupilot" else 3
    if persona == "ardupilot":
        assert flight.command(0, SET_CURRENT, last) == 0
    else:
        flight.tell(0, "MISSION_SET_CURRENT", **TO, seq=last)
    assert flight.current()["seq"] == last
    flight.run(60.0)
    assert flight.world.parked()
    assert last - 1 not in flight.reached
    assert flight.command(0, SET_CURRENT, 99) == {"ardupilot": 2, "px4": 3}[persona]  # MAV_RESULT
    said = flight.tell(0, "MISSION_SET_CURRENT", **TO, seq=last - 1)
    assert [m.fields["seq"] for m in said if m.name == "MISSION_CURRENT"] == [last - 1]


@NAMES
def test_items_that_take_no_time_and_speed(persona: str) -> None:
    fast, slow = item(SPEED, 0, 0, 0, 1.0, 4.0, -1.0), item(SPEED, 0, 0, 0, 1.0, 1.0, -1.0)
    far = item(WAYPOINT, 25.0, 0.1, 5.0)

    def time_of(speed: dict[str, Any]) -> float:
        flight = Mission(persona, [ROUND[0], speed, item(201), far])
        flight.start()
        while len(flight.reached) < 4:
            flight.run(0.1)
            assert flight.world.time_s < 120.0
        return flight.world.time_s

    assert time_of(slow) > time_of(fast) + 10.0


def test_jumps_repeat_and_circles_of_jumps_end() -> None:
    flight = Mission(
        "px4", [ROUND[0], item(WAYPOINT, 5.0, 0.1, 5.0), item(JUMP, 0, 0, 0, 1.0, 2.0)]
    )
    flight.start()
    flight.run(60.0)
    assert flight.reached.count(1) == 3
    flight = Mission("px4", [ROUND[0], item(JUMP, 0, 0, 0, 1.0, -1.0)])
    flight.start()
    flight.run(30.0)
    assert flight.ned()[2] == pytest.approx(-5.0, abs=0.5)


def test_arducopter_wants_a_take_off_first_and_a_mission_at_all() -> None:
    flight = Mission("ardupilot", ROUND[1:])
    assert flight.command(0, SET_MODE, 1, GUIDED) == 0
    assert flight.command(0, START) == 4, "not armed"
    assert flight.command(0, ARM, 1) == 0
    assert flight.command(0, START) == 4
    assert "Mode change to AUTO failed: Missing Takeoff Cmd" in flight.texts


def test_px4_climbs_first_where_no_take_off_is_in_the_mission() -> None:
    flight = Mission("px4", ROUND[1:2])
    flight.start()
    flight.run(6.5)
    north, _, down = flight.ned()
    assert abs(north) < 0.1
    assert down < -1.0
    flight.run(30.0)
    assert flight.ned()[0] == pytest.approx(20.0, abs=1.0)


@NAMES
def test_clearing_a_mission_in_flight_stops(persona: str) -> None:
    flight = Mission(persona, ROUND)
    flight.start()
    flight.run(12.0)
    flight.tell(0, "MISSION_CLEAR_ALL", **TO, mission_type=0)
    flight.run(6.0)
    here = flight.ned()
    flight.run(5.0)
    assert flight.ned() == pytest.approx(here, abs=0.3)
    assert flight.world.armed() == [True]
