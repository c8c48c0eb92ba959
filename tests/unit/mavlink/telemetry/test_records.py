"""A record has the same fields as pymavlink's message, whatever the payload."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.mavlink.framer import Framer
from swarm_ctl.mavlink.telemetry.incoming import FOLDS_BY_ID
from swarm_ctl.mavlink.telemetry.records import read

UNREAD = {"callsign"}


def frame_bytes(number: int, payload: bytes, *, old: bool) -> bytes:
    head = bytes([len(payload), 7, 3, 1, number] if old else [len(payload), 0, 0, 7, 3, 1])
    body = head + (b"" if old else number.to_bytes(3, "little")) + payload
    extra = bytes([dialect.mavlink_map[number].crc_extra])
    checksum = dialect.x25crc(body + extra).crc.to_bytes(2, "little")
    return (b"\xfe" if old else b"\xfd") + body + checksum


@given(st.sampled_from(sorted(FOLDS_BY_ID)), st.binary(min_size=1, max_size=255), st.booleans())
def test_a_record_is_what_pymavlink_reads(number: int, payload: bytes, old: bool) -> None:
    (frame,) = Framer().feed(frame_bytes(number, payload, old=old and number < 256))
    codec = dialect.MAVLink(None)
    found, message = read(frame, codec), codec.decode(bytearray(frame.raw))
    assert found.get_msgId() == message.get_msgId() == number
    for name in set(message.get_fieldnames()) - UNREAD:
        assert repr(getattr(found, name)) == repr(getattr(message, name)), name
