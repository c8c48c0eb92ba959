"""Where to go and where to look, beside local setpoints: global ones, and a heading. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from sim.firmware.flying.maneuvers import Hold, Takeoff, Velocity
from sim.firmware.flying.setpoint import FRAME_LOCAL_NED, read_setpoint
from sim.firmware.message import Message, Result
from sim.firmware.protocol.commands import Command
from sim.firmware.protocol.mission_lists import ABSOLUTE_FRAMES, RELATIVE_FRAMES
from sim.physics.geodesy import Geodetic

if TYPE_CHECKING:
    from sim.firmware.base import Firmware

_NO_POSITION = 7
"""Bits of the mask that ignore all three axes."""


def set_global_target(f: Firmware, message: Message) -> None:
    """SET_POSITION_TARGET_GLOBAL_INT: as the local one, with a place on the ellipsoid."""
    fields = _local(f, message.fields)
    setpoint = (
        None if fields is None else read_setpoint(fields, f.sensed.heading_rad, f.local_position())
    )
    if setpoint is None:
        f.ignored += 1
    else:
        f.on_setpoint(setpoint)


def _local(f: Firmware, m: Mapping[str, Any]) -> dict[str, Any] | None:
    """The fields of the local message that says the same; None where there is no such place."""
    if m["coordinate_frame"] not in (*ABSOLUTE_FRAMES, *RELATIVE_FRAMES):
        return None
    local = {"coordinate_frame": FRAME_LOCAL_NED, "x": 0.0, "y": 0.0, "z": 0.0}
    if m["type_mask"] & _NO_POSITION != _NO_POSITION:
        lat_deg, lon_deg, alt_m = m["lat_int"] * 1e-7, m["lon_int"] * 1e-7, m["alt"]
        if not (abs(lat_deg) <= 90 and abs(lon_deg) <= 180 and abs(alt_m) < 1e5):
            return None
        if m["coordinate_frame"] in RELATIVE_FRAMES:
            alt_m += f.plane.geodetic_from_ned(f.home_ned).alt_m
        ned = f.plane.ned_from_geodetic(Geodetic(lat_deg, lon_deg, alt_m))
        local |= zip(
            "xyz", (a - b for a, b in zip(ned, f.local_origin_ned, strict=True)), strict=True
        )
    return {**m, **local}


def condition_yaw(f: Firmware, command: Command) -> Result:
    """CONDITION_YAW: p1 degrees, p3 the sense of a relative turn, p4 whether it is one. Turns a
    guided vehicle."""
    degrees, sense, relative = command.p[0], command.p[2], command.p[3]
    if not (0.0 <= degrees <= 360.0 and relative in (0.0, 1.0)):
        return Result.FAILED
    heading = math.radians(degrees)
    if relative:
        heading = f.demand.heading_rad + math.copysign(heading, sense)
    if isinstance(f.maneuver, Velocity):
        f.begin(replace(f.maneuver, heading_rad=heading, yaw_rate_radps=0.0))
    elif isinstance(f.maneuver, Hold):
        f.begin(Hold(heading))
    elif isinstance(f.maneuver, Takeoff) and f.maneuver.done:
        f.begin(Velocity((0.0, 0.0, 0.0), heading, f.demand.position_ned_m))
    return Result.ACCEPTED
