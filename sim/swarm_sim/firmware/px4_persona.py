"""The PX4 persona (autopilot 12): OFFBOARD flight, and the answers of a running PX4 1.15. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from swarm_sim.firmware.autopilot import CommandHandler, FlightMode
from swarm_sim.firmware.firmware import Firmware
from swarm_sim.firmware.flying.maneuvers import (
    STILL,
    Demand,
    FlightStyle,
    GroundManeuver,
    HoldManeuver,
    LandManeuver,
    Maneuver,
    ReturnManeuver,
    Sensed,
    TakeoffManeuver,
    VelocityManeuver,
)
from swarm_sim.firmware.flying.mission_flight import MissionManeuver
from swarm_sim.firmware.flying.position_target import (
    FRAME_BODY_NED,
    FRAME_LOCAL_NED,
    NOTHING,
    PositionTarget,
)
from swarm_sim.firmware.message import (
    MAV_MODE_FLAG_CUSTOM,
    NO_PLACE_FRAME,
    LandedState,
    MavCmd,
    MavCommand,
    MavResult,
    MavSeverity,
)
from swarm_sim.firmware.parameters import BYTEWISE, PX4_DEFAULTS, typed
from swarm_sim.firmware.protocol import px4_transfer, uploaded_mission
from swarm_sim.firmware.protocol.commands import COMMON
from swarm_sim.physics.geodesy import Vector3


def _mode(
    main: int,
    sub: int,
    name: str,
    shown: str = "",
    standard: int = 0,
    *,
    guided: bool = True,
    armable: bool,
) -> FlightMode:
    return FlightMode(
        main << 16 | sub << 24,
        name,
        armable=armable,
        guided=guided,
        standard=standard,
        shown=shown,
        advanced=main not in (2, 3),  # ALTCTL and POSCTL are for any pilot
    )


MANUAL = _mode(1, 0, "MANUAL", "Manual", guided=False, armable=False)
ALTCTL = _mode(2, 0, "ALTCTL", standard=4, guided=False, armable=False)
POSCTL = _mode(3, 0, "POSCTL", standard=1, guided=False, armable=False)
TAKEOFF = _mode(4, 2, "AUTO.TAKEOFF", standard=8, armable=True)
LOITER = _mode(4, 3, "AUTO.LOITER", "Hold", armable=True)
MISSION = _mode(4, 4, "AUTO.MISSION", standard=6, armable=True)
RTL = _mode(4, 5, "AUTO.RTL", standard=5, armable=False)
LAND = _mode(4, 6, "AUTO.LAND", standard=7, armable=False)
OFFBOARD = _mode(6, 0, "OFFBOARD", "Offboard", armable=True)
STABILIZED = _mode(7, 0, "STABILIZED", "Stabilized", guided=False, armable=False)
MODES: Mapping[int, FlightMode] = {
    mode.custom: mode
    for mode in (MANUAL, ALTCTL, POSCTL, TAKEOFF, LOITER, MISSION, RTL, LAND, OFFBOARD, STABILIZED)
}

OFFBOARD_LOSS: Mapping[int, FlightMode] = {
    0: POSCTL,
    1: POSCTL,
    2: POSCTL,
    3: RTL,
    4: LAND,
    5: LOITER,
}
"""COM_OBL_RC_ACT to mode. In a manual one, without sticks, the vehicle descends and disarms."""
DATALINK_LOSS: Mapping[int, FlightMode] = {1: LOITER, 2: RTL, 3: LAND}
"""NAV_DLL_ACT to mode; 0 is off."""
BATTERY_FAILSAFE: Mapping[int, FlightMode] = {2: LAND, 3: RTL}
"""COM_LOW_BAT_ACT to mode; 0 only warns."""
FENCE_BREACH: Mapping[int, FlightMode] = {2: LOITER, 3: RTL, 5: LAND}
"""GF_ACTION to mode; 0 and 1 only tell, 4 (the motors stop) is not simulated."""

STREAM_GAP_S, STREAM_TIME_S = 0.5, 1.0
"""OFFBOARD wants setpoints at 2 Hz or faster for over a second."""
SPOOL_UP_S, TAKEOFF_RAMP_S = 3.4, 2.5
"""From a take-off command to lift, and to the full rate of climb (COM_SPOOLUP_TIME 1 and
MPC_TKO_RAMP_T 3): seen on PX4 1.16 (SIH), like the next two."""
RAMP_LIFTS = 0.68
"""Share of MPC_TKO_RAMP_T until a take-off in OFFBOARD lifts: the ramp begins at a descent of
g / MPC_Z_VEL_P_ACC (`TakeoffHandling`)."""
LAND_DETECT_S = 7.0
"""From the touch-down until the land detector says so: the estimate still moves."""
DESCEND_MPS = 0.7
"""Descent of the failsafe that has neither setpoints nor sticks."""


_PLACED_ITEMS = frozenset((16, 17, 19, 21, 22, 31, 80, 84, 85, 195, 201, 4501, 5000))
_PLACELESS_ITEMS = frozenset(
    (
        *(20, 80, 93, 112, 114, 177, 178, 179, 187, 189, 196, 197, 200, 201, *range(203, 207), 211),
        *(214, 260, 530, 532, 534, 1000, 1001, 2000, 2001, 2003, 2500, 2501, 3000, 42600),
    )
)
"""MAV_CMDs that an uploaded mission may have, with a place and without: all that PX4 1.16-dev took,
one by one."""


class Px4Persona(Firmware):
    """PX4 multicopter."""

    autopilot = 12
    version = 1 << 24 | 15 << 16
    capabilities = 0x2 | 0x4 | 0x8 | 0x10 | 0x40 | 0x80 | 0x100 | 0x2000 | 0x4000 | 0x8000
    defaults = PX4_DEFAULTS
    encoding = BYTEWISE
    sysid_parameter = "MAV_SYS_ID"
    capacity_parameter = "BAT1_CAPACITY"
    modes = MODES
    pilot_modes: ClassVar[Mapping[str, FlightMode]] = {
        "hold": LOITER,
        "land": LAND,
        "return": RTL,
        "manual": POSCTL,
    }
    boot_mode = LOITER
    boot_streams: ClassVar[Mapping[str, float]] = {
        "HEARTBEAT": 1.0,
        "SYS_STATUS": 0.5,
        "SYSTEM_TIME": 1.0,
        "ATTITUDE": 0.02,
        "LOCAL_POSITION_NED": 1.0 / 30.0,
        "GLOBAL_POSITION_INT": 0.1,
        "GPS_RAW_INT": 0.2,
        "VFR_HUD": 0.1,
        "POSITION_TARGET_LOCAL_NED": 0.1,
        "BATTERY_STATUS": 2.0,
        "EXTENDED_SYS_STATE": 1.0,
        "ESTIMATOR_STATUS": 1.0,
        "HOME_POSITION": 2.0,
        "MISSION_CURRENT": 1.0,
        "GPS_GLOBAL_ORIGIN": 2.0,
        "ADSB_VEHICLE": 0.2,
        "WIND_COV": 2.0,
    }
    fence_bit = 0
    force_arm_magic = 21196.0
    arm_nonsense = None
    refusal = MavResult.TEMPORARILY_REJECTED
    disarmed_text = "Disarmed by external command"
    disarm_denied_text = "Disarming denied: not landed"
    mission_services = px4_transfer.HANDLERS
    promised_messages = frozenset((300,))  # PROTOCOL_VERSION
    unknown_message = MavResult.DENIED
    unknown_interval = MavResult.FAILED
    zero_is_here = False
    bad_number = MavResult.ACCEPTED
    merely_answered: ClassVar[Mapping[int, MavResult | None]] = {
        MavCmd.DO_FLIGHTTERMINATION: MavResult.DENIED,
        MavCmd.DO_SET_ROI_LOCATION: MavResult.ACCEPTED,
        MavCmd.DO_SET_ROI_NONE: MavResult.ACCEPTED,
        MavCmd.DO_MOUNT_CONTROL: None,
        MavCmd.DO_GRIPPER: None,
        MavCmd.DO_LAND_START: MavResult.CANCELLED,
        MavCmd.RUN_PREARM_CHECKS: MavResult.ACCEPTED,
        MavCmd.REQUEST_PROTOCOL_VERSION: MavResult.ACCEPTED,
        MavCmd.REQUEST_CAMERA_INFORMATION: None,
        MavCmd.DO_GIMBAL_MANAGER_PITCHYAW: None,
    }
    first_index = 0
    land_detect_s = LAND_DETECT_S
    own_faults = typed({"SIM_GPS_DRIFT": 0.1, "SIM_VEL_NOISE": 0.25})

    def start(self, sensed: Sensed, boot_s: float) -> None:
        super().start(sensed, boot_s)
        self._target: PositionTarget | None = None
        self._target_s = self._stream_since_s = -math.inf
        self._takeoff_down_m: float | None = None
        self._flown = False
        self._ramp_s: float | None = None
        """Since when a take-off in OFFBOARD ramps up its climb."""
        self._after_flight = LOITER

    def style_by_parameters(self) -> FlightStyle:
        p = self.parameters
        return FlightStyle(
            speed_mps=p["MPC_XY_CRUISE"],
            climb_mps=p["MPC_Z_V_AUTO_UP"],
            descent_mps=p["MPC_Z_V_AUTO_DN"],
            land_mps=p["MPC_LAND_SPEED"],
            land_below_m=p["MPC_LAND_ALT2"],
            land_from_m=p["MPC_LAND_ALT1"],
            spool_up_s=SPOOL_UP_S,
            takeoff_ramp_s=TAKEOFF_RAMP_S,
            takeoff_mps=p["MPC_TKO_SPEED"],
            return_height_m=p["RTL_RETURN_ALT"],
            return_wait_s=max(0.0, p["RTL_LAND_DELAY"]),
            waypoint_radius_m=p["NAV_ACC_RAD"],
            captures=True,
        )

    def battery_low(self) -> bool:
        """By BAT_CRIT_THR."""
        return self.battery.percent() < 100.0 * self.parameters["BAT_CRIT_THR"]

    def on_battery_low(self) -> None:
        """By COM_LOW_BAT_ACT."""
        self.text(MavSeverity.CRITICAL, "Critical battery level")
        action = BATTERY_FAILSAFE.get(round(self.parameters["COM_LOW_BAT_ACT"]))
        if action is not None and self.armed and not self.sensed.landed and self.mode is not LAND:
            self._fail(action)

    def landed_state(self) -> LandedState:
        """In the air as soon as its own take-off begins."""
        starts = self.armed and isinstance(self.maneuver, TakeoffManeuver)
        return LandedState.TAKEOFF if starts else super().landed_state()

    def addressed(self, command: MavCommand) -> bool:
        """Exactly this system, and its autopilot or all its components."""
        return command.target[0] == self.sysid and command.target[1] in (0, 1)

    # --- arming ---

    def armable(self) -> bool:
        """In its mode: disarmed in OFFBOARD without setpoints the checks fail."""
        allowed = self.mode.armable and self._mode_possible(self.mode)
        return super().armable() and (self.armed or allowed)

    def arm(self, *, force: bool) -> MavResult:
        if not (force or self.armable()):
            self.text(MavSeverity.CRITICAL, "Arming denied: Resolve system health failures first")
            return MavResult.TEMPORARILY_REJECTED
        self.set_armed()
        self._flown, self._ramp_s = False, None
        self.text(MavSeverity.INFO, "Armed by external command")
        self._change(self.mode)
        return MavResult.ACCEPTED

    def set_disarmed(self, text: str) -> None:
        """A mode that has ended with the flight gives way to the last one that was asked for and
        allows arming: OFFBOARD, too (`UserModeIntention::onDisarm`)."""
        failsafe = self.failsafe
        super().set_disarmed(text)
        if failsafe or self.mode in (TAKEOFF, LAND, RTL, MISSION):
            self.mode = self._after_flight

    # --- modes ---

    def _do_set_mode(self, command: MavCommand) -> MavResult:
        if not all(math.isfinite(p) for p in command.p[:3]):
            return MavResult.DENIED
        base, main, sub = (int(p) for p in command.p[:3])
        is_byte = 0 <= main <= 0xFF and 0 <= sub <= 0xFF
        return self.set_mode(base, main << 16 | sub << 24 if is_byte else 0)

    def set_mode(self, base_mode: int, custom_mode: int) -> MavResult:
        """A mode that does not exist is accepted and changes nothing, as PX4 does."""
        custom = custom_mode & 0xFFFF0000  # PX4's mode and sub-mode
        mode = MODES.get(custom) if base_mode & MAV_MODE_FLAG_CUSTOM else None
        return MavResult.ACCEPTED if mode is None else self.enter(mode)

    def _mode_possible(self, mode: FlightMode) -> bool:
        if mode is OFFBOARD:
            return self._streaming()
        return uploaded_mission.present(self) if mode is MISSION else mode.guided

    def enter(self, mode: FlightMode) -> MavResult:
        checked = mode is MISSION or self.armed
        if not self.ready() or (checked and not self._mode_possible(mode)):
            return MavResult.TEMPORARILY_REJECTED
        self.failsafe = False
        if mode in (LOITER, OFFBOARD):
            self._after_flight = mode
        if mode is not self.mode or mode is TAKEOFF:
            self._change(mode)
        return MavResult.ACCEPTED

    def _change(self, mode: FlightMode) -> None:
        self.mode = mode
        if mode is OFFBOARD and self._target is not None:
            self._follow(self._target)
        else:
            self.begin(self._maneuver(mode))

    def _maneuver(self, mode: FlightMode) -> Maneuver:
        heading, landed = self.sensed.heading_rad, self.sensed.landed
        if mode is TAKEOFF and (landed or isinstance(self.maneuver, TakeoffManeuver)):
            down = self._takeoff_down_m
            if down is None:
                down = self.sensed.position_ned_m[2] - self.parameters["MIS_TAKEOFF_ALT"]
            return self.take_off(down)
        if mode is LAND:
            return LandManeuver(heading, self.home_ned[2])
        if mode is MISSION and self.armed:
            return uploaded_mission.fly(self)
        if landed:
            return GroundManeuver()
        return self.return_home() if mode is RTL else HoldManeuver(heading)

    # --- missions ---

    def known_item(self, command: int, frame: int) -> bool:
        return command in (_PLACELESS_ITEMS if frame == NO_PLACE_FRAME else _PLACED_ITEMS)

    def keep_transfer_going(self) -> None:
        px4_transfer.keep_going(self)

    def mission_lost(self) -> None:
        self._change(LOITER)

    def _mission_start(self, _: MavCommand) -> MavResult:
        if not uploaded_mission.present(self):
            return MavResult.DENIED
        result = self.enter(MISSION)
        if result is not MavResult.ACCEPTED or self.armed:
            return result
        return self.arm(force=False)

    # --- offboard ---

    def on_position_target(self, target: PositionTarget) -> None:
        """A sign of life in every mode, flown in OFFBOARD. Axes are ignored one by one."""
        usable = target.position != NOTHING or target.velocity != NOTHING
        if target.frame not in (FRAME_LOCAL_NED, FRAME_BODY_NED) or not usable:
            self.ignored += 1
            return
        if self.now - self._target_s > STREAM_GAP_S:
            self._stream_since_s = self.now
        self._target, self._target_s = target, self.now
        if self.mode is OFFBOARD and self.armed:
            self._follow(target)

    def _follow(self, target: PositionTarget) -> None:
        """No faster than MPC_XY_VEL_MAX, MPC_Z_VEL_MAX_UP and _DN."""
        north, east, down = target.velocity
        speed = math.hypot(north or 0.0, east or 0.0)
        share = min(1.0, max(0.0, self.parameters["MPC_XY_VEL_MAX"]) / max(speed, 1e-9))
        if down is not None:
            up, sink = self.parameters["MPC_Z_VEL_MAX_UP"], self.parameters["MPC_Z_VEL_MAX_DN"]
            down = max(-up, min(sink, down))
        slowed = (north and share * north, east and share * east, down)
        self.follow(target, target.position, slowed)

    def limited(self, demand: Demand) -> Demand:
        """A take-off in OFFBOARD ramps up its climb."""
        if not self.armed or self.mode is not OFFBOARD:
            return demand
        share = self._climb_share(demand)
        north, east, down = demand.velocity_ned_mps
        slowed = (north, east, down if down > 0.0 else share * down)
        return demand._replace(velocity_ned_mps=slowed, climb_mps=share * demand.climb_mps)

    def _climb_share(self, demand: Demand) -> float:
        """Once motors have spooled up since arming, the first climb on the ground begins the ramp.
        OFFBOARD entered in the air has none."""
        if self.sensed.landed:
            down, here = demand.position_ned_m[2], self.sensed.position_ned_m[2]
            climbs = demand.velocity_ned_mps[2] < 0.0 or (down is not None and down < here)
            spooled = self.now - self.armed_s >= self.parameters["COM_SPOOLUP_TIME"]
            if not (climbs and spooled):
                self._ramp_s = None
                return 0.0
            if self._ramp_s is None:
                self._ramp_s = self.now
        if self._ramp_s is None:
            return 1.0
        progress = (self.now - self._ramp_s) / max(self.parameters["MPC_TKO_RAMP_T"], 1e-3)
        return min(1.0, max(0.0, (progress - RAMP_LIFTS) / (1.0 - RAMP_LIFTS)))

    def _streaming(self) -> bool:
        fresh = self.now - self._target_s <= STREAM_GAP_S
        return fresh and self.now - self._stream_since_s > STREAM_TIME_S

    # --- commands ---

    def _takeoff(self, command: MavCommand) -> MavResult:
        if not self.ready():
            return MavResult.TEMPORARILY_REJECTED
        self._takeoff_down_m = None
        above = command.p[6] - self.geodetic().alt_m
        if math.isfinite(above) and above > 0:
            self._takeoff_down_m = self.sensed.position_ned_m[2] - above
        self._change(TAKEOFF)
        return MavResult.ACCEPTED

    def go_to(self, place_ned: Vector3) -> MavResult:
        self.mode = LOITER
        self.begin(VelocityManeuver(STILL, self.sensed.heading_rad, place_ned))
        return MavResult.ACCEPTED

    # --- time ---

    def housekeeping(self) -> None:
        landed = self.sensed.landed
        self._flown = self._flown or not landed
        self._check_offboard()
        self._check_datalink()
        self._check_fence()
        if not (self.ready() or landed or self.mode in (POSCTL, LAND)):
            self._fail(POSCTL)  # no position: descends
        mission = self.maneuver
        if isinstance(mission, MissionManeuver) and mission.finished and not mission.done:
            uploaded_mission.keep_up(self)
            self.mode = LOITER
            heading, position = self.demand.heading_rad, self.demand.position_ned_m
            self.begin(VelocityManeuver(STILL, heading, position))
        if self.mode is TAKEOFF and self.maneuver.done and not landed:
            self.mode = LOITER  # where the take-off led, not where it happens to be
        if landed:
            self._check_landed()

    def _check_offboard(self) -> None:
        silent = self.now - self._target_s > self.parameters["COM_OF_LOSS_T"]
        if self.mode is OFFBOARD and silent:
            self._fail(OFFBOARD_LOSS.get(round(self.parameters["COM_OBL_RC_ACT"]), POSCTL))

    def _check_datalink(self) -> None:
        action = DATALINK_LOSS.get(round(self.parameters["NAV_DLL_ACT"]))
        heard = self.gcs_heartbeat_s
        if action is None or heard is None or self.failsafe or self.mode in (action, LAND):
            return
        if self.now - heard > self.parameters["COM_DL_LOSS_T"]:
            self._fail(action)

    def _check_fence(self) -> None:
        """The areas that it was sent, by GF_ACTION."""
        if not self.fence_breached():
            return
        self.text(MavSeverity.WARNING, "Geofence violation")
        action = FENCE_BREACH.get(round(self.parameters["GF_ACTION"]))
        if action is not None and self.mode not in (action, LAND):
            self._fail(action)

    def _fail(self, mode: FlightMode) -> None:
        self.failsafe = True
        self.text(MavSeverity.CRITICAL, "Failsafe activated")
        if mode.guided:
            self._change(mode)
        else:
            self.mode = mode
            self.begin(LandManeuver(self.sensed.heading_rad, self.home_ned[2], DESCEND_MPS))

    def _check_landed(self) -> None:
        if isinstance(self.maneuver, LandManeuver | ReturnManeuver | MissionManeuver):
            delay = self.parameters["COM_DISARM_LAND"]
            down_s = self.standing_s() - LAND_DETECT_S
            if self.maneuver.done and 0 <= delay <= down_s:
                self.set_disarmed("Disarmed by landing")
            return
        if isinstance(self.maneuver, HoldManeuver):
            self.begin(GroundManeuver())
        delay = self.parameters["COM_DISARM_PRFLT"]
        if not self._flown and delay > 0 and self.now - self.armed_s >= delay:
            self.set_disarmed("Disarmed by auto preflight disarming")

    commands: ClassVar[Mapping[int, CommandHandler]] = COMMON | {
        MavCmd.DO_SET_MODE: _do_set_mode,
        MavCmd.MISSION_START: _mission_start,
        MavCmd.PREFLIGHT_STORAGE: lambda f, _: (
            MavResult.TEMPORARILY_REJECTED if f.armed else MavResult.ACCEPTED
        ),
        MavCmd.NAV_TAKEOFF: _takeoff,
        MavCmd.NAV_LAND: lambda f, _: f.enter(LAND),
        MavCmd.NAV_RETURN_TO_LAUNCH: lambda f, _: f.enter(RTL),
    }
