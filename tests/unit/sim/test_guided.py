"""Places and headings of a guided flight: global setpoints, items flown at once, CONDITION_YAW."""

from __future__ import annotations

import math
from typing import Any

import pytest

from swarm_sim.physics.geodesy import GeodeticPoint
from tests.unit.sim.harness import ORIGIN, Flight, config

CONDITION_YAW, OFFBOARD = 115, 6 << 16
POSITION_ONLY = 0b110111111000
TO = {"target_system": 1, "target_component": 1}


def hovering(persona: str) -> Flight:
    """In the air, 10 m up, in the mode that obeys."""
    flight = Flight(config(1, persona))
    flight.run(2.0)
    flight.take_off()
    flight.run(25.0)
    return flight


def target(
    flight: Flight, north: float, east: float, alt_m: float, frame: int, **more: Any
) -> dict[str, Any]:
    """A SET_POSITION_TARGET_GLOBAL_INT for the harness' setpoints."""
    at = flight.world.plane.geodetic_from_ned((north, east, 0.0))
    where = {"lat_int": round(at.lat_deg * 1e7), "lon_int": round(at.lon_deg * 1e7), "alt": alt_m}
    names = ("vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
    mask = {"type_mask": POSITION_ONLY, "coordinate_frame": frame, "time_boot_ms": 0}
    return TO | where | mask | dict.fromkeys(names, 0.0) | more


def stream(flight: Flight, fields: dict[str, Any], seconds: float) -> None:
    """Sends it at 10 Hz; PX4 goes over to OFFBOARD once it has heard enough."""
    for k in range(round(seconds * 10)):
        flight.tell(0, "SET_POSITION_TARGET_GLOBAL_INT", **fields)
        if k == 15 and flight.world.vehicles[0].firmware.autopilot == 12:
            assert flight.command(0, 176, 1, 6) == 0
        flight.run(0.1)


@pytest.mark.parametrize(
    ("persona", "frame", "alt_m"),
    [
        ("ardupilot", 6, 15.0),
        ("ardupilot", 0, ORIGIN.alt_m + 15.0),
        ("px4", 6, 15.0),
        ("px4", 5, ORIGIN.alt_m + 15.0),
    ],
)
def test_a_global_target_is_flown_to(persona: str, frame: int, alt_m: float) -> None:
    flight = hovering(persona)
    stream(flight, target(flight, 20.0, -10.0, alt_m, frame), 25.0)
    assert math.dist(flight.ned(), (20.0, -10.0, -15.0)) < 0.7


NONE: tuple[dict[str, Any], ...] = (
    {"lat_int": 2**31 - 1},
    {"alt": math.nan},
    {"alt": math.inf},
    {"coordinate_frame": 1},
    {"type_mask": 0},
)
"""`type_mask` 0: then a velocity counts, too, which is no number here."""


@pytest.mark.parametrize("persona", ["ardupilot", "px4"])
def test_a_global_target_that_is_none_moves_nothing(persona: str) -> None:
    flight = hovering(persona)
    before, firmware = flight.ned(), flight.world.vehicles[0].firmware
    for more in NONE:
        ignored = firmware.ignored
        fields = target(flight, 20.0, 0.0, 15.0, 6, vx=math.nan) | more
        flight.tell(0, "SET_POSITION_TARGET_GLOBAL_INT", **fields)
        flight.run(3.0)
        assert firmware.ignored == ignored + 1, more
        assert math.dist(flight.ned(), before) < 0.5


def item(at: GeodeticPoint, up: float, **more: Any) -> dict[str, Any]:
    """A guided item, as dronekit's `simple_goto` sends it."""
    numbers = dict.fromkeys(("param1", "param2", "param3", "param4"), 0.0)
    rest = {"frame": 3, "command": 16, "current": 2, "autocontinue": 0, "mission_type": 0, "seq": 0}
    return TO | numbers | rest | {"x": at.lat_deg, "y": at.lon_deg, "z": up} | more


def test_an_item_that_is_no_part_of_a_list_is_flown_at_once_by_arducopter_in_guided() -> None:
    flight = hovering("ardupilot")
    there = flight.world.plane.geodetic_from_ned((-15.0, 8.0, 0.0))
    (answer,) = [
        m for m in flight.tell(0, "MISSION_ITEM", **item(there, 12.0)) if m.name == "MISSION_ACK"
    ]
    assert answer.fields["type"] == 0
    flight.run(20.0)
    assert math.dist(flight.ned(), (-15.0, 8.0, -12.0)) < 0.7
    assert flight.command(0, 176, 1, 5) == 0, "LOITER"
    (answer,) = [
        m for m in flight.tell(0, "MISSION_ITEM", **item(there, 30.0)) if m.name == "MISSION_ACK"
    ]
    assert answer.fields["type"] == 1
    assert flight.tell(0, "MISSION_ITEM", **item(there, math.nan)) == []


@pytest.mark.parametrize(
    ("p", "degrees"), [((90, 0, 1, 0), 90.0), ((30, 0, -1, 1), -30.0), ((30, 0, 1, 1), 30.0)]
)
def test_condition_yaw_turns_a_hovering_arducopter(p: tuple[float, ...], degrees: float) -> None:
    flight = hovering("ardupilot")
    assert flight.command(0, CONDITION_YAW, *p) == 0
    flight.run(4.0)
    sensed = flight.world.vehicles[0].sense()
    turned = math.degrees(sensed.heading_rad - math.radians(degrees))
    assert (turned + 180) % 360 - 180 == pytest.approx(0.0, abs=1.0)
    assert math.dist(flight.ned(), (0.0, 0.0, -10.0)) < 1.0
    assert flight.command(0, CONDITION_YAW, 400) == 4
    assert flight.command(0, CONDITION_YAW, math.nan) == 4
