"""The messages that an agent sends, as pymavlink message objects: no bytes, no I/O.

Source of all numbers: the MAVLink common message set.
"""

from __future__ import annotations

import collections
import struct
from typing import Any, Final, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

Message: TypeAlias = Any
"""A `MAVLink_message` (pymavlink has no types)."""

AGENT_COMPONENT = dialect.MAV_COMP_ID_ONBOARD_COMPUTER
AUTOPILOT_COMPONENT = 1

VELOCITY_ONLY = 3527
"""type_mask: ignore position, acceleration, yaw and yaw rate; use all three velocity axes."""
FRAME_LOCAL_NED = 1

ARM_DISARM = dialect.MAV_CMD_COMPONENT_ARM_DISARM
FORCE = 21196.0
"""Parameter 2 of MAV_CMD_COMPONENT_ARM_DISARM: in any state."""
TAKEOFF = dialect.MAV_CMD_NAV_TAKEOFF
SET_MODE = dialect.MAV_CMD_DO_SET_MODE
SET_INTERVAL = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
REQUEST_MESSAGE = dialect.MAV_CMD_REQUEST_MESSAGE
CUSTOM_MODE = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED


_HEAD: Final = struct.Struct("<BBBBBBBHB")
_SETPOINT: Final[Any] = dialect.MAVLink_set_position_target_local_ned_message
_SETPOINT_ID: Final[int] = _SETPOINT.id
_CRC_EXTRA: Final = bytes([_SETPOINT.crc_extra])
_fields: Final[Any] = collections.namedtuple  # noqa: PYI024 - the names are pymavlink's


class Setpoint(_fields("_Fields", _SETPOINT.ordered_fieldnames)):  # type: ignore[misc]
    """SET_POSITION_TARGET_LOCAL_NED. It goes out every tick: this takes a third of the time of
    pymavlink's message object."""

    __slots__ = ()
    msgname = _SETPOINT.msgname

    def get_msgId(self) -> int:  # noqa: N802 - pymavlink's name
        """The message's number."""
        return _SETPOINT_ID

    def pack(self, codec: Any) -> bytes:
        """The frame, as of pymavlink's own."""
        if codec.signing.sign_outgoing or dialect.mcrf4xx is None:
            signed: bytes = _SETPOINT(**self._asdict()).pack(codec)
            return signed
        payload: bytes = _SETPOINT.unpacker.pack(*self)  # ends with the frame, which is no zero
        source = (codec.seq, codec.srcSystem, codec.srcComponent)
        body = _HEAD.pack(0xFD, len(payload), 0, 0, *source, _SETPOINT_ID, 0) + payload
        crc: int = dialect.mcrf4xx(body[1:] + _CRC_EXTRA)
        return body + crc.to_bytes(2, "little")


def heartbeat() -> Message:
    """HEARTBEAT of an onboard controller.

    ArduPilot's GCS failsafe goes by the sender's system id, whatever its type. PX4's counts every
    MAV_TYPE_GCS: as one of these, an agent would hide that the pilot's own ground station is lost.
    """
    kind, invalid = dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID
    return dialect.MAVLink_heartbeat_message(kind, invalid, 0, 0, dialect.MAV_STATE_ACTIVE, 3)


def timesync(now: float) -> Message:
    """TIMESYNC request: the vehicle answers with its own time in tc1 and ours back in ts1 [ns]."""
    return dialect.MAVLink_timesync_message(0, int(now * 1e9))


def command(system: int, number: int, *parameters: float) -> Message:
    """COMMAND_LONG to the autopilot of `system`; parameters left out are 0."""
    seven = (*parameters, *(0.0,) * (7 - len(parameters)))
    return dialect.MAVLink_command_long_message(system, AUTOPILOT_COMPONENT, number, 0, *seven)


def interval(system: int, message_id: int, rate_hz: float) -> Message:
    """SET_MESSAGE_INTERVAL: stream `message_id` at `rate_hz`."""
    return command(system, SET_INTERVAL, message_id, round(1e6 / rate_hz))


def no_stream(system: int, message_id: int) -> Message:
    """SET_MESSAGE_INTERVAL: send `message_id` no more."""
    return command(system, SET_INTERVAL, message_id, -1.0)


def request(system: int, message_id: int) -> Message:
    """REQUEST_MESSAGE: send `message_id` once."""
    return command(system, REQUEST_MESSAGE, message_id)


def velocity(system: int, velocity_ned_mps: tuple[float, float, float], now: float) -> Message:
    """SET_POSITION_TARGET_LOCAL_NED with a velocity [m/s] alone; frame 1, mask 3527."""
    time_ms = int(now * 1000.0) & 0xFFFFFFFF
    position = acceleration = (0.0, 0.0, 0.0)
    numbers = (*position, *velocity_ned_mps, *acceleration, 0.0, 0.0)  # and yaw, yaw rate
    target = (VELOCITY_ONLY, system, AUTOPILOT_COMPONENT, FRAME_LOCAL_NED)
    return Setpoint(time_ms, *numbers, *target)


def said_beside(system: int, text: str) -> bytes:
    """A STATUSTEXT (50 characters) of the computer beside the vehicle `system`, packed."""
    codec = dialect.MAVLink(None, system, AGENT_COMPONENT)
    words = text.encode("ascii", "replace")[:50]
    packed: bytes = dialect.MAVLink_statustext_message(dialect.MAV_SEVERITY_WARNING, words).pack(
        codec
    )
    return packed


def read_parameter(system: int, name: str) -> Message:
    """PARAM_REQUEST_READ by name."""
    by_name = (system, AUTOPILOT_COMPONENT, name.encode(), -1)
    return dialect.MAVLink_param_request_read_message(*by_name)


def set_parameter(system: int, name: str, value: float, kind: int) -> Message:
    """PARAM_SET; `value` already in the vehicle's encoding of MAV_PARAM_TYPE `kind`."""
    to = (system, AUTOPILOT_COMPONENT, name.encode())
    return dialect.MAVLink_param_set_message(*to, value, kind)
