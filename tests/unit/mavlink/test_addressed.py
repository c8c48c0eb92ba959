"""Whom a frame is for, read from its bytes: as pymavlink's decoding says, for every message."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.mavlink.addressed import asks_for_streams, target_system, told_mode
from swarm_ctl.mavlink.framer import Framer, MavlinkFrame


def frame(message: Any, *, first: bool = False) -> MavlinkFrame:
    """A frame of MAVLink 2, or of 1."""
    (found,) = Framer().feed(message.pack(dialect.MAVLink(None, 255, 190), force_mavlink1=first))
    return found


def blank(kind: Any, **values: Any) -> Any:
    """A message with these fields; all others are zero."""
    zeros = [
        b"" if of == "char" and length else [0] * length if length else 0
        for of, length in zip(
            kind.fieldtypes,
            [kind.array_lengths[kind.ordered_fieldnames.index(n)] for n in kind.fieldnames],
            strict=True,
        )
    ]
    return kind(*(values.get(name, z) for name, z in zip(kind.fieldnames, zeros, strict=True)))


TARGETED = [k for k in dialect.mavlink_map.values() if "target_system" in k.fieldnames]


def test_the_target_of_each_message_that_has_one() -> None:
    for kind in TARGETED:
        assert target_system(frame(blank(kind, target_system=7))) == 7, kind.msgname
        if kind.id < 256:
            assert target_system(frame(blank(kind, target_system=7), first=True)) == 7, kind.msgname


def test_a_target_left_out_with_trailing_zeros_is_all() -> None:
    assert target_system(frame(dialect.MAVLink_request_data_stream_message(0, 0, 0, 4, 0))) == 0
    assert target_system(frame(dialect.MAVLink_system_time_message(1, 2))) == 0


def test_requests_for_streams() -> None:
    long = dialect.MAVLink_command_long_message
    assert asks_for_streams(frame(dialect.MAVLink_request_data_stream_message(1, 1, 0, 4, 1)))
    assert asks_for_streams(frame(long(1, 1, 511, 0, 32, 1e6, 0, 0, 0, 0, 0)))
    assert asks_for_streams(
        frame(dialect.MAVLink_command_int_message(1, 1, 0, 511, 0, 0, 32, 1e6, 0, 0, 0, 0, 0))
    )
    assert not asks_for_streams(frame(long(1, 1, 512, 0, 32, 0, 0, 0, 0, 0, 0)))
    assert not asks_for_streams(frame(dialect.MAVLink_param_request_list_message(1, 1)))


def test_armed_or_not_by_the_autopilots_heartbeat_alone() -> None:
    def heartbeat(base_mode: int, component: int) -> MavlinkFrame:
        message = dialect.MAVLink_heartbeat_message(2, 3, base_mode, 4, 4, 3)
        (found,) = Framer().feed(message.pack(dialect.MAVLink(None, 1, component)))
        return found

    assert told_mode(heartbeat(128 | 1, 1)) == (3, 4, True)
    assert told_mode(heartbeat(1, 1)) == (3, 4, False)
    assert told_mode(heartbeat(128, 154)) is None
    assert told_mode(frame(dialect.MAVLink_system_time_message(1, 2))) is None
