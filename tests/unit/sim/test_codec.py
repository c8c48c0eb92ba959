"""Hostile bytes: whatever comes, nothing raises, and the good frame after it is served."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim.endpoint import Codec
from sim.firmware.message import Message


def client() -> mavlink.MAVLink:
    return mavlink.MAVLink(None, srcSystem=255, srcComponent=190)


def arm_frame() -> bytes:
    message = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1.0, 0, 0, 0, 0, 0, 0)
    return bytes(message.pack(client()))


GOOD = arm_frame()


def test_a_good_frame_comes_out_with_fields_and_sender() -> None:
    (message,) = Codec(1).messages(GOOD)
    assert message.name == "COMMAND_LONG"
    assert message.source == (255, 190)
    assert (message.fields["command"], message.fields["param1"]) == (400, 1.0)


def test_what_is_packed_carries_system_component_and_rising_sequence() -> None:
    codec = Codec(7)
    heartbeat = Message(
        "HEARTBEAT",
        {
            "type": 2,
            "autopilot": 3,
            "base_mode": 1,
            "custom_mode": 4,
            "system_status": 3,
            "mavlink_version": 3,
        },
    )
    first, second = (client().parse_buffer(codec.pack(heartbeat))[0] for _ in range(2))
    assert (first.get_srcSystem(), first.get_srcComponent()) == (7, 1)
    assert second.get_seq() == first.get_seq() + 1
    assert first.custom_mode == 4


@given(garbage=st.binary(max_size=300))
def test_garbage_before_a_frame_does_not_hide_it(garbage: bytes) -> None:
    codec = Codec(1)
    messages = list(codec.messages(garbage + GOOD))
    assert "COMMAND_LONG" in [m.name for m in messages]
    assert (codec.bad > 0) == (len(garbage) > 0)


@given(cut=st.integers(1, len(GOOD) - 1))
def test_a_truncated_frame_harms_neither_its_own_datagram_nor_the_next(cut: int) -> None:
    codec = Codec(1)
    assert [m.name for m in codec.messages(GOOD[:cut] + GOOD)] == ["COMMAND_LONG"]
    assert list(codec.messages(GOOD[:cut])) == []
    assert [m.name for m in codec.messages(GOOD)] == ["COMMAND_LONG"]
    assert codec.bad == 2


@given(bit=st.integers(0, len(GOOD) * 8 - 1))
def test_one_flipped_bit_never_passes_for_the_original(bit: int) -> None:
    codec = Codec(1)
    flipped = bytearray(GOOD)
    flipped[bit // 8] ^= 1 << bit % 8
    messages = list(codec.messages(bytes(flipped) + GOOD))
    assert [m.name for m in messages] == ["COMMAND_LONG"]
    assert codec.bad == 1


def test_an_unknown_message_is_counted_and_skipped() -> None:
    codec = Codec(1)
    unknown = bytearray(GOOD)
    unknown[7:10] = (999999).to_bytes(3, "little")
    assert [m.name for m in codec.messages(bytes(unknown) + GOOD)] == ["COMMAND_LONG"]
    assert codec.bad == 1


def test_mavlink_1_is_understood() -> None:
    frame = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(client(), force_mavlink1=True)
    assert [m.name for m in Codec(1).messages(bytes(frame))] == ["HEARTBEAT"]


def test_a_run_of_bytes_that_are_no_frame_counts_once() -> None:
    codec = Codec(1)
    assert list(codec.messages(b"ArduPilot says hello, in plain text")) == []
    assert codec.bad == 1
