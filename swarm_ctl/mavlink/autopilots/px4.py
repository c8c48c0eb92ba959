"""PX4: flown in OFFBOARD by velocity setpoints."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.timeouts import SETPOINT_TIMEOUT_S
from swarm_ctl.core.model.vehicle import Vector3
from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.autopilots.base import Autopilot
from swarm_ctl.mavlink.autopilots.timing import (
    RETRY_S,
    STREAM_BEFORE_S,
    STREAM_GAP_S,
    TAKEOFF_RETRY_S,
)
from swarm_ctl.mavlink.incoming import Heard
from swarm_ctl.mavlink.outgoing import Message

MODES = {
    (1, 0): "MANUAL",
    (2, 0): "ALTCTL",
    (3, 0): "POSCTL",
    (4, 1): "AUTO.READY",
    (4, 2): "AUTO.TAKEOFF",
    (4, 3): "AUTO.LOITER",
    (4, 4): "AUTO.MISSION",
    (4, 5): "AUTO.RTL",
    (4, 6): "AUTO.LAND",
    (4, 8): "AUTO.FOLLOW",
    (4, 9): "AUTO.PRECLAND",
    (5, 0): "ACRO",
    (6, 0): "OFFBOARD",
    (7, 0): "STABILIZED",
}
"""px4_custom_mode.h: main mode, sub mode; custom_mode is main << 16 | sub << 24."""
_NUMBERS = {name: numbers for numbers, name in MODES.items()}
_PREARM = dialect.MAV_SYS_STATUS_PREARM_CHECK


class Px4(Autopilot):
    """PX4 1.14 and later (PREARM_CHECK in SYS_STATUS)."""

    name: ClassVar[str] = "px4"
    wire_id: ClassVar[int] = dialect.MAV_AUTOPILOT_PX4
    controlled_mode: ClassVar[str] = "OFFBOARD"
    landing_mode: ClassVar[str] = "AUTO.LAND"
    takeoff_modes: ClassVar[tuple[str, ...]] = ("AUTO.TAKEOFF", "AUTO.LOITER")
    """Only from there OFFBOARD is entered."""
    wind_message: ClassVar[str] = "WIND_COV"  # with EKF2_DRAG_CTRL 1
    failsafes: ClassVar[Mapping[str, float]] = {
        # A silent agent's vehicle leaves OFFBOARD after this. It comes with 1.0; less would be hit
        # by a slow moment.
        "COM_OF_LOSS_T": SETPOINT_TIMEOUT_S["px4"],
        # ... and lands (4) in place. Position mode (0), which it comes with, waits for a pilot who
        # may not be there.
        "COM_OBL_RC_ACT": 4.0,
    }

    def __init__(self, system: int) -> None:
        super().__init__(system)
        self._streaming_since = -math.inf
        self._last_setpoint_s = -math.inf

    def mode(self, custom_mode: int | None) -> str:
        """`OFFBOARD`, `AUTO.LOITER`, ...; `MODE 9/0` for numbers nobody here knows."""
        if custom_mode is None:
            return ""
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        return (
            MODES.get((main, sub))
            or (MODES.get((main, 0)) if main != 4 else None)
            or f"MODE {main}/{sub}"
        )

    def set_mode(self, mode: str) -> Message:
        """DO_SET_MODE with main and sub mode in parameters 2 and 3."""
        return outgoing.command(
            self.system, outgoing.SET_MODE, outgoing.CUSTOM_MODE, *_NUMBERS[mode]
        )

    def prearm(self, heard: Heard) -> bool:
        """PREARM_CHECK healthy. PX4 never says that it is present or enabled
        (streams/SYS_STATUS.hpp)."""
        return bool(heard.sensors_health & _PREARM)

    def climb(self, heard: Heard, height_m: float, now: float) -> list[Message]:
        """Hold mode, arm, NAV_TAKEOFF (height above sea level): each once the one before is seen to
        be so."""
        mode = self.mode(heard.custom_mode)
        if self.left(mode, *self.takeoff_modes) or not heard.on_ground:
            return []
        if not heard.armed:
            if mode not in self.takeoff_modes:
                hold = self.set_mode("AUTO.LOITER")
                return [hold] if self.pacer.due("hold", RETRY_S, now) else []
            arm = outgoing.command(self.system, outgoing.ARM_DISARM, 1.0)
            return [arm] if self.pacer.due("arm", RETRY_S, now) else []
        ready = mode in self.takeoff_modes and heard.global_ is not None
        if not ready or not self.pacer.due("take-off", TAKEOFF_RETRY_S, now):
            return []
        return [self._take_off(heard, height_m)]

    def _take_off(self, heard: Heard, height_m: float) -> Message:
        ground_m = heard.global_.position.alt_m if heard.global_ is not None else math.nan
        nan = math.nan  # yaw and place: as they are
        return outgoing.command(
            self.system, outgoing.TAKEOFF, 0, 0, 0, nan, nan, nan, ground_m + height_m
        )

    def fly(self, heard: Heard, velocity_ned_mps: Vector3, now: float) -> list[Message]:
        """A setpoint; after `STREAM_BEFORE_S` of them also OFFBOARD, until it is seen."""
        mode = self.mode(heard.custom_mode)
        if self.left(mode, self.controlled_mode):
            return []
        if mode != self.controlled_mode and mode not in self.takeoff_modes:
            return []
        messages = [outgoing.velocity(self.system, velocity_ned_mps, now)]
        if now - self._last_setpoint_s > STREAM_GAP_S:
            self._streaming_since = now
        self._last_setpoint_s = now
        streamed = now - self._streaming_since >= STREAM_BEFORE_S
        if mode != self.controlled_mode and streamed and self.pacer.due("offboard", RETRY_S, now):
            messages.append(self.set_mode(self.controlled_mode))
        return messages

    def decode_parameter(self, raw: float, kind: int) -> float:
        """Integers travel as the float of the same bits."""
        return (
            float(_INT32.unpack(_FLOAT.pack(raw))[0])
            if kind == dialect.MAV_PARAM_TYPE_INT32
            else raw
        )

    def encode_parameter(self, value: float, kind: int) -> float:
        """The inverse."""
        if kind != dialect.MAV_PARAM_TYPE_INT32:
            return value
        return float(_FLOAT.unpack(_INT32.pack(round(value)))[0])


_INT32 = struct.Struct("<i")
_FLOAT = struct.Struct("<f")
