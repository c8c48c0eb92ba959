"""Setpoints with a local or global position, and CONDITION_YAW. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from swarm_sim.firmware.autopilot import SimAutopilot
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
    MavCommand,
    MavResult,
    Message,
)


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
