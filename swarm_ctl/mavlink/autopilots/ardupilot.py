"""ArduCopter: flown in GUIDED by velocity setpoints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.timeouts import SETPOINT_TIMEOUT_S
from swarm_ctl.core.model.vehicle import Vector3
from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.autopilots.base import Autopilot
from swarm_ctl.mavlink.autopilots.timing import RETRY_S, TAKEOFF_RETRY_S
from swarm_ctl.mavlink.incoming import Heard
from swarm_ctl.mavlink.outgoing import Message

MODES = {
    0: "STABILIZE",
    1: "ACRO",
    2: "ALT_HOLD",
    3: "AUTO",
    4: "GUIDED",
    5: "LOITER",
    6: "RTL",
    7: "CIRCLE",
    9: "LAND",
    11: "DRIFT",
    13: "SPORT",
    15: "AUTOTUNE",
    16: "POSHOLD",
    17: "BRAKE",
    18: "THROW",
    19: "AVOID_ADSB",
    20: "GUIDED_NOGPS",
    21: "SMART_RTL",
    22: "FLOWHOLD",
    23: "FOLLOW",
    24: "ZIGZAG",
    27: "AUTO_RTL",
}
"""ArduCopter's custom_mode (Mode::Number)."""
_NUMBERS = {name: number for number, name in MODES.items()}
_PREARM = dialect.MAV_SYS_STATUS_PREARM_CHECK


class Ardupilot(Autopilot):
    """ArduCopter 4.1 and later (GUID_TIMEOUT)."""

    name: ClassVar[str] = "ardupilot"
    wire_id: ClassVar[int] = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
    controlled_mode: ClassVar[str] = "GUIDED"
    landing_mode: ClassVar[str] = "LAND"
    wind_message: ClassVar[str] = "WIND"  # with EK3_DRAG_BCOEF_X and _Y tuned
    failsafes: ClassVar[Mapping[str, float]] = {
        # A silent agent's vehicle stops after this, not after the 3 s it comes with (11.7 m at 3
        # m/s). At 20 setpoints a second it is 10 lost in a row; the parameter's range is 0.1 .. 5
        # s.
        "GUID_TIMEOUT": SETPOINT_TIMEOUT_S["ardupilot"],
        # Our heartbeats gone for FS_GCS_TIMEOUT (5 s): land in place. Return-to-launch would cross
        # others' paths.
        "FS_GCS_ENABLE": 5.0,
    }

    def mode(self, custom_mode: int | None) -> str:
        """`GUIDED`, ...; `MODE 99` for a number nobody here knows."""
        return "" if custom_mode is None else MODES.get(custom_mode) or f"MODE {custom_mode}"

    def set_mode(self, mode: str) -> Message:
        """DO_SET_MODE with the custom mode in parameter 2."""
        return outgoing.command(
            self.system, outgoing.SET_MODE, outgoing.CUSTOM_MODE, _NUMBERS[mode]
        )

    def prearm(self, heard: Heard) -> bool:
        """PREARM_CHECK present, enabled (it is not where the checks were switched off) and
        healthy."""
        return bool(heard.sensors_present & heard.sensors_enabled & heard.sensors_health & _PREARM)

    def climb(self, heard: Heard, height_m: float, now: float) -> list[Message]:
        """GUIDED, arm, NAV_TAKEOFF (height above home): each once the one before is seen to be
        so."""
        mode = self.mode(heard.custom_mode)
        if self.left(mode, self.controlled_mode):
            return []
        if mode != self.controlled_mode:
            # Only on the ground: in the air another mode is somebody's choice.
            enter = not heard.armed and heard.on_ground and self.pacer.due("guided", RETRY_S, now)
            return [self.set_mode(self.controlled_mode)] if enter else []
        if not heard.on_ground:
            return []
        if not heard.armed:
            arm = outgoing.command(self.system, outgoing.ARM_DISARM, 1.0)
            return [arm] if self.pacer.due("arm", RETRY_S, now) else []
        take_off = outgoing.command(self.system, outgoing.TAKEOFF, 0, 0, 0, 0, 0, 0, height_m)
        return [take_off] if self.pacer.due("take-off", TAKEOFF_RETRY_S, now) else []

    def fly(self, heard: Heard, velocity_ned_mps: Vector3, now: float) -> list[Message]:
        """A setpoint while in GUIDED: take-off has brought it there, and another mode is a pilot's
        or a failsafe's."""
        if self.mode(heard.custom_mode) != self.controlled_mode:
            return []
        return [outgoing.velocity(self.system, velocity_ned_mps, now)]

    def decode_parameter(self, raw: float, kind: int) -> float:  # noqa: ARG002
        """Parameters of every type travel as the float of the same value."""
        return raw

    def encode_parameter(self, value: float, kind: int) -> float:  # noqa: ARG002
        """The inverse."""
        return value
