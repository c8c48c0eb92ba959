"""A MAVLink system as a target: its own place, or that of an aircraft that it hears."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.mavlink.target_ear import TargetEar

VEHICLE = 7


def frames(*messages: Any, system: int = VEHICLE) -> bytes:
    codec = dialect.MAVLink(None, system, 1)
    return b"".join(message.pack(codec) for message in messages)


def place(lat: int = -353632620, lon: int = 1491652370) -> Any:
    return dialect.MAVLink_global_position_int_message(0, lat, lon, 590000, 0, 300, -100, 20, 0)


def test_a_vehicle_tells_its_place_and_velocity() -> None:
    (word,) = TargetEar("lead", 0.1, VEHICLE).feed(frames(place()))
    assert (word.latitude_deg, word.longitude_deg) == pytest.approx((-35.363262, 149.165237))
    assert word.altitude_m == 590.0
    assert word.velocity_ned_mps == pytest.approx((3.0, -1.0, 0.2))
    assert word.age_s == 0.1


def test_another_system_is_no_target() -> None:
    assert not list(TargetEar("lead", 0.1, VEHICLE).feed(frames(place(), system=8)))


def test_a_vehicle_without_a_position_is_nowhere() -> None:
    ear = TargetEar("lead", 0.1, VEHICLE)
    assert not list(ear.feed(frames(place(0, 0))))
    assert "no position" in ear.why


def test_follow_target_of_a_ground_station_is_heard() -> None:
    """Without a velocity in its capabilities none is told."""
    told = dialect.MAVLink_follow_target_message(
        0,
        1,
        -353632620,
        1491652370,
        590.0,
        *([[1.0, 2.0, 3.0]] * 2),
        [0.0] * 4,
        *([[0.0] * 3] * 2),
        0,
    )
    (word,) = TargetEar("lead", 0.1).feed(frames(told))
    assert word.altitude_m == 590.0
    assert word.velocity_ned_mps is None


def test_one_that_has_landed_is_on_the_ground() -> None:
    landed = dialect.MAVLink_extended_sys_state_message(0, dialect.MAV_LANDED_STATE_ON_GROUND)
    (word,) = TargetEar("lead", 0.1, VEHICLE).feed(frames(landed, place()))
    assert word.on_ground


def test_an_aircraft_is_known_by_its_address() -> None:
    """Older by the seconds since the receiver heard it."""
    flags = 0xFFFF

    def aircraft(address: int) -> Any:
        return dialect.MAVLink_adsb_vehicle_message(
            address, -353632620, 1491652370, 1, 690000, 9000, 500, 100, b"N1", 1, 1, flags, 0
        )

    ear = TargetEar("plane", 0.1, 0, 0xABCDEF)
    (word,) = ear.feed(frames(aircraft(0x123456), aircraft(0xABCDEF), place()))
    assert word.velocity_ned_mps == pytest.approx((0.0, 5.0, -1.0), abs=1e-6)
    assert (word.altitude_m, word.age_s) == (690.0, 1.1)


@given(st.lists(st.binary(max_size=300), max_size=10))
def test_no_bytes_end_an_ear(chunks: list[bytes]) -> None:
    ear = TargetEar("lead", 0.1)
    for chunk in chunks:
        list(ear.feed(chunk))
