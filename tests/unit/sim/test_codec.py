"""Hostile bytes: whatever comes, nothing raises, and the good frame after it is served."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.dialects.v20 import development

from swarm_sim.firmware.message import Message
from swarm_sim.firmware.protocol.telemetry import MESSAGES
from swarm_sim.network.codec import Codec
from swarm_sim.network.signing import VehicleSigning, read_key


def client() -> mavlink.MAVLink:
    return mavlink.MAVLink(None, srcSystem=255, srcComponent=190)


def arm_frame() -> bytes:
    message = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1.0, 0, 0, 0, 0, 0, 0)
    return bytes(message.pack(client()))


GOOD = arm_frame()


def test_available_modes_are_as_the_definition_that_has_them_says() -> None:
    """It is not in the dialect that the codec is made of."""
    numbers = {"number_modes": 9, "mode_index": 2, "standard_mode": 1, "properties": 2}
    fields = numbers | {"custom_mode": 4 << 16, "mode_name": b"Hold"}
    frame = Codec(7).pack(Message("AVAILABLE_MODES", fields))
    (message,) = development.MAVLink(None).parse_buffer(frame)
    assert message.to_dict() == fields | {"mavpackettype": "AVAILABLE_MODES", "mode_name": "Hold"}


@given(garbage=st.binary(max_size=300))
def test_garbage_before_a_frame_does_not_hide_it(garbage: bytes) -> None:
    codec = Codec(1)
    messages = list(codec.messages(garbage + GOOD))
    assert "COMMAND_LONG" in [m.name for m in messages]
    assert (codec.bad > 0) == (len(garbage) > 0)


@given(bit=st.integers(0, len(GOOD) * 8 - 1))
def test_one_flipped_bit_never_passes_for_the_original(bit: int) -> None:
    codec = Codec(1)
    flipped = bytearray(GOOD)
    flipped[bit // 8] ^= 1 << bit % 8
    messages = list(codec.messages(bytes(flipped) + GOOD))
    assert [m.name for m in messages] == ["COMMAND_LONG"]
    assert codec.bad == 1


def random_value(rng: random.Random, kind: str, size: int) -> Any:
    """A value of a field's type: text, an array, or a number."""
    if kind == "char" and size:
        return bytes(rng.randrange(65, 90) for _ in range(rng.randrange(size + 1)))
    if size:
        return [random_value(rng, kind, 0) for _ in range(size)]
    if kind in ("float", "double"):
        return rng.choice([0.0, 1.5, -2.25, rng.randrange(-1000, 1000) / 8])
    if kind == "char":
        return b"x"
    bits = int(kind.removesuffix("_t").removeprefix("u").removeprefix("int"))
    low, high = (
        (0, 2**bits - 1) if kind.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    )
    return rng.choice([0, low, high, rng.randint(low, high)])


SENT = [number for number, _ in MESSAGES.values()]
RECEIVED = [22, 40, 42, 44, 46, 47, 51, 73, 76, 77, 84, 111, 253]


@pytest.mark.parametrize("number", sorted({*SENT, *RECEIVED}))
def test_frames_are_byte_by_byte_those_of_pymavlink_and_come_back(number: int) -> None:
    kind = mavlink.mavlink_map[number]
    sizes = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    rng = random.Random(number)
    ours, theirs = Codec(1), mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    for _ in range(50):
        types = zip(kind.fieldnames, kind.fieldtypes, strict=True)
        fields = {name: random_value(rng, kind_of, sizes[name]) for name, kind_of in types}
        frame = ours.pack(Message(kind.msgname, fields))
        assert frame == bytes(kind(**fields).pack(theirs))
        theirs.seq = (theirs.seq + 1) % 256
        (read,) = Codec(2).messages(frame)
        (known,) = mavlink.MAVLink(None).parse_buffer(frame)
        expected = {name: getattr(known, name) for name in kind.fieldnames}
        assert read.fields == expected


KEY = bytes(range(32))


def signed_client(key: bytes = KEY, at: int = 1_000_000_000) -> mavlink.MAVLink:
    mav = client()
    mav.signing.secret_key = key
    mav.signing.sign_outgoing = True
    mav.signing.timestamp = at
    mav.signing.link_id = 3
    return mav


def signed(mav: mavlink.MAVLink) -> bytes:
    return bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mav))


def test_with_a_key_only_fresh_frames_signed_with_it_are_served() -> None:
    codec = Codec(1, VehicleSigning(KEY, lambda: 1_000_000_000))
    mav = signed_client()
    frame = signed(mav)
    assert len(list(codec.messages(frame))) == 1
    assert list(codec.messages(frame)) == [], "a replay"
    assert list(codec.messages(GOOD)) == [], "unsigned"
    assert list(codec.messages(signed(signed_client(bytes(32))))) == [], "another key"
    changed = bytearray(signed(mav))
    changed[-1] ^= 1
    assert list(codec.messages(bytes(changed))) == []
    assert len(list(codec.messages(signed(mav)))) == 1
    assert codec.unsigned == 4


def test_the_last_stamp_of_all_locks_no_client_out() -> None:
    codec = Codec(1, VehicleSigning(KEY, lambda: 1_000_000_000))
    for key in (bytes(32), KEY):
        assert list(codec.messages(signed(signed_client(key, at=2**48 - 1)))) == []
    assert len(list(codec.messages(signed(signed_client())))) == 1


def test_a_frame_of_one_link_is_refused_on_another_one_of_the_vehicle() -> None:
    signing = VehicleSigning(KEY, lambda: 1_000_000_000)
    frame = signed(signed_client())
    assert len(list(Codec(1, signing, 0).messages(frame))) == 1
    assert list(Codec(1, signing, 1).messages(frame)) == []


def test_own_stamps_follow_those_that_are_heard() -> None:
    codec = Codec(1, VehicleSigning(KEY, lambda: 1_000_000_000))
    list(codec.messages(signed(signed_client(at=5_000_000_000))))
    beat = Message("HEARTBEAT", dict.fromkeys(mavlink.mavlink_map[0].fieldnames, 1))
    assert int.from_bytes(codec.pack(beat)[-12:-6], "little") == 5_000_000_001


def test_what_is_sent_with_a_key_is_signed_as_pymavlink_wants_it() -> None:
    codec = Codec(1, VehicleSigning(KEY, lambda: 1_000_000_000))
    reader = signed_client()
    beat = Message("HEARTBEAT", dict.fromkeys(mavlink.mavlink_map[0].fieldnames, 1))
    for _ in range(3):
        (read,) = reader.parse_buffer(codec.pack(beat))
        assert read.get_signed()
    assert repr(KEY) not in repr(codec._signing)


@pytest.mark.parametrize("data", [KEY, KEY.hex().encode(), KEY.hex().encode() + b"\n"])
def test_a_key_is_read_from_bytes_or_digits(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "key").write_bytes(data)
    assert read_key(tmp_path / "key") == KEY


@pytest.mark.parametrize("data", [b"", b"too short", b"\xff" * 33, b"g" * 64])
def test_another_file_is_no_key_and_is_not_shown(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "key").write_bytes(data)
    with pytest.raises(ValueError, match="64 hexadecimal digits") as caught:
        read_key(tmp_path / "key")
    assert not data or repr(data)[2:8] not in str(caught.value)
