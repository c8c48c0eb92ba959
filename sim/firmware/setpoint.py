"""SET_POSITION_TARGET_LOCAL_NED, read per axis; each persona then keeps what its firmware would use. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sim.firmware.flight import Axis

FRAME_LOCAL_NED, FRAME_LOCAL_OFFSET_NED, FRAME_BODY_NED, FRAME_BODY_OFFSET_NED = 1, 7, 8, 9
_BODY = (FRAME_BODY_NED, FRAME_BODY_OFFSET_NED)

Axes = tuple[Axis, Axis, Axis]
NOTHING: Axes = (None, None, None)


@dataclass(frozen=True, slots=True)
class Setpoint:
    """Positions [m] and velocities [m/s] of the axes that are not ignored, in north, east, down."""

    frame: int
    position: Axes
    """In the vehicle's own local frame."""
    velocity: Axes
    yaw_rad: float | None
    yaw_rate_radps: float | None


def read_setpoint(fields: Mapping[str, Any], heading_rad: float, local: tuple[float, float, float]) -> Setpoint | None:
    """The setpoint in `fields`; body frames are turned by the heading, offsets counted from `local`.

    None where a field that is to be used isn't a finite number.
    """
    mask, frame = int(fields["type_mask"]), int(fields["coordinate_frame"])
    position = tuple(_axis(fields, name, mask >> i & 1) for i, name in enumerate(("x", "y", "z")))
    velocity = tuple(_axis(fields, name, mask >> (3 + i) & 1) for i, name in enumerate(("vx", "vy", "vz")))
    yaw = _axis(fields, "yaw", mask >> 10 & 1)
    yaw_rate = _axis(fields, "yaw_rate", mask >> 11 & 1)
    if not all(v is None or math.isfinite(v) for v in (*position, *velocity, yaw, yaw_rate)):
        return None
    if frame in _BODY:
        position, velocity = _turned(position, heading_rad), _turned(velocity, heading_rad)
        yaw = None if yaw is None else heading_rad + yaw
    if frame != FRAME_LOCAL_NED:
        position = tuple(None if p is None else p + at for p, at in zip(position, local, strict=True))
    return Setpoint(frame, _three(position), _three(velocity), yaw, yaw_rate)


def _axis(fields: Mapping[str, Any], name: str, ignored: int) -> Axis:
    return None if ignored else float(fields[name])


def _turned(axes: tuple[Axis, ...], heading_rad: float) -> tuple[Axis, ...]:
    forward, right, down = axes
    if forward is None or right is None:
        return (None, None, down)
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    return (c * forward - s * right, s * forward + c * right, down)


def _three(axes: tuple[Axis, ...]) -> Axes:
    return axes[0], axes[1], axes[2]
