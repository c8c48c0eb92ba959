"""PX4: flown in OFFBOARD by velocity setpoints."""

from __future__ import annotations

import math
import struct
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.fleet import AGENT_SYSID
from swarm_ctl.core.model.timeouts import SETPOINT_TIMEOUT_S
from swarm_ctl.core.model.vehicle import LimitKind, Vector3
from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.autopilots.base import Autopilot
from swarm_ctl.mavlink.autopilots.flight_limits import LimitSource
from swarm_ctl.mavlink.autopilots.modes import PX4_MODES, ModeTable
from swarm_ctl.mavlink.autopilots.parameter_rules import ParameterRule
from swarm_ctl.mavlink.autopilots.timing import RETRY_S, STREAM_BEFORE_S, STREAM_GAP_S
from swarm_ctl.mavlink.estimate import ESTIMATOR_RULES, EstimateRules
from swarm_ctl.mavlink.outgoing import Message
from swarm_ctl.mavlink.vehicle_telemetry import Telemetry

_HOLD_MODE = "AUTO.LOITER"
_PREARM = dialect.MAV_SYS_STATUS_PREARM_CHECK
_INT32, _FLOAT = struct.Struct("<i"), struct.Struct("<f")


class Px4(Autopilot):
    """PX4 1.14 and later (PREARM_CHECK in SYS_STATUS)."""

    name: ClassVar[str] = "px4"
    wire_id: ClassVar[int] = dialect.MAV_AUTOPILOT_PX4
    modes: ClassVar[ModeTable] = PX4_MODES
    controlled_mode: ClassVar[str] = "OFFBOARD"
    landing_mode: ClassVar[str] = "AUTO.LAND"
    takeoff_modes: ClassVar[tuple[str, ...]] = ("AUTO.TAKEOFF", _HOLD_MODE)
    """OFFBOARD is entered from these modes alone."""
    wind_message: ClassVar[str] = "WIND_COV"
    wind_switch: ClassVar[str] = "EKF2_DRAG_CTRL"
    estimate_rules: ClassVar[EstimateRules] = ESTIMATOR_RULES
    # MPC_ACC_HOR and MPC_JERK_* do not act in OFFBOARD: 6.3 m/s2 was measured with 2 m/s2.
    limit_sources: ClassVar[tuple[LimitSource, ...]] = (
        LimitSource(LimitKind.SPEED, {"MPC_XY_VEL_MAX": 1.0}),
        LimitSource(LimitKind.CLIMB, {"MPC_Z_VEL_MAX_UP": 1.0}),
        LimitSource(LimitKind.DESCENT, {"MPC_Z_VEL_MAX_DN": 1.0}),
        LimitSource(LimitKind.ACCELERATION, {"MPC_TILTMAX_AIR": 1.0}, lean=True),
    )

    def __init__(self, system: int, agent_sysid: int = AGENT_SYSID) -> None:
        super().__init__(system, agent_sysid)
        self._streaming_since = -math.inf
        self._last_setpoint_s = -math.inf

    def failsafes(self) -> tuple[ParameterRule, ...]:
        """By setpoints: no ground station's heartbeat keeps a silent agent's vehicle up."""
        return (
            # A silent agent's vehicle leaves OFFBOARD after this time (default 1.0 s). A shorter
            # one would react to a slow moment of the agent's computer.
            ParameterRule("COM_OF_LOSS_T", SETPOINT_TIMEOUT_S["px4"], as_delivered=True),
            # ... and lands (4) in place. The default, position mode (0), needs a pilot.
            ParameterRule("COM_OBL_RC_ACT", 4.0),
        )

    def prearm(self, heard: Telemetry) -> bool:
        """PREARM_CHECK healthy. PX4 never sets present and enabled (SYS_STATUS.hpp)."""
        return bool(heard.sensors_health & _PREARM)

    def stand_by(self, heard: Telemetry, now: float) -> list[Message]:
        """AUTO.LOITER in place of OFFBOARD. A PX4 goes back to OFFBOARD when it disarms after a
        landing, and fails its pre-arm checks there, because no setpoints come."""
        left_there = not heard.armed and self.mode(heard) == self.controlled_mode
        due = left_there and self.pacer.due("hold", RETRY_S, now)
        begin = super().stand_by(heard, now)
        return [*begin, self.set_mode(_HOLD_MODE)] if due else begin

    def take_off(self, heard: Telemetry, height_m: float, now: float) -> list[Message]:
        """AUTO.LOITER, arm, NAV_TAKEOFF (height above sea level): each after the one before has
        worked."""
        mode = self.mode(heard)
        if self.left(mode, *self.takeoff_modes) or not heard.on_ground:
            return []
        if mode not in self.takeoff_modes:
            enter = not heard.armed and self.pacer.due("hold", RETRY_S, now)
            return [self.set_mode(_HOLD_MODE)] if enter else []
        if not heard.armed:
            return self.arm(now)
        if heard.global_ is None or not self.take_off_due(heard, now):
            return []
        altitude_m = heard.global_.position.alt_m + height_m
        as_it_is = (math.nan,) * 3  # yaw, latitude, longitude
        command = (self.system, outgoing.TAKEOFF, 0, 0, 0, *as_it_is, altitude_m)
        return [outgoing.command(*command)]

    def fly(self, heard: Telemetry, velocity_ned_mps: Vector3, now: float) -> list[Message]:
        """A setpoint; after `STREAM_BEFORE_S` of them OFFBOARD, too, until HEARTBEAT shows it."""
        mode = self.mode(heard)
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
        """An integer travels in the bits of a float."""
        if kind != dialect.MAV_PARAM_TYPE_INT32:
            return raw
        return float(_INT32.unpack(_FLOAT.pack(raw))[0])

    def encode_parameter(self, value: float, kind: int) -> float:
        """The inverse."""
        if kind != dialect.MAV_PARAM_TYPE_INT32:
            return value
        return float(_FLOAT.unpack(_INT32.pack(round(value)))[0])
