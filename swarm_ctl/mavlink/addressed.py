"""Whom a frame is for and how urgent it is, read from its bytes without decoding the message."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterator
from enum import IntEnum
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.mavlink.framer import MavlinkFrame

_V2: Final = 0xFD
_HEADER: Final = {True: 10, False: 6}
_SIZES: Final = {"char": 1, "int8_t": 1, "uint8_t": 1, "int16_t": 2, "uint16_t": 2, "float": 4}
_COMMANDS: Final = (dialect.MAVLINK_MSG_ID_COMMAND_LONG, dialect.MAVLINK_MSG_ID_COMMAND_INT)
_COMMAND_AT: Final = 28
"""Where both have the command's number: behind seven numbers of four bytes."""
_REQUESTS: Final = (
    dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
    dialect.MAV_CMD_GET_MESSAGE_INTERVAL,
    dialect.MAV_CMD_REQUEST_MESSAGE,
)
_SETPOINTS: Final = (
    dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
    dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
    dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
    dialect.MAVLINK_MSG_ID_MANUAL_CONTROL,
    dialect.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE,
)
_POSITIONS: Final = (
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
)
_ARMED: Final = dialect.MAV_MODE_FLAG_SAFETY_ARMED
_AUTOPILOT_AT: Final = 5
_BASE_MODE_AT: Final = 6
_NAME_AT, _NAME_BYTES = 6, 16
"""Of PARAM_SET."""
_OPCODE_AT: Final = 6
_FTP_WRITES: Final = (6, 7, 11)
"""CreateFile, WriteFile, OpenFileWO."""


class Urgency(IntEnum):
    """What a link that is full sends first: the lesser number."""

    COMMAND = 0
    """A mode, arming, take-off, termination: rare."""
    SETPOINT = 1
    HEARTBEAT = 2
    REST = 3
    """Requests, streams, parameters."""


def urgency(frame: MavlinkFrame) -> Urgency:
    """How urgent a frame to a vehicle is."""
    if frame.message_id in _SETPOINTS:
        return Urgency.SETPOINT
    if frame.message_id == dialect.MAVLINK_MSG_ID_HEARTBEAT:
        return Urgency.HEARTBEAT
    if frame.message_id == dialect.MAVLINK_MSG_ID_SET_MODE:
        return Urgency.COMMAND
    if frame.message_id in _COMMANDS and _command(frame) not in _REQUESTS:
        return Urgency.COMMAND
    return Urgency.REST


def what(frame: MavlinkFrame) -> tuple[int, int, bytes]:
    """The same for two frames of which the newer one makes the older one superfluous: sender,
    message, and the payload where that is more than the newest value of a stream."""
    newest = urgency(frame) in (Urgency.SETPOINT, Urgency.HEARTBEAT)
    newest = newest or frame.message_id == dialect.MAVLINK_MSG_ID_TIMESYNC
    begin = _HEADER[frame.raw[0] == _V2]
    payload = b"" if newest else frame.raw[begin : begin + frame.raw[1]]
    return frame.system, frame.message_id, payload


def boot_ms(frame: MavlinkFrame) -> int | None:
    """The vehicle's time of a position; None: the frame is no position."""
    if frame.message_id not in _POSITIONS:
        return None
    return sum(_byte(frame, at) << 8 * at for at in range(4))


def target_system(frame: MavlinkFrame) -> int:
    """The system id that the frame names as its target; 0: all, or the message has no target."""
    at = _TARGET_AT.get(frame.message_id)
    return 0 if at is None else _byte(frame, at)


def asks_for_streams(frame: MavlinkFrame) -> bool:
    """It would change how often the vehicle sends something on the link that it comes by."""
    if frame.message_id == dialect.MAVLINK_MSG_ID_REQUEST_DATA_STREAM:
        return True
    return frame.message_id in _COMMANDS and _command(frame) == dialect.MAV_CMD_SET_MESSAGE_INTERVAL


def sets_parameter(frame: MavlinkFrame) -> str:
    """The name in a PARAM_SET, in capitals as autopilots find it by; '' of another message."""
    if frame.message_id != dialect.MAVLINK_MSG_ID_PARAM_SET:
        return ""
    name = bytes(_byte(frame, at) for at in range(_NAME_AT, _NAME_AT + _NAME_BYTES))
    return name.split(b"\0")[0].decode("ascii", "replace").upper()


def writes_file(frame: MavlinkFrame) -> bool:
    """It writes a file by MAVLink FTP; an ArduPilot takes parameters so, too (@PARAM)."""
    ftp = frame.message_id == dialect.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL
    return ftp and _byte(frame, _OPCODE_AT) in _FTP_WRITES


class ToldMode(NamedTuple):
    """What a HEARTBEAT tells."""

    autopilot: int
    """MAV_AUTOPILOT."""
    custom_mode: int
    armed: bool


def told_mode(frame: MavlinkFrame) -> ToldMode | None:
    """What a vehicle's HEARTBEAT tells; None: the frame is none of an autopilot's."""
    if frame.message_id != dialect.MAVLINK_MSG_ID_HEARTBEAT or frame.component != 1:
        return None
    mode = sum(_byte(frame, at) << 8 * at for at in range(4))
    armed = bool(_byte(frame, _BASE_MODE_AT) & _ARMED)
    return ToldMode(_byte(frame, _AUTOPILOT_AT), mode, armed)


def _command(frame: MavlinkFrame) -> int:
    return _byte(frame, _COMMAND_AT) | _byte(frame, _COMMAND_AT + 1) << 8


def _byte(frame: MavlinkFrame, at: int) -> int:
    """A byte of the payload; MAVLink 2 leaves trailing zeros out."""
    raw = frame.raw
    return raw[_HEADER[raw[0] == _V2] + at] if at < raw[1] else 0


def _offsets(kind: Any) -> Iterator[tuple[str, int]]:
    """Name and place of each field in the payload."""
    types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
    counts = [max(1, length) for length in kind.array_lengths]
    sizes = [
        _SIZES.get(types[name], 8 if types[name].endswith(("64_t", "double")) else 4) * count
        for name, count in zip(kind.ordered_fieldnames, counts, strict=True)
    ]
    if sum(sizes) != struct.calcsize(kind.unpacker.format):
        raise AssertionError(f"{kind.msgname}: the sizes of its fields are not known")
    return zip(kind.ordered_fieldnames, itertools.accumulate(sizes, initial=0), strict=False)


_TARGET_AT: Final = {
    number: at
    for number, kind in dialect.mavlink_map.items()
    for name, at in _offsets(kind)
    if name == "target_system"
}
