"""Signing of a vehicle's link: what is sent is signed as pymavlink wants it, and no frame counts
that is not signed with the vehicle's key, and new."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.vehicle import StandbyGoal
from swarm_ctl.errors import LinkError
from swarm_ctl.mavlink.framer import Framer, MavlinkFrame
from swarm_ctl.mavlink.link import VehicleLink
from swarm_ctl.mavlink.signing import (
    SAVE_EVERY,
    UNITS_S,
    LinkSigning,
    RefusedFrames,
    SigningRefusal,
)
from swarm_ctl.mavlink.stamp import StampKeeper, stamp_at
from swarm_ctl.mavlink.wires import memory_wires
from tests.unit.mavlink import wire

KEY = bytes(range(32))
START = 10**12


def vehicle_codec(key: bytes = KEY, stamp: int = START, link: int = 2, sysid: int = 7) -> object:
    codec = dialect.MAVLink(None, srcSystem=sysid, srcComponent=1)
    codec.signing.secret_key, codec.signing.sign_outgoing = key, True
    codec.signing.timestamp, codec.signing.link_id = stamp, link
    return codec


def beat(codec: object) -> bytes:
    return bytes(wire.heartbeat().pack(codec))


def framed(raw: bytes) -> MavlinkFrame:
    (found,) = Framer().feed(raw)
    return found


def judge(signing: LinkSigning, raw: bytes) -> SigningRefusal | None:
    return signing.refusal(framed(raw))


def test_a_signed_frame_counts_once() -> None:
    signing, raw = LinkSigning(KEY, START), beat(vehicle_codec())
    assert judge(signing, raw) is None
    assert judge(signing, raw) is SigningRefusal.REPLAYED


@pytest.mark.parametrize(
    ("raw", "why"),
    [
        (wire.heartbeat().pack(dialect.MAVLink(None, 7, 1)), SigningRefusal.UNSIGNED),
        (wire.heartbeat().pack(dialect.MAVLink(None, 7, 1), force_mavlink1=True), "MAVLink 1"),
        (beat(vehicle_codec(bytes(32))), SigningRefusal.WRONG_KEY),
        (beat(vehicle_codec(stamp=START - 1)), SigningRefusal.REPLAYED),
        (beat(vehicle_codec(stamp=2**48 - 1)), SigningRefusal.AHEAD),
    ],
)
def test_a_frame_is_refused_with_the_reason(raw: bytes, why: SigningRefusal) -> None:
    assert judge(LinkSigning(KEY, START), raw) == why


def test_a_frame_of_another_key_with_the_last_stamp_does_not_lock_the_vehicle_out() -> None:
    signing = LinkSigning(KEY, START)
    assert judge(signing, beat(vehicle_codec(bytes(32), 2**48 - 1))) is SigningRefusal.WRONG_KEY
    assert judge(signing, beat(vehicle_codec())) is None
    assert signing.next_stamp(0.0) < START + UNITS_S


def test_a_frame_that_was_signed_for_another_link_of_the_vehicle_is_refused() -> None:
    """A recording of its telemetry radio does not count on the agent's link, whatever its stamp."""
    signing = LinkSigning(KEY, START)
    assert judge(signing, beat(vehicle_codec(link=2))) is None
    assert (
        judge(signing, beat(vehicle_codec(link=3, stamp=START + 10**6))) is SigningRefusal.REPLAYED
    )


@given(st.data())
def test_any_changed_byte_of_a_signed_frame_is_refused(data: st.DataObject) -> None:
    raw = bytearray(beat(vehicle_codec()))
    at = data.draw(st.integers(0, len(raw) - 1))
    raw[at] ^= data.draw(st.integers(1, 255))
    frame = framed(beat(vehicle_codec()))._replace(raw=bytes(raw))
    assert LinkSigning(KEY, START).refusal(frame) is not None


@given(st.lists(st.binary(max_size=300), max_size=20))
def test_no_bytes_of_a_stranger_count_or_raise(chunks: list[bytes]) -> None:
    near, far = memory_wires()
    link = VehicleLink(near, "ardupilot", 7, signing=LinkSigning(KEY, START))
    unsigned = wire.Vehicle(far, 7)
    for number, chunk in enumerate(chunks):
        far.write(chunk)
        unsigned.say(wire.heartbeat())
        link.receive(float(number))
    assert (link.counters.frames, link.view().heartbeat_s) == (0, -math.inf)


@given(st.lists(st.floats(0.0, 1e4), min_size=2, max_size=20), st.integers(0, 2**47))
def test_own_stamps_rise_by_the_clock_and_above_all_that_was_heard(
    times: list[float], heard: int
) -> None:
    signing = LinkSigning(KEY, START)
    first = signing.next_stamp(0.0)
    judge(signing, beat(vehicle_codec(stamp=heard)))
    found = [first, *(signing.next_stamp(now) for now in sorted(times))]
    assert found == sorted(set(found))
    assert found[-1] >= START + int(max(times) * UNITS_S)
    assert found[1] > heard or heard < START


@pytest.mark.parametrize(("pace", "at_s"), [(1.0, 100.0), (0.1, 10.0), (0.0, 0.0)])
def test_stamps_go_by_the_real_clock_where_mission_time_is_faster(pace: float, at_s: float) -> None:
    signing = LinkSigning(KEY, START, pace=pace)
    signing.next_stamp(0.0)
    assert (signing.next_stamp(100.0) - START) / UNITS_S == pytest.approx(at_s, abs=1e-4)


def test_what_an_agent_sends_is_signed_and_pymavlink_takes_it() -> None:
    near, far = memory_wires()
    link = VehicleLink(near, "ardupilot", 7, signing=LinkSigning(KEY, START))
    for tick in range(3):
        link.pursue(StandbyGoal(), tick * 1.0)
    reader = vehicle_codec(stamp=START)
    sent = b"".join(iter(far.read, None))
    messages = reader.parse_buffer(sent)
    assert len(messages) >= 3
    assert all(message.get_signed() for message in messages)
    assert repr(KEY) not in repr(link._signing)


def test_a_vehicle_with_an_old_clock_is_answered_and_then_heard() -> None:
    """Autopilots raise their stamps to those that they hear."""
    near, far = memory_wires()
    confirmed: list[bool] = []
    near.confirm = lambda **_: confirmed.append(True)  # type: ignore[method-assign]
    link = VehicleLink(near, "ardupilot", 7, signing=LinkSigning(KEY, START))
    codec = vehicle_codec(stamp=START - 10**9)
    far.write(beat(codec))
    link.receive(0.0)
    assert (confirmed, link.view().heartbeat_s) == ([True], -math.inf)
    link.pursue(StandbyGoal(), 0.0)
    codec.parse_buffer(b"".join(iter(far.read, None)))
    far.write(beat(codec))
    link.receive(0.1)
    assert link.view().heartbeat_s == 0.1


def test_neither_an_impostor_nor_a_replay_gets_the_link() -> None:
    near, far = memory_wires()
    confirmed: list[bool] = []
    near.confirm = lambda **_: confirmed.append(True)  # type: ignore[method-assign]
    link = VehicleLink(near, "ardupilot", 7, signing=LinkSigning(KEY, START))
    good = beat(vehicle_codec())
    wire.Vehicle(far, 7).say(wire.heartbeat())
    link.receive(0.0)
    assert confirmed == []
    far.write(good)
    link.receive(0.1)
    far.write(good)
    link.receive(0.2)
    assert confirmed == [True]


def test_what_was_refused_is_counted_and_told_for_as_long_as_it_comes() -> None:
    refused = RefusedFrames(3)
    unsigned = framed(wire.heartbeat().pack(dialect.MAVLink(None, 3, 1)))
    for tenth in range(120):
        refused.note(SigningRefusal.UNSIGNED, unsigned, tenth / 10)
    assert refused.words(12.0) == "unsigned frames for vehicle 3 refused: 100 in 10 s"
    assert refused.words(25.0) == "unsigned frames for vehicle 3 refused: 20 in 10 s"
    assert refused.words(45.0) == ""
    assert refused.total == {SigningRefusal.UNSIGNED: 120}


def test_a_radio_without_a_key_is_no_forgery() -> None:
    near, far = memory_wires()
    link = VehicleLink(near, "ardupilot", 7, signing=LinkSigning(KEY, START))
    radio = dialect.MAVLink(None, 51, 68)
    far.write(dialect.MAVLink_radio_status_message(1, 1, 1, 1, 1, 1, 1).pack(radio))
    link.receive(0.0)
    assert (link.counters.refused, link.counters.frames, link.view().refused) == (0, 0, "")


# --- restarts ---


def test_a_restarted_agent_signs_on_above_its_last_stamps_whatever_its_clock(
    tmp_path: Path,
) -> None:
    """And what the vehicle had sent before does not count."""
    path, unix_s = tmp_path / "stamp", 1_800_000_000.0
    keeper = StampKeeper(path, unix_s)
    assert keeper.start == stamp_at(unix_s)
    signing = LinkSigning(KEY, keeper.start, keeper.keep)
    raw = beat(vehicle_codec(stamp=keeper.start + 1))
    assert judge(signing, raw) is None
    last = [signing.next_stamp(now) for now in (0.0, 9.9, 19.9)][-1]
    keeper.close()
    for clock_s in (unix_s + 20.0, 0.0):
        again = StampKeeper(path, clock_s)
        again.close()
        assert again.start > last
        assert judge(LinkSigning(KEY, again.start), raw) is SigningRefusal.REPLAYED


def test_stamps_are_kept_each_ten_seconds_and_at_once_when_they_jump() -> None:
    kept: list[int] = []
    signing = LinkSigning(KEY, START, kept.append)
    for tenth in range(250):
        signing.next_stamp(tenth / 10)
    assert [round((stamp - START) / UNITS_S) for stamp in kept] == [10, 20]
    judge(signing, beat(vehicle_codec(stamp=START + 50 * SAVE_EVERY)))
    assert kept[-1] == START + 50 * SAVE_EVERY


@pytest.mark.parametrize("content", [b"", b"12x", b"\xff", b"9" * 40])
def test_a_damaged_file_leaves_the_clock_and_is_told(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "stamp"
    path.write_bytes(content)
    keeper = StampKeeper(path, 1_800_000_000.0)
    keeper.close()
    assert keeper.start == stamp_at(1_800_000_000.0)
    assert bool(keeper.failure) == bool(content)
    assert int(path.read_text()) == keeper.start


def test_a_file_that_cannot_be_written_is_told_and_stops_nothing(tmp_path: Path) -> None:
    keeper = StampKeeper(tmp_path / "missing" / "stamp", 1_800_000_000.0)
    keeper.keep(keeper.start + SAVE_EVERY)
    keeper.close()
    assert "missing/stamp" in keeper.failure


@pytest.mark.parametrize("size", [0, 31, 33])
def test_a_key_of_another_length_is_refused(size: int) -> None:
    with pytest.raises(LinkError, match="allowed: 32"):
        LinkSigning(bytes(size), 0)


def test_memory_of_a_flood_is_bounded() -> None:
    signing = LinkSigning(KEY, START)
    for sysid in range(1, 200):
        judge(signing, beat(vehicle_codec(sysid=sysid)))
    assert len(signing._heard) == 16
