"""Folding: every message of the table, what is refused, and that nothing a vehicle says can
raise."""

from __future__ import annotations

import copy
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.mavlink.telemetry import incoming
from swarm_ctl.mavlink.telemetry.incoming import FOLDS_BY_ID, MAX_CONTACTS
from swarm_ctl.mavlink.telemetry.vehicle_telemetry import (
    CHUNK,
    COMPLETE_S,
    CONTACT_KEPT_S,
    MAX_CHUNKS,
    MAX_TEXTS,
    Telemetry,
)
from tests.unit.mavlink import wire

NAN, INF = math.nan, math.inf


def fold(heard: Telemetry, message: Any, now: float = 10.0) -> bool:
    return incoming.fold(heard, message, now)


def known() -> Telemetry:
    heard = Telemetry(watched=frozenset({"GUID_TIMEOUT"}))
    for message in ONE_OF_EACH:
        assert fold(heard, message)
    return heard


ONE_OF_EACH = [
    wire.heartbeat(custom_mode=4, armed=True),
    wire.local_position(),
    wire.global_position(),
    wire.global_origin(),
    wire.system_status(),
    wire.extended_state(2),
    wire.traffic(5),
    wire.wind(6.5),
    wire.text("careful"),
    wire.ack(400, 0),
    wire.parameter("GUID_TIMEOUT", 3.0),
]


def test_each_message_lands_where_it_belongs_in_si_units() -> None:
    heard = known()
    assert (heard.heartbeat_s, heard.autopilot, heard.vehicle_type) == (10.0, 3, 2)
    assert (heard.armed, heard.custom_mode, heard.on_ground) == (True, 4, False)
    assert heard.local is not None
    assert heard.local.position_ned_m == pytest.approx((1.0, 2.0, -3.0))
    assert heard.local.velocity_ned_mps == pytest.approx((0.1, 0.2, -0.3))
    assert heard.global_ is not None
    assert place(heard.global_.position) == pytest.approx((47.397742, 8.545594, 488.0))
    assert heard.global_.relative_alt_m == pytest.approx(3.0)
    assert heard.global_.velocity_ned_mps == pytest.approx((0.1, 0.2, -0.3))
    assert place(heard.origin) == pytest.approx((47.3977, 8.5455, 485.0))
    assert heard.battery_now(10.0) == 80.0
    assert (heard.wind_now(15.0), heard.wind_now(21.0)) == (6.5, None)
    contact = heard.contacts[5]
    assert place(contact.position) == pytest.approx((47.39775, 8.5456, 490.0))
    assert contact.velocity_ned_mps == pytest.approx((0.0, 2.0, -0.5), abs=1e-9)
    assert heard.texts.take(10.0) == ("careful",)
    assert heard.parameters["GUID_TIMEOUT"].raw == 3.0


REFUSED = {
    "nan position": wire.local_position((NAN, 0.0, 0.0)),
    "infinite velocity": wire.local_position(velocity=(0.0, INF, 0.0)),
    "too far": wire.local_position((0.0, 0.0, 2e5)),
    "latitude": wire.global_position(lat=900_000_001),
    "no fix yet": wire.global_position(lat=0, lon=0),
    "height": wire.global_position(alt_mm=30_000_000),
    "origin unset": wire.global_origin(lat=0, lon=0),
    "landed state": wire.extended_state(9),
    "traffic without place": wire.traffic(6, flags=0x02),
    "nan wind": wire.wind(NAN),
    "wind below zero": wire.wind(-1.0),
    "endless wind": wire.wind_cov(INF, 0.0),
    "nan parameter": wire.parameter("GUID_TIMEOUT", NAN),
    "another firmware": wire.heartbeat(autopilot=12),
    "another type": wire.heartbeat(kind=1),
}


@pytest.mark.parametrize("why", REFUSED)
def test_what_cannot_be_true_is_refused_and_changes_nothing(why: str) -> None:
    heard = known()
    before = copy.deepcopy(heard)
    assert not fold(heard, REFUSED[why])
    assert heard == before


@given(st.sampled_from(sorted(FOLDS_BY_ID)), st.binary(min_size=1, max_size=255), st.floats(0, 1e6))
def test_no_payload_raises_or_leaves_anything_that_is_not_finite(
    number: int, payload: bytes, now: float
) -> None:
    message = decode(number, payload)
    heard = known()
    fold(heard, message, now)
    numbers: list[float] = [heard.battery_now(now) or 0.0, heard.wind_mps, heard.tilt_deg]
    for fix in (heard.local, heard.global_):
        assert fix is not None
        numbers += fix.velocity_ned_mps
    numbers += [*(heard.local.position_ned_m if heard.local else ()), *place(heard.origin)]
    for contact in heard.contacts.values():
        numbers += [*place(contact.position), *contact.velocity_ned_mps]
    assert all(math.isfinite(number) for number in numbers)
    assert all(text.isprintable() for text in heard.texts.take(now + 100.0))


def test_a_wind_of_exactly_zero_is_no_estimate() -> None:
    """As an ArduCopter as delivered sends it, in any wind."""
    heard = Telemetry()
    assert fold(heard, wire.wind(0.0), 10.0)
    assert heard.wind_now(10.0) is None
    assert fold(heard, wire.wind(0.1), 11.0)
    assert heard.wind_now(11.0) == pytest.approx(0.1)


def place(point: Geodetic | None) -> tuple[float, ...]:
    return () if point is None else (point.lat_deg, point.lon_deg, point.alt_m)


def decode(number: int, payload: bytes) -> Any:
    """The message with this raw payload, through the real codec (with the checksum that makes it
    good)."""
    header = bytes([0xFD, len(payload), 0, 0, 0, 1, 1, number & 0xFF, number >> 8 & 0xFF, 0])
    crc = dialect.x25crc(header[1:] + payload + bytes([dialect.mavlink_map[number].crc_extra])).crc
    return dialect.MAVLink(None).decode(bytearray(header + payload + crc.to_bytes(2, "little")))


def test_an_unknown_landed_state_leaves_what_is_known() -> None:
    heard = known()
    assert fold(heard, wire.extended_state(0))
    assert heard.on_ground is False


@pytest.mark.parametrize("percent", [-1, -106, 101])
def test_a_charge_that_is_not_known_is_unknown_again_and_costs_nothing_else(percent: int) -> None:
    """99 % was told to the end of a flight; -106 cost the whole SYS_STATUS."""
    heard = Telemetry()
    fold(heard, wire.system_status(battery_percent=99), 10.0)
    assert heard.battery_now(10.0) == 99.0
    assert fold(heard, wire.system_status(battery_percent=percent, health=5), 11.0)
    assert (heard.battery_now(11.0), heard.sensors_health) == (None, 5)
    assert heard.system_status_s == 11.0


def test_a_charge_has_an_age_and_either_message_tells_it() -> None:
    heard = Telemetry()
    fold(heard, wire.system_status(battery_percent=70), 10.0)
    battery = dialect.MAVLink_battery_status_message
    fold(heard, battery(0, 0, 0, 0, [0] * 10, 0, 0, 0, 55), 15.0)
    assert heard.battery_now(20.0) == 70.0
    assert heard.battery_now(20.1) == 55.0
    assert heard.battery_now(25.1) is None


def test_tilt_and_round_trip_have_an_age() -> None:
    """A stale angle let `max_tilt_deg` act, or not, on what was long ago."""
    heard = Telemetry()
    assert (heard.tilt_now(0.0), heard.round_trip_now(0.0)) == (None, None)
    fold(heard, dialect.MAVLink_attitude_message(0, 0.5, 0, 0, 0, 0, 0), 10.0)
    fold(heard, dialect.MAVLink_timesync_message(5, int(9.9e9)), 10.0)
    assert heard.tilt_now(13.0) == pytest.approx(math.degrees(0.5))
    assert heard.round_trip_now(20.0) == pytest.approx(0.1)
    assert (heard.tilt_now(13.1), heard.round_trip_now(20.1)) == (None, None)


def test_contacts_are_the_newest_per_address_bounded_and_forgotten() -> None:
    heard = Telemetry()
    for i in range(MAX_CONTACTS + 10):
        fold(heard, wire.traffic(i), now=float(i))
    assert len(heard.contacts) == MAX_CONTACTS
    assert min(heard.contacts) == 10, "the oldest made room"
    newest = max(contact.time_s for contact in heard.contacts.values())
    heard.forget_old_contacts(newest + CONTACT_KEPT_S - 1.5)
    assert sorted(heard.contacts) == [MAX_CONTACTS + 8, MAX_CONTACTS + 9]


# --- texts ---


def test_only_warnings_and_worse_are_kept_bounded_and_printable() -> None:
    heard = Telemetry()
    fold(heard, wire.text("just so you know", severity=6))
    for i in range(MAX_TEXTS + 5):
        fold(heard, wire.text(f"bad \x1b[31m{i}", severity=3))
    texts = heard.texts.take(10.0)
    assert len(texts) == MAX_TEXTS
    assert texts[-1] == f"bad ?[31m{MAX_TEXTS + 4}"
    assert heard.texts.take(10.0) == ()


def test_a_long_text_whose_end_is_lost_comes_as_far_as_it_came() -> None:
    heard = Telemetry()
    fold(heard, wire.text("a" * 50, number=1), now=10.0)
    fold(heard, wire.text("b" * 50, number=2), now=10.1)
    assert heard.texts.take(10.2) == ("a" * 50,)
    assert heard.texts.take(10.2 + COMPLETE_S) == ("b" * 50,)


def test_endless_chunks_do_not_gather_without_bound() -> None:
    heard = Telemetry()
    for chunk in range(1000):
        fold(heard, wire.text("c" * 50, number=3, chunk=chunk % 256))
    texts = heard.texts.take(12.0)
    assert len(texts) <= MAX_TEXTS
    assert max(map(len, texts)) == MAX_CHUNKS * CHUNK


def test_a_refusal_is_told_once_and_only_if_it_was_ours() -> None:
    heard = Telemetry()
    fold(heard, wire.ack(400, 4))
    fold(heard, wire.ack(400, 4))
    fold(heard, wire.ack(22, 1, system=77))
    fold(heard, wire.ack(511, 2))
    assert heard.texts.take(10.0) == ("arming refused: FAILED",)
    fold(heard, wire.ack(400, 0))
    fold(heard, wire.ack(400, 1))
    assert heard.texts.take(10.0) == ("arming refused: TEMPORARILY_REJECTED",)


# --- parameters, restarts ---


def test_a_restart_forgets_what_does_not_survive_it() -> None:
    heard = known()
    fold(heard, wire.local_position(boot_ms=600_000))
    fold(heard, wire.local_position(boot_ms=599_000))
    assert heard.origin is not None, "a frame that came late is no restart"
    heard.texts.take(10.0)
    fold(heard, wire.local_position(boot_ms=2_000))
    assert heard.origin is None
    assert heard.global_ is None
    assert not heard.parameters
    assert heard.system_status_s == -INF
    assert heard.texts.take(10.0) == ("the vehicle restarted",)
