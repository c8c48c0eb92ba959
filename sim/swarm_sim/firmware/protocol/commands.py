"""COMMAND_LONG and COMMAND_INT: what both personas answer alike, as a table from MAV_CMD to
function. Pure.

Each persona adds its own rows (`commands`); a command in neither is UNSUPPORTED.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import astuple, replace
from typing import Any

from swarm_sim.firmware.autopilot import CommandHandler, SimAutopilot
from swarm_sim.firmware.flying.maneuvers import (
    STILL,
    HoldManeuver,
    TakeoffManeuver,
    VelocityManeuver,
)
from swarm_sim.firmware.flying.position_target import (
    FRAME_LOCAL_NED,
    NO_POSITION,
    read_position_target,
)
from swarm_sim.firmware.message import (
    ABSOLUTE_FRAMES,
    RELATIVE_FRAMES,
    MavCmd,
    MavCommand,
    MavResult,
    Message,
)
from swarm_sim.firmware.protocol import uploaded_mission
from swarm_sim.firmware.protocol.telemetry import MESSAGES, readings
from swarm_sim.physics.geodesy import Vector3

MAX_RATE_HZ = 400.0
"""The firmwares' main loop: no stream is faster."""
FORCE_DISARM = 21196.0
MESSAGE_INTERVAL, AVAILABLE_MODES = 244, 435
_ADVANCED = 1
"""MAV_MODE_PROPERTY."""
REBOOT_S = 3.0
_HOME_FRAMES = (3, 6)
"""MAV_FRAME_GLOBAL_RELATIVE_ALT, _INT: heights above home."""


def read_command(message: Message) -> MavCommand:
    """The command in a COMMAND_LONG or COMMAND_INT."""
    f = message.fields
    target = (f["target_system"], f["target_component"])
    numbers = (f["param1"], f["param2"], f["param3"], f["param4"])
    if message.name == "COMMAND_INT":
        frame, place = f["frame"], (f["x"] * 1e-7, f["y"] * 1e-7, f["z"])
    else:
        frame, place = 0, (f["param5"], f["param6"], f["param7"])
    return MavCommand(f["command"], frame, (*numbers, *place), target, message.source)


def _place(a: SimAutopilot, command: MavCommand) -> Vector3 | None:
    """NED of the point in p[4:7], NaN for the current coordinate; None for an impossible point."""
    given, here = command.p[4:7], astuple(a.geodetic())
    lat, lon, alt = (h if math.isnan(g) else g for g, h in zip(given, here, strict=True))
    if not (abs(lat) <= 90 and abs(lon) <= 180 and abs(alt) < 1e5):
        return None
    above_home = command.frame in _HOME_FRAMES and not math.isnan(given[2])
    return a.ned(lat, lon, alt, above_home=above_home)


def arm(a: SimAutopilot, command: MavCommand) -> MavResult | None:
    """COMPONENT_ARM_DISARM; a repeat changes nothing and is accepted."""
    wanted, magic = command.p[0], command.p[1]
    if wanted == 1.0:
        return MavResult.ACCEPTED if a.armed else a.arm(force=magic == a.force_arm_magic)
    if wanted == 0.0:
        return a.disarm(force=magic == FORCE_DISARM) if a.armed else MavResult.ACCEPTED
    return a.arm_nonsense


def set_message_interval(a: SimAutopilot, command: MavCommand) -> MavResult:
    """p2 microseconds, 0 the default, -1 off."""
    name, interval_us = _NAMES.get(command.p[0]), command.p[1]
    if name is None:
        return a.unknown_interval
    if not math.isfinite(interval_us) or 0 < interval_us < 1e6 / MAX_RATE_HZ:
        return MavResult.DENIED
    default = a.boot_streams.get(name)
    interval_s = interval_us * 1e-6 if interval_us > 0 else default if interval_us == 0 else None
    a.streams.set(name, interval_s, a.now)
    return MavResult.ACCEPTED


def say_message_interval(a: SimAutopilot, number: float) -> bool:
    """MESSAGE_INTERVAL of this message: 0 where there is none, -1 where it is not streamed. Whether
    it is known."""
    name = _NAMES.get(number)
    interval_s = None if name is None else a.streams.interval_s.get(name)
    told_us = 0 if name is None else -1 if interval_s is None else round(interval_s * 1e6)
    asked = int(number) if math.isfinite(number) else 0
    fields = {"message_id": max(0, min(0xFFFF, asked)), "interval_us": told_us}
    a.say("MESSAGE_INTERVAL", fields, private=True)
    return name is not None


def get_message_interval(a: SimAutopilot, command: MavCommand) -> MavResult:
    known = say_message_interval(a, command.p[0])
    return MavResult.ACCEPTED if known or a.refusal is not MavResult.FAILED else MavResult.FAILED


def request_message(a: SimAutopilot, command: MavCommand) -> MavResult:
    if command.p[0] == AVAILABLE_MODES:
        return _say_modes(a, command.p[1])
    if command.p[0] == MESSAGE_INTERVAL and a.unknown_message is MavResult.FAILED:
        return get_message_interval(a, command._replace(p=(*command.p[1:], 0.0)))
    name = _NAMES.get(command.p[0])
    if name is None:
        promised = command.p[0] in a.promised_messages
        return MavResult.ACCEPTED if promised else a.unknown_message
    return _send_once(a, name)


def _say_modes(a: SimAutopilot, wanted: float) -> MavResult:
    """AVAILABLE_MODES: the mode of this index, from 1 on; 0: all of them."""
    if not (wanted == 0 or wanted in range(1, len(a.modes) + 1)):
        return MavResult.ACCEPTED if a.bad_number is MavResult.DENIED else MavResult.DENIED
    for index, mode in enumerate(a.modes.values(), 1):
        if wanted in (0, index):
            fields = {
                "number_modes": len(a.modes),
                "mode_index": index,
                "standard_mode": mode.standard,
                "custom_mode": mode.custom,
                "properties": _ADVANCED if mode.advanced else 0,
                # A standard mode has a name that every ground station knows.
                "mode_name": b"" if mode.standard else (mode.shown or mode.name).encode(),
            }
            a.say("AVAILABLE_MODES", fields, private=True)
    return MavResult.ACCEPTED


def reboot(a: SimAutopilot, command: MavCommand) -> MavResult | None:
    """Silent for a while, then as after power-up; parameters stay."""
    if command.p[0] != 1.0:
        return a.refusal if a.armed and a.arm_nonsense else a.arm_nonsense or MavResult.DENIED
    if a.armed and not a.sensed.landed:
        return a.refusal
    a.acknowledge(command.id, MavResult.ACCEPTED, command.source)
    a.start(a.sensed, a.now + REBOOT_S)
    return None


def change_speed(a: SimAutopilot, command: MavCommand) -> MavResult:
    speed = command.p[1]
    if not (math.isfinite(speed) and speed > 0):
        return a.bad_number
    a.set_speed(speed)
    a.update_demand()
    return MavResult.ACCEPTED


def reposition(a: SimAutopilot, command: MavCommand) -> MavResult:
    where = _place(a, command)
    if where is None:
        return a.bad_number
    return MavResult.ACCEPTED if a.sensed.landed or not a.armed else a.go_to(where)


def set_home(a: SimAutopilot, command: MavCommand) -> MavResult:
    """p1 = 1 (ArduCopter: or 0, 0 for latitude and longitude): here; else the given place, however
    far."""
    here = command.p[0] == 1.0 or (a.zero_is_here and command.p[4:6] == (0.0, 0.0))
    where = a.sensed.position_ned_m if here else _place(a, command)
    if where is None or not a.ready():
        return MavResult.ACCEPTED if a.bad_number is MavResult.ACCEPTED else a.refusal
    a.home_ned = where
    return MavResult.ACCEPTED


def set_mission_current(a: SimAutopilot, command: MavCommand) -> MavResult:
    index = command.p[0]
    if not (math.isfinite(index) and uploaded_mission.go_on_at(a, int(index))):
        return MavResult.DENIED
    uploaded_mission.say_current(a)
    return MavResult.ACCEPTED


def _send_once(a: SimAutopilot, name: str) -> MavResult:
    found = readings(a, name)
    for fields in found:
        a.say(name, fields, private=True)
    return MavResult.ACCEPTED if found or name == "ADSB_VEHICLE" else MavResult.FAILED


_NAMES: dict[float, str] = {number: name for name, (number, _) in MESSAGES.items()}


COMMON: dict[int, CommandHandler] = {
    MavCmd.COMPONENT_ARM_DISARM: arm,
    MavCmd.SET_MESSAGE_INTERVAL: set_message_interval,
    MavCmd.GET_MESSAGE_INTERVAL: get_message_interval,
    MavCmd.REQUEST_MESSAGE: request_message,
    MavCmd.REQUEST_AUTOPILOT_CAPABILITIES: lambda a, _: _send_once(a, "AUTOPILOT_VERSION"),
    MavCmd.GET_HOME_POSITION: lambda a, _: _send_once(a, "HOME_POSITION"),
    MavCmd.PREFLIGHT_REBOOT_SHUTDOWN: reboot,
    MavCmd.DO_CHANGE_SPEED: change_speed,
    MavCmd.DO_REPOSITION: reposition,
    MavCmd.DO_SET_HOME: set_home,
}


def set_position_target(a: SimAutopilot, message: Message) -> None:
    """SET_POSITION_TARGET_LOCAL_NED, and _GLOBAL_INT with a place on the ellipsoid."""
    is_global = message.name.endswith("GLOBAL_INT")
    fields = _local(a, message.fields) if is_global else message.fields
    target = None
    if fields is not None:
        target = read_position_target(fields, a.sensed.heading_rad, a.local_position())
    if target is None:
        a.ignored += 1
    else:
        a.on_position_target(target)


def _local(a: SimAutopilot, m: Mapping[str, Any]) -> dict[str, Any] | None:
    """The fields of the local message that says the same; None where there is no such place."""
    if m["coordinate_frame"] not in (*ABSOLUTE_FRAMES, *RELATIVE_FRAMES):
        return None
    local = {"coordinate_frame": FRAME_LOCAL_NED, "x": 0.0, "y": 0.0, "z": 0.0}
    if m["type_mask"] & NO_POSITION != NO_POSITION:
        lat_deg, lon_deg, alt_m = m["lat_int"] * 1e-7, m["lon_int"] * 1e-7, m["alt"]
        if not (abs(lat_deg) <= 90 and abs(lon_deg) <= 180 and abs(alt_m) < 1e5):
            return None
        above_home = m["coordinate_frame"] in RELATIVE_FRAMES
        ned = a.ned(lat_deg, lon_deg, alt_m, above_home=above_home)
        axes = (p - o for p, o in zip(ned, a.local_origin_ned, strict=True))
        local |= zip("xyz", axes, strict=True)
    return {**m, **local}


def condition_yaw(a: SimAutopilot, command: MavCommand) -> MavResult:
    """CONDITION_YAW turns a guided vehicle: p1 degrees, p3 sense, p4 whether p1 is relative."""
    degrees, sense, relative = command.p[0], command.p[2], command.p[3]
    if not (0.0 <= degrees <= 360.0 and relative in (0.0, 1.0)):
        return MavResult.FAILED
    heading = math.radians(degrees)
    if relative:
        heading = a.demand.heading_rad + math.copysign(heading, sense)
    if isinstance(a.maneuver, VelocityManeuver):
        a.begin(replace(a.maneuver, heading_rad=heading, yaw_rate_radps=0.0))
    elif isinstance(a.maneuver, HoldManeuver):
        a.begin(HoldManeuver(heading))
    elif isinstance(a.maneuver, TakeoffManeuver) and a.maneuver.done:
        a.begin(VelocityManeuver(STILL, heading, a.demand.position_ned_m))
    return MavResult.ACCEPTED
