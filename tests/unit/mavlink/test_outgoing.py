"""The setpoint that goes out every tick: the frames that pymavlink makes of it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.signing import LinkSigning

SPEEDS = st.floats(-20.0, 20.0)


@given(st.tuples(SPEEDS, SPEEDS, SPEEDS), st.floats(0.0, 1e7), st.integers(0, 255))
def test_a_setpoint_is_packed_as_by_pymavlink(
    velocity: tuple[float, float, float], now: float, seq: int
) -> None:
    """Byte by byte; zeros, the last number of a link and hours of mission time too."""
    setpoint, codec = outgoing.velocity(3, velocity, now), dialect.MAVLink(None, 250, 191)
    codec.seq = seq
    theirs = dialect.MAVLink_set_position_target_local_ned_message(**setpoint._asdict())
    assert setpoint.pack(codec) == theirs.pack(codec)
    assert (setpoint.get_msgId(), setpoint.msgname) == (theirs.get_msgId(), theirs.msgname)


def test_a_setpoint_on_a_signed_link_is_signed() -> None:
    """By pymavlink, with the link's key."""
    codec = dialect.MAVLink(None, 250, 191)
    LinkSigning(bytes(range(32)), 1000).equip(codec)
    packed = outgoing.velocity(3, (1.0, 0.0, 0.0), 2.0).pack(codec)
    assert packed[2] == 1
    assert len(packed) == 10 + 53 + 2 + 13


def test_a_setpoint_without_the_fast_checksum(monkeypatch: pytest.MonkeyPatch) -> None:
    """pymavlink's own makes the same frame."""
    codec, setpoint = dialect.MAVLink(None, 250, 191), outgoing.velocity(3, (1.0, 0.0, 0.0), 2.0)
    fast = setpoint.pack(codec)
    monkeypatch.setattr(outgoing.dialect, "mcrf4xx", None)
    monkeypatch.setattr(dialect, "x25crc", dialect._x25crc_slow)
    assert setpoint.pack(codec) == fast
