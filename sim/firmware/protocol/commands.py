"""COMMAND_LONG and COMMAND_INT: what both personas answer alike, as a table from MAV_CMD to
function. Pure.

Each persona adds its own rows (`Ardupilot.commands`, `Px4.commands`); a command in neither is
UNSUPPORTED.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING, Any

from sim.firmware.message import MESSAGE_NAMES, Cmd, Message, Result
from sim.firmware.protocol.telemetry import BUILDERS
from sim.physics.geodesy import Geodetic, Vector3

if TYPE_CHECKING:
    from sim.firmware.base import Firmware

MAX_RATE_HZ = 400.0
"""The firmwares' main loop: no stream is faster."""
MAX_SPEED_MPS = 20.0
FORCE_DISARM = 21196.0
REBOOT_S = 3.0
_RELATIVE_FRAMES = (3, 6)
"""MAV_FRAME_GLOBAL_RELATIVE_ALT, _INT: heights above home."""


@dataclass(frozen=True, slots=True)
class Command:
    """COMMAND_LONG or COMMAND_INT; x and y of the latter already in degrees."""

    id: int
    frame: int
    """MAV_FRAME of the position in p[4:7]."""
    p: tuple[float, float, float, float, float, float, float]
    target: tuple[int, int]
    source: tuple[int, int]


Handler = Callable[[Any, Command], Result | None]
"""From the firmware and a command to the answer; None: no answer, or it has been given already."""


def read_command(message: Message) -> Command:
    """The command in a COMMAND_LONG or COMMAND_INT."""
    f = message.fields
    target = (f["target_system"], f["target_component"])
    numbers = (f["param1"], f["param2"], f["param3"], f["param4"])
    if message.name == "COMMAND_INT":
        place = (f["x"] * 1e-7, f["y"] * 1e-7, f["z"])
        return Command(f["command"], f["frame"], (*numbers, *place), target, message.source)
    return Command(
        f["command"], 0, (*numbers, f["param5"], f["param6"], f["param7"]), target, message.source
    )


def place(f: Firmware, command: Command) -> Vector3 | None:
    """NED of the point in p[4:7]; missing coordinates are the current ones; None where there is no
    such point."""
    here = f.plane.geodetic_from_ned(f.sensed.position_ned_m)
    lat, lon, alt = (
        b if math.isnan(a) else a for a, b in zip(command.p[4:7], astuple(here), strict=True)
    )
    if not (abs(lat) <= 90 and abs(lon) <= 180 and abs(alt) < 1e5):
        return None
    if command.frame in _RELATIVE_FRAMES and not math.isnan(command.p[6]):
        alt += f.plane.geodetic_from_ned(f.home_ned).alt_m
    return f.plane.ned_from_geodetic(Geodetic(lat, lon, alt))


def arm(f: Firmware, command: Command) -> Result | None:
    """COMPONENT_ARM_DISARM; a repeat changes nothing and is accepted."""
    wanted, magic = command.p[0], command.p[1]
    if wanted == 1.0:
        return Result.ACCEPTED if f.armed else f.arm(force=magic == f.force_arm_magic)
    if wanted == 0.0:
        return f.disarm(force=magic == FORCE_DISARM) if f.armed else Result.ACCEPTED
    return f.arm_nonsense


def set_message_interval(f: Firmware, command: Command) -> Result:
    """SET_MESSAGE_INTERVAL: p2 microseconds, 0 the default, -1 off."""
    name, interval_us = _message_name(command.p[0]), command.p[1]
    if name is None or not math.isfinite(interval_us) or 0 < interval_us < 1e6 / MAX_RATE_HZ:
        return Result.DENIED
    default = f.boot_streams.get(name)
    interval_s = interval_us * 1e-6 if interval_us > 0 else default if interval_us == 0 else None
    f.streams.set(name, interval_s, f.now)
    return Result.ACCEPTED


def request_message(f: Firmware, command: Command) -> Result:
    """REQUEST_MESSAGE."""
    name = _message_name(command.p[0])
    return Result.FAILED if name is None else _send_once(f, name)


def reboot(f: Firmware, command: Command) -> Result | None:
    """PREFLIGHT_REBOOT_SHUTDOWN: silent for a while, then as after power-up; parameters stay."""
    if command.p[0] != 1.0:
        return Result.DENIED
    if f.armed and not f.sensed.landed:
        return f.refusal
    f.acknowledge(command.id, Result.ACCEPTED, command.source)
    f.start(f.sensed, f.now + REBOOT_S)
    return None


def change_speed(f: Firmware, command: Command) -> Result:
    """DO_CHANGE_SPEED: of what the vehicle flies by itself."""
    speed = command.p[1]
    if not (math.isfinite(speed) and speed > 0):
        return f.refusal
    f.speed_mps = min(speed, MAX_SPEED_MPS)
    f.update_demand()
    return Result.ACCEPTED


def reposition(f: Firmware, command: Command) -> Result:
    """DO_REPOSITION: fly there and stay."""
    where = place(f, command)
    if where is None or f.sensed.landed or not f.armed:
        return Result.DENIED
    return f.go_to(where)


def set_home(f: Firmware, command: Command) -> Result:
    """DO_SET_HOME: p1 = 1 here, else the given place."""
    where = f.sensed.position_ned_m if command.p[0] == 1.0 else place(f, command)
    if where is None or not f.ready():
        return f.refusal
    f.home_ned = where
    return Result.ACCEPTED


def _send_once(f: Firmware, name: str) -> Result:
    found = BUILDERS[name](f)
    for fields in found:
        f.say(name, fields, private=True)
    return Result.ACCEPTED if found or name == "ADSB_VEHICLE" else Result.FAILED


def _message_name(number: float) -> str | None:
    return (
        MESSAGE_NAMES.get(int(number)) if math.isfinite(number) and number == int(number) else None
    )


def set_mission_current(f: Firmware, command: Command) -> Result:
    """DO_SET_MISSION_CURRENT."""
    index = command.p[0]
    if not (math.isfinite(index) and f.go_on_at(int(index))):
        return f.refusal
    f.say_current()
    return Result.ACCEPTED


COMMON: dict[int, Handler] = {
    Cmd.DO_SET_MISSION_CURRENT: set_mission_current,
    Cmd.COMPONENT_ARM_DISARM: arm,
    Cmd.SET_MESSAGE_INTERVAL: set_message_interval,
    Cmd.REQUEST_MESSAGE: request_message,
    Cmd.REQUEST_AUTOPILOT_CAPABILITIES: lambda f, _: _send_once(f, "AUTOPILOT_VERSION"),
    Cmd.GET_HOME_POSITION: lambda f, _: _send_once(f, "HOME_POSITION"),
    Cmd.PREFLIGHT_REBOOT_SHUTDOWN: reboot,
    Cmd.DO_CHANGE_SPEED: change_speed,
    Cmd.DO_REPOSITION: reposition,
    Cmd.DO_SET_HOME: set_home,
}
