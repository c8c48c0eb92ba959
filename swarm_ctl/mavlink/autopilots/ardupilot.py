"""ArduCopter: flown in GUIDED by velocity setpoints."""

from __future__ import annotations

from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.core.model.vehicle import AirborneGoal, LimitKind, Vector3
from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.autopilots.base import Autopilot
from swarm_ctl.mavlink.autopilots.failsafe_parameters import ParameterRule
from swarm_ctl.mavlink.autopilots.flight_limits import LimitSource
from swarm_ctl.mavlink.autopilots.modes import COPTER_MODES, ModeTable
from swarm_ctl.mavlink.autopilots.timing import GCS_TIMEOUT_S, RETRY_S
from swarm_ctl.mavlink.outgoing import Message
from swarm_ctl.mavlink.telemetry.estimate import EKF_RULES, EstimateRules
from swarm_ctl.mavlink.telemetry.vehicle_telemetry import Telemetry

_PREARM = dialect.MAV_SYS_STATUS_PREARM_CHECK


class Ardupilot(Autopilot):
    """ArduCopter 4.1 and later (GUID_TIMEOUT)."""

    name: ClassVar[str] = "ardupilot"
    wire_id: ClassVar[int] = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
    modes: ClassVar[ModeTable] = COPTER_MODES
    controlled_mode: ClassVar[str] = "GUIDED"
    climbs_by_setpoints: ClassVar[bool] = False
    landing_mode: ClassVar[str] = "LAND"
    wind_message: ClassVar[str] = "WIND"
    wind_switch: ClassVar[str] = "EK3_DRAG_BCOEF_X"
    estimate_rules: ClassVar[EstimateRules] = EKF_RULES
    # The names of 4.7, then those before. GUIDED does not hold to the speeds: they are the owner's
    # word on how fast the vehicle may fly.
    limit_sources: ClassVar[tuple[LimitSource, ...]] = (
        LimitSource(LimitKind.SPEED, {"WP_SPD": 1.0, "WPNAV_SPEED": 0.01}),
        LimitSource(LimitKind.CLIMB, {"WP_SPD_UP": 1.0, "WPNAV_SPEED_UP": 0.01}),
        LimitSource(LimitKind.DESCENT, {"WP_SPD_DN": 1.0, "WPNAV_SPEED_DN": 0.01}),
        # The position controller adds to it: 3.0 m/s2 was measured with 2.5, 1.15 with 1.
        LimitSource(LimitKind.ACCELERATION, {"WP_ACC": 1.2, "WPNAV_ACCEL": 0.012}),
        LimitSource(LimitKind.ACCELERATION, {"ATC_ANGLE_MAX": 1.0, "ANGLE_MAX": 0.01}, lean=True),
        LimitSource(LimitKind.ACCELERATION, {"PSC_ANGLE_MAX": 1.0}, lean=True, optional=True),
    )

    def failsafes(self) -> tuple[ParameterRule, ...]:
        """By our heartbeats: GUIDED stays what it is when setpoints end.

        No bit of FS_OPTIONS keeps a vehicle in GUIDED or stops a landing when our heartbeats end:
        1 is for AUTO, 3 goes on landing, 4 is for modes of a pilot, 0 and 2 are for lost RC.
        """
        return (
            # A silent agent's vehicle stops after this time. The default, 3 s, is 11.7 m at 3 m/s.
            # At 20 setpoints a second it is 10 lost in a row; the parameter's range is 0.1 .. 5 s.
            ParameterRule("GUID_TIMEOUT", AUTOPILOT_KINDS["ardupilot"].setpoint_timeout_s),
            # The id whose heartbeats count: 4.7 and later, and before. As delivered it is 255, that
            # of most ground stations: one of them would keep a dead agent's vehicle in the air.
            ParameterRule("MAV_GCS_SYSID", self.agent_sysid, optional=True, group="GCS"),
            ParameterRule("SYSID_MYGCS", self.agent_sysid, optional=True, group="GCS"),
            # The end of a range of such ids, where it is above the first one.
            ParameterRule("MAV_GCS_SYSID_HI", 0.0, at_most=True, optional=True),
            # Without our heartbeats for this time the vehicle lands in place. Before 4.2 it is a
            # constant, 5 s.
            ParameterRule("FS_GCS_TIMEOUT", GCS_TIMEOUT_S, at_most=True, optional=True),
            # Return-to-launch would cross the paths of other vehicles.
            ParameterRule("FS_GCS_ENABLE", 5.0),
        )

    def prearm(self, heard: Telemetry) -> bool:
        """PREARM_CHECK present, enabled (it is not where the checks are off) and healthy."""
        return bool(heard.sensors_present & heard.sensors_enabled & heard.sensors_health & _PREARM)

    def take_off(self, heard: Telemetry, goal: AirborneGoal, now: float) -> list[Message]:
        """GUIDED, arm, NAV_TAKEOFF (height above home): each after the one before has worked."""
        mode = self.mode(heard)
        if self.left(mode, self.controlled_mode):
            return []
        if mode != self.controlled_mode:
            # Only on the ground: in the air another mode is a pilot's or a failsafe's choice.
            enter = not heard.armed and heard.on_ground and self.pacer.due("guided", RETRY_S, now)
            return [self.set_mode(self.controlled_mode)] if enter else []
        if not heard.on_ground:
            return []
        if not heard.armed:
            return self.arm(now)
        command = outgoing.command(self.system, outgoing.TAKEOFF, 0, 0, 0, 0, 0, 0, goal.height_m)
        return [command] if self.take_off_due(heard, now) else []

    def fly(self, heard: Telemetry, velocity_ned_mps: Vector3, now: float) -> list[Message]:
        """A setpoint while in GUIDED, which the take-off has entered. Another mode is the choice of
        a pilot or a failsafe."""
        if self.mode(heard) != self.controlled_mode:
            return []
        return [outgoing.velocity(self.system, velocity_ned_mps, now)]
