"""PX4: flown in OFFBOARD by velocity setpoints."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import ClassVar, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.core.model.fleet import AGENT_SYSID
from swarm_ctl.core.model.vehicle import AirborneGoal, LimitKind, Vector3
from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.autopilots.base import Autopilot
from swarm_ctl.mavlink.autopilots.failsafe_parameters import ParameterRule
from swarm_ctl.mavlink.autopilots.flight_limits import LimitSource
from swarm_ctl.mavlink.autopilots.modes import PX4_MODES, ModeTable
from swarm_ctl.mavlink.autopilots.timing import (
    FIX_MAX_AGE_S,
    RETRY_S,
    STREAM_BEFORE_S,
    STREAM_GAP_S,
    STREAMS_HZ,
    TAKEOFF_LEAST_MPS,
    TAKEOFF_MPS,
)
from swarm_ctl.mavlink.outgoing import Message
from swarm_ctl.mavlink.telemetry.estimate import ESTIMATOR_RULES, EstimateRules
from swarm_ctl.mavlink.telemetry.vehicle_telemetry import Telemetry

_STILL: Final = (0.0, 0.0, 0.0)
_HOLD_MODE = "AUTO.LOITER"
_PREARM = dialect.MAV_SYS_STATUS_PREARM_CHECK
_INT32, _FLOAT = struct.Struct("<i"), struct.Struct("<f")


class Px4(Autopilot):
    """PX4 1.14 and later (PREARM_CHECK in SYS_STATUS)."""

    name: ClassVar[str] = "px4"
    wire_id: ClassVar[int] = dialect.MAV_AUTOPILOT_PX4
    modes: ClassVar[ModeTable] = PX4_MODES
    controlled_mode: ClassVar[str] = "OFFBOARD"
    climbs_by_setpoints: ClassVar[bool] = True
    landing_mode: ClassVar[str] = "AUTO.LAND"
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

    def __init__(
        self,
        system: int,
        agent_sysid: int = AGENT_SYSID,
        streams_hz: Mapping[str, float] = STREAMS_HZ,
    ) -> None:
        super().__init__(system, agent_sysid, streams_hz)
        self._streaming_since = -math.inf
        self._last_setpoint_s = -math.inf
        self._ground_down_m: float | None = None
        """Of the local frame, where the vehicle stood before it was armed."""
        self._found_mode = self.controlled_mode
        """The mode that OFFBOARD is entered from: any other is a pilot's choice."""

    def failsafes(self) -> tuple[ParameterRule, ...]:
        """By setpoints: no ground station's heartbeat keeps a silent agent's vehicle up."""
        return (
            # A silent agent's vehicle leaves OFFBOARD after this time (default 1.0 s). A shorter
            # one would react to a slow moment of the agent's computer.
            ParameterRule(
                "COM_OF_LOSS_T", AUTOPILOT_KINDS["px4"].setpoint_timeout_s, as_delivered=True
            ),
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
        self._found_mode = _HOLD_MODE if left_there else self.mode(heard)
        due = left_there and self.pacer.due("hold", RETRY_S, now)
        begin = super().stand_by(heard, now)
        return [*begin, self.set_mode(_HOLD_MODE)] if due else begin

    def yielding(self, heard: Telemetry, now: float) -> list[Message]:
        """Setpoints of zero: a PX4 refuses OFFBOARD to a pilot unless setpoints come, and ignores
        them in any other mode."""
        return [outgoing.velocity(self.system, _STILL, now)] if heard.armed else []

    def take_off(self, heard: Telemetry, goal: AirborneGoal, now: float) -> list[Message]:
        """Setpoints, OFFBOARD, arm, climb by setpoints.

        PX4's own take-off ends in AUTO.LOITER: a vehicle whose agent died in the climb would stay
        there without end. OFFBOARD ends when setpoints do.
        """
        mode, climb_mps = self.mode(heard), 0.0
        if mode == self.controlled_mode and (heard.armed or self.pacer.asked("offboard")):
            self._found_mode = mode  # not the one that an earlier flight has left
        if self.left(mode, self.controlled_mode, self._found_mode):
            return []
        if heard.armed:
            climb_mps = self._climb_mps(heard, goal.height_m, now)
        elif heard.on_ground and heard.local is not None:
            self._ground_down_m = heard.local.position_ned_m[2]
        if mode != self.controlled_mode and (heard.armed or not heard.on_ground):
            return []
        messages = self._setpoint((*goal.velocity_mps, -climb_mps), now)
        if heard.armed:
            return messages
        if mode != self.controlled_mode or not self.pacer.asked("offboard"):
            return messages + self._enter_offboard(now)
        return messages + self.arm(now)

    def _climb_mps(self, heard: Telemetry, height_m: float, now: float) -> float:
        """Towards `height_m`; 0 while the height is not known."""
        fix = heard.local
        if fix is None or now - fix.time_s > FIX_MAX_AGE_S:
            return 0.0
        if self._ground_down_m is not None:
            height = self._ground_down_m - fix.position_ned_m[2]
        elif heard.global_ is not None:  # taken over in the climb
            height = heard.global_.relative_alt_m
        else:
            return 0.0
        missing_m = height_m - height
        return min(TAKEOFF_MPS, max(TAKEOFF_LEAST_MPS, missing_m)) if missing_m > 0.0 else 0.0

    def fly(self, heard: Telemetry, velocity_ned_mps: Vector3, now: float) -> list[Message]:
        """A setpoint while in OFFBOARD, which the take-off has entered. Another mode is the choice
        of a pilot or a failsafe."""
        if self.mode(heard) != self.controlled_mode:
            return []
        return self._setpoint(velocity_ned_mps, now)

    def _setpoint(self, velocity_ned_mps: Vector3, now: float) -> list[Message]:
        if now - self._last_setpoint_s > STREAM_GAP_S:
            self._streaming_since = now
        self._last_setpoint_s = now
        return [outgoing.velocity(self.system, velocity_ned_mps, now)]

    def _enter_offboard(self, now: float) -> list[Message]:
        """Once setpoints have come for long enough."""
        streamed = now - self._streaming_since >= STREAM_BEFORE_S
        due = streamed and self.pacer.due("offboard", RETRY_S, now)
        return [self.set_mode(self.controlled_mode)] if due else []

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
