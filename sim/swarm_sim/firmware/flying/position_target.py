"""SET_POSITION_TARGET_LOCAL_NED, read per axis; each persona keeps what its firmware uses. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from swarm_sim.physics.geodesy import Vector3

Axis = float | None
Axes = tuple[Axis, Axis, Axis]
"""North, east, down; None for an axis that is not given."""
NOTHING: Axes = (None, None, None)

FRAME_LOCAL_NED, FRAME_LOCAL_OFFSET_NED, FRAME_BODY_NED, FRAME_BODY_OFFSET_NED = 1, 7, 8, 9
"""MAV_FRAME."""
NO_POSITION = 0b111
"""Bits of the type mask that ignore all three axes of the position."""
_NO_YAW, _NO_YAW_RATE = 1 << 10, 1 << 11


class PositionTarget(NamedTuple):
    """A setpoint: positions [m] and velocities [m/s] of the axes that are not ignored."""

    frame: int
    position: Axes
    """In the vehicle's own local frame."""
    velocity: Axes
    yaw_rad: float | None
    yaw_rate_radps: float | None


def read_position_target(
    fields: Mapping[str, Any], heading_rad: float, local: Vector3
) -> PositionTarget | None:
    """The setpoint in `fields`; body frames are turned by the heading, offsets counted from
    `local`.

    None where a field that is not ignored isn't a finite number.
    """
    mask, frame = int(fields["type_mask"]), int(fields["coordinate_frame"])
    position = _axes(fields, ("x", "y", "z"), mask & NO_POSITION)
    velocity = _axes(fields, ("vx", "vy", "vz"), mask >> 3 & 7)
    yaw = None if mask & _NO_YAW else float(fields["yaw"])
    yaw_rate = None if mask & _NO_YAW_RATE else float(fields["yaw_rate"])
    if position is None or velocity is None or not (_usable(yaw) and _usable(yaw_rate)):
        return None
    if frame in (FRAME_BODY_NED, FRAME_BODY_OFFSET_NED):
        position, velocity = _turned(position, heading_rad), _turned(velocity, heading_rad)
        yaw = None if yaw is None else heading_rad + yaw
    if frame != FRAME_LOCAL_NED and position is not NOTHING:
        position = moved(position, local)
    return PositionTarget(frame, position, velocity, yaw, yaw_rate)


def moved(axes: Axes, by: Vector3) -> Axes:
    """The axes that are given, moved by `by`."""
    if axes is NOTHING:
        return axes
    (n, e, d), (dn, de, dd) = axes, by
    return (
        None if n is None else n + dn,
        None if e is None else e + de,
        None if d is None else d + dd,
    )


def _axes(fields: Mapping[str, Any], names: tuple[str, str, str], ignored: int) -> Axes | None:
    """Three fields, None for an ignored one; None where one that is not ignored isn't finite."""
    if ignored == 7:
        return NOTHING
    north, east, down = names
    n = None if ignored & 1 else float(fields[north])
    e = None if ignored & 2 else float(fields[east])
    d = None if ignored & 4 else float(fields[down])
    return (n, e, d) if _usable(n) and _usable(e) and _usable(d) else None


def _usable(value: Axis) -> bool:
    return value is None or math.isfinite(value)


def _turned(axes: Axes, heading_rad: float) -> Axes:
    forward, right, down = axes
    if forward is None or right is None:
        return (None, None, down)
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    return (c * forward - s * right, s * forward + c * right, down)
