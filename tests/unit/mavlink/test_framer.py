"""Framing: good frames are found whatever stands around them, however the stream is cut."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from swarm_ctl.mavlink import framer
from swarm_ctl.mavlink.framer import Framer
from swarm_ctl.mavlink.wires import memory_wires
from tests.unit.mavlink import wire

LONGEST = 280
BANNER = b"Init ArduCopter V4.7.0-dev\n\nFree RAM: 131072\nload_all took 120us\n"


def frames_of(*messages: wire.Message) -> list[bytes]:
    vehicle = wire.Vehicle(memory_wires()[0])
    return [vehicle.bytes_of(message) for message in messages]


GOOD = frames_of(
    wire.heartbeat(),
    wire.local_position(),
    wire.text("hello"),
    wire.traffic(7),
    wire.system_status(),
)

# Noise that looks like frames: magics, plausible headers, halves of good frames.
headers = st.builds(
    lambda length, flags, number: bytes([0xFD, length, flags, 0, 1, 1, 1, number, 0, 0]),
    st.integers(0, 255),
    st.integers(0, 3),
    st.sampled_from([0, 1, 32, 33, 253]),
)
halves = st.builds(
    lambda frame, cut: frame[: cut % len(frame)], st.sampled_from(GOOD), st.integers(1, 400)
)
flipped = st.builds(
    lambda frame, at: (
        frame[: at % len(frame)]
        + bytes([frame[at % len(frame)] ^ 0x55])
        + frame[at % len(frame) + 1 :]
    ),
    st.sampled_from(GOOD),
    st.integers(0, 400),
)
noise = (
    st.lists(st.one_of(st.binary(max_size=40), headers, halves, flipped), max_size=6)
    .map(b"".join)
    .filter(lambda drawn: not any(good in drawn for good in GOOD))
)


@given(st.lists(st.tuples(noise, st.sampled_from(GOOD)), min_size=1, max_size=5), st.data())
def test_all_good_frames_are_found_in_order_however_the_stream_is_cut(
    parts: list[tuple[bytes, bytes]], data: st.DataObject
) -> None:
    """But where noise says that it begins a message that no dialect has: nothing tells it from
    one, and what it claims to contain is stepped over."""
    stream = b"".join(before + good for before, good in parts)
    at = 0
    for before, good in parts:
        assume(not any(names_an_unknown(stream, at + k) for k in range(len(before))))
        at += len(before + good)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    framer = Framer()
    found = [
        frame.raw
        for a, b in pairwise([0, *cuts, len(stream)])
        for frame in framer.feed(stream[a:b])
    ]
    assert found == [good for _, good in parts]


def names_an_unknown(stream: bytes, at: int) -> bool:
    header = {0xFD: 10, 0xFE: 6}.get(stream[at])
    return (
        header is not None
        and len(stream) - at >= header
        and (header == 6 or stream[at + 2] < 2)
        and framer._message_id(stream, at) not in framer._CRC_EXTRA
    )


def test_plain_text_before_and_between_frames_is_skipped_and_counted_once_a_run() -> None:
    """One banner of four chunks is one run."""
    framer = Framer()
    found = [frame for k in range(0, 80, 20) for frame in framer.feed(BANNER[k : k + 20])]
    found += framer.feed(GOOD[0] + b"PreArm: text\n" + GOOD[1])
    assert [frame.raw for frame in found] == GOOD[:2]
    assert framer.bad == 2


@pytest.mark.parametrize("old", [False, True])
def test_header_fields_are_those_sent(old: bool) -> None:
    codec = common.MAVLink(None, srcSystem=42, srcComponent=7)
    codec.seq = 200
    (frame,) = Framer().feed(wire.extended_state(1).pack(codec, force_mavlink1=old))
    assert (frame.message_id, frame.seq, frame.system, frame.component) == (245, 200, 42, 7)


def test_checksums_are_the_same_without_the_fast_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(framer, "_checksum", framer._slow_checksum)
    assert [frame.raw for frame in Framer().feed(b"".join(GOOD))] == GOOD


def test_mavlink_1_and_signed_frames_are_frames() -> None:
    codec = common.MAVLink(None, srcSystem=3, srcComponent=1)
    old = wire.heartbeat().pack(codec, force_mavlink1=True)
    codec.signing.secret_key, codec.signing.sign_outgoing = b"k" * 32, True
    signed = wire.heartbeat().pack(codec)
    found = Framer().feed(old + signed + b"text" + old)
    assert [frame.raw for frame in found] == [old, signed, old]
    assert [frame.system for frame in found] == [3, 3, 3]


@pytest.mark.parametrize("flags", [0x02, 0x80])
def test_unknown_incompatibility_flags_are_no_frame(flags: int) -> None:
    frame = bytearray(GOOD[0])
    frame[2] = flags
    framer = Framer()
    assert framer.feed(bytes(frame)) == []
    assert framer.bad == 1


def test_a_clean_stream_counts_nothing_bad() -> None:
    framer = Framer()
    for at in range(len(b"".join(GOOD))):
        framer.feed(b"".join(GOOD)[at : at + 1])
    assert framer.bad == 0


def test_a_good_frame_is_tried_once() -> None:
    """Whatever is in front of it, a new framer has nothing of its own."""
    framer = Framer()
    for count in (1, 2, 3):
        (frame,) = framer.feed(GOOD[0])
        assert frame.raw == GOOD[0]
        assert (framer.tried, framer.bad) == (count, 0)


@pytest.mark.parametrize(
    "pattern", [b"\xfd", b"\xfe", b"\xfd\xff\0\0", b"\xfe\xfe\0\0\0", b"\xfd\xff\0\0\0\0\1\0\0\0"]
)
def test_a_chunk_full_of_false_beginnings_costs_no_more_than_a_few(pattern: bytes) -> None:
    framer = Framer()
    for _ in range(10):
        assert framer.feed((pattern * 4096)[:4096]) == []
    assert framer.tried < 10 * 50
    assert GOOD[0] in [frame.raw for frame in framer.feed(GOOD[0])]


def test_a_frame_is_found_behind_32_false_beginnings_in_a_row() -> None:
    """Those before a good frame are none of the row; behind one more, the chunk is dropped."""
    false = b"\xfd\x00\x80\0"
    for count, found in ((32, GOOD[:2]), (33, GOOD[:1])):
        stream = false * 20 + GOOD[0] + false * (count - 1) + b"\xfd" + GOOD[1]
        assert [frame.raw for frame in Framer().feed(stream)] == found


def unknown(payload: bytes, *, signed: bool = False, number: int = 54321) -> bytes:
    """A frame of a message that no dialect has; its checksum can't be verified."""
    header = bytes([0xFD, len(payload), int(signed), 0, 9, 1, 1]) + number.to_bytes(3, "little")
    return header + payload + b"\x12\x34" + b"\xfd" * 13 * signed


@pytest.mark.parametrize("filled", [b"\xfd", b"\xfe", b"\xfd\x09\0\0\0\1\1\0\0\0"])
@pytest.mark.parametrize("signed", [False, True])
def test_an_unknown_message_full_of_beginnings_hides_no_known_one(
    filled: bytes, signed: bool
) -> None:
    """The rest of the datagram was lost: more than 32 beginnings in a row were false."""
    strange = unknown((filled * 255)[:255], signed=signed)
    datagram = strange + GOOD[0] + strange * 3 + GOOD[1] + GOOD[2]
    assert [frame.raw for frame in Framer().feed(datagram)] == GOOD[:3]


@given(st.lists(st.integers(0, 900), max_size=6))
def test_unknown_messages_are_stepped_over_however_the_stream_is_cut(places: list[int]) -> None:
    stream = (unknown(b"\xfd" * 255) + GOOD[0]) * 3
    cuts = [0, *sorted(min(place, len(stream)) for place in places), len(stream)]
    framer = Framer()
    found = [frame.raw for a, b in pairwise(cuts) for frame in framer.feed(stream[a:b])]
    assert found == [GOOD[0]] * 3


def test_eight_unknown_messages_in_a_row_are_stepped_over_and_thousands_raise_nothing() -> None:
    assert [f.raw for f in Framer().feed(unknown(b"\xfd" * 255) * 8 + GOOD[0])] == GOOD[:1]
    assert Framer().feed(unknown(b"") * 2000) == []
    assert [f.raw for f in Framer().feed(unknown(GOOD[1]) * 9 + GOOD[0])] == [GOOD[1], GOOD[0]]


@given(st.lists(noise | st.builds(unknown, st.binary(max_size=255)), max_size=30))
def test_no_more_is_kept_than_eight_unknown_messages_and_one_incomplete(
    chunks: list[bytes],
) -> None:
    framer = Framer()
    for chunk in chunks:
        framer.feed(chunk)
        assert len(framer._rest) <= 9 * LONGEST


OLD = wire.heartbeat().pack(common.MAVLink(None), force_mavlink1=True)
NO_FRAMES = {
    # The checksum leaves out the first byte: behind any other one this would be a good frame.
    "text": b"x" + OLD[1:],
    "a wrong checksum": OLD[:-1] + b"\0",
    "an unknown one at the end": unknown(b""),
    "an unknown one before text": unknown(b"") + b"text",
}


@pytest.mark.parametrize("after", NO_FRAMES.values(), ids=NO_FRAMES)
def test_what_no_good_frame_follows_hides_no_frame(after: bytes) -> None:
    assert [frame.raw for frame in Framer().feed(unknown(GOOD[0]) + after)] == GOOD[:1]


@pytest.mark.parametrize("number", [54321, 0x020000])
def test_unknown_messages_are_passed_to_who_asks_for_them(number: int) -> None:
    """Where a frame or the end of the chunk follows; known ones by their checksums, as ever."""
    strange, last = unknown(b"", number=number), unknown(b"last", number=number)
    bad = b"text" + OLD[:-1] + b"\0"
    found = Framer(unknown=True).feed(strange + OLD + strange + bad + last)
    assert [frame.raw for frame in found] == [strange, OLD, last]
    assert found[0].message_id == number
