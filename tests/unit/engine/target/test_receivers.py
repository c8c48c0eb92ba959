"""Receivers: what they say is told as it is meant, and nothing else is."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.model.messages import TargetWord
from swarm_ctl.engine.target.receivers import Gpsd, Nmea


def sentence(body: str) -> bytes:
    total = 0
    for byte in body.encode():
        total ^= byte
    return f"${body}*{total:02X}\r\n".encode()


RMC = sentence("GNRMC,123519.00,A,4717.11437,N,00833.91522,E,5.832,90.0,261126,,,A")
GGA = sentence("GNGGA,123519.00,4717.11437,N,00833.91522,E,1,12,0.7,408.2,M,47.0,M,,")
NO_FIX = sentence("GNRMC,123520.00,V,,,,,,,261126,,,N")


def read(reader: Nmea | Gpsd, *chunks: bytes) -> list[TargetWord]:
    return [word for chunk in chunks for word in reader.feed(chunk)]


def test_nmea_place_height_course_and_quality_come_together() -> None:
    """47 deg 17.11437 min north; 5.832 knots to the east are 3 m/s."""
    *_, word = read(Nmea("boat", 0.2), RMC, GGA, RMC)
    assert word.latitude_deg == pytest.approx(47.2852395)
    assert word.longitude_deg == pytest.approx(8.565253667)
    assert word.altitude_m == 408.2
    assert word.velocity_ned_mps == pytest.approx((0.0, 3.0, 0.0), abs=1e-3)
    assert word.accuracy_m == pytest.approx(2.1)
    assert (word.name, word.age_s) == ("boat", 0.2)


def test_a_receiver_without_rmc_is_heard_by_its_gga() -> None:
    words = read(Nmea("boat", 0.2), GGA, GGA, GGA)
    assert words
    assert words[-1].velocity_ned_mps is None


def test_gst_says_the_accuracy_itself() -> None:
    gst = sentence("GNGST,123519.00,1.2,,,,0.3,0.4,0.9")
    *_, word = read(Nmea("boat", 0.2), GGA, gst, GGA, RMC)
    assert word.accuracy_m == pytest.approx(0.5)


def test_a_damaged_sentence_tells_nothing() -> None:
    """Any one byte of it is another one."""
    for at in range(1, len(RMC) - 4):
        reader = Nmea("boat", 0.2)
        assert not read(reader, RMC[:at] + bytes([RMC[at] ^ 0x01]) + RMC[at + 1 :])
        assert reader.bad == 1


def test_without_a_fix_nothing_is_told_and_it_is_said_why() -> None:
    reader = Nmea("boat", 0.2)
    assert not read(reader, NO_FIX)
    assert "no fix" in reader.why
    assert read(reader, RMC)
    assert not reader.why


def test_a_height_of_an_older_fix_is_not_told() -> None:
    """The receiver's GGA has ceased: what it said last is no news of a height."""
    words = read(Nmea("boat", 0.2), GGA, RMC, RMC, RMC, RMC)
    assert words[0].altitude_m == 408.2
    assert words[-1].altitude_m is None


def tpv(**fields: object) -> bytes:
    said = {"class": "TPV", "mode": 3, "lat": 47.2852395, "lon": 8.56525367} | fields
    return json.dumps(said).encode() + b"\n"


def test_gpsd_reports_are_told() -> None:
    said = tpv(altMSL=408.2, speed=3.0, track=90.0, climb=-0.5, eph=4.0)
    (word,) = read(Gpsd("boat", 0.1), said)
    assert word.altitude_m == 408.2
    assert word.velocity_ned_mps == pytest.approx((0.0, 3.0, 0.5), abs=1e-9)
    assert word.accuracy_m == 2.0


@pytest.mark.parametrize("fields", [{"mode": 1}, {"lat": None}, {"lat": "x"}, {"lon": 1e309}])
def test_gpsd_without_a_place_tells_nothing(fields: dict[str, object]) -> None:
    reader = Gpsd("boat", 0.1)
    assert not read(reader, tpv(**fields))
    assert reader.why or reader.bad


@given(st.lists(st.binary(max_size=80), max_size=20), st.sampled_from((Nmea, Gpsd)))
def test_no_bytes_end_a_reader(chunks: list[bytes], kind: type[Nmea | Gpsd]) -> None:
    """And what it tells is somewhere on earth."""
    for word in read(kind("boat", 0.2), *chunks, b"\n"):
        assert abs(word.latitude_deg) <= 89.0
        assert math.isfinite(word.longitude_deg)


@given(st.text(max_size=60), st.sampled_from(("RMC", "GGA", "GST")))
def test_no_sentence_ends_a_reader(body: str, kind: str) -> None:
    """Whole ones, with a good checksum."""
    text = f"GN{kind},{body}".encode("ascii", "ignore").decode()
    read(Nmea("boat", 0.2), sentence(text))


@given(st.recursive(st.none() | st.floats() | st.text(), lambda v: st.lists(v), max_leaves=5))
def test_no_report_ends_a_reader(value: object) -> None:
    for key in ("lat", "lon", "speed", "mode", "eph", "altMSL", "class"):
        read(Gpsd("boat", 0.2), tpv(**{key: value}))


def test_a_line_without_an_end_is_dropped() -> None:
    reader = Nmea("boat", 0.2)
    assert not read(reader, b"$GNRMC," * 2000)
    assert reader.bad
    assert read(reader, b"\n" + RMC)
