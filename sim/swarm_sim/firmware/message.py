"""What a firmware takes and gives: MAVLink messages as plain records, and the numbers it uses.

`swarm_sim.network.codec` turns them into bytes and back. Names of messages, fields and enumerations
are MAVLink's (common.xml).
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, NamedTuple


class Message(NamedTuple):
    """One MAVLink message. `source` is (system, component) of the sender of a received one."""

    name: str
    fields: dict[str, Any]
    source: tuple[int, int] = (0, 0)


class MavCommand(NamedTuple):
    """A COMMAND_LONG or COMMAND_INT."""

    id: int
    frame: int
    """MAV_FRAME of the point in p[4:7]."""
    p: tuple[float, float, float, float, float, float, float]
    """The parameters; latitude and longitude in degrees."""
    target: tuple[int, int]
    source: tuple[int, int]


class MavResult(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    CANCELLED = 6


class MavSeverity(IntEnum):
    """MAV_SEVERITY."""

    EMERGENCY = 0
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    INFO = 6


class MavCmd(IntEnum):
    """MAV_CMD, of commands and of mission items."""

    NAV_WAYPOINT = 16
    NAV_LOITER_UNLIM = 17
    NAV_LOITER_TURNS = 18
    NAV_LOITER_TIME = 19
    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    NAV_SPLINE_WAYPOINT = 82
    NAV_DELAY = 93
    CONDITION_YAW = 115
    DO_SET_MODE = 176
    DO_JUMP = 177
    DO_CHANGE_SPEED = 178
    DO_SET_HOME = 179
    DO_SET_RELAY = 181
    DO_SET_SERVO = 183
    DO_FLIGHTTERMINATION = 185
    DO_LAND_START = 189
    DO_REPOSITION = 192
    DO_PAUSE_CONTINUE = 193
    DO_SET_ROI_LOCATION = 195
    DO_SET_ROI_NONE = 197
    DO_MOUNT_CONTROL = 205
    DO_FENCE_ENABLE = 207
    DO_GRIPPER = 211
    DO_SET_MISSION_CURRENT = 224
    PREFLIGHT_STORAGE = 245
    PREFLIGHT_REBOOT_SHUTDOWN = 246
    MISSION_START = 300
    COMPONENT_ARM_DISARM = 400
    RUN_PREARM_CHECKS = 401
    GET_HOME_POSITION = 410
    GET_MESSAGE_INTERVAL = 510
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512
    REQUEST_PROTOCOL_VERSION = 519
    REQUEST_AUTOPILOT_CAPABILITIES = 520
    REQUEST_CAMERA_INFORMATION = 521
    DO_GIMBAL_MANAGER_PITCHYAW = 1000
    IMAGE_START_CAPTURE = 2000


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


ABSOLUTE_FRAMES, RELATIVE_FRAMES, NO_PLACE_FRAME = (0, 5), (3, 6, 10, 11), 2
"""MAV_FRAME: heights above sea level; above home (and above terrain); no point at all."""
MAV_TYPE_GCS = 6
MAV_MODE_FLAG_CUSTOM = 1
