"""The PX4 persona (autopilot 12): OFFBOARD flight, with the answers a running PX4 1.15 gives.
Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.firmware.base import Firmware, Setup
from sim.firmware.fault_parameters import SIM_DEFAULTS
from sim.firmware.flying.maneuvers import (
    Ground,
    Hold,
    Land,
    Maneuver,
    Return,
    Style,
    Takeoff,
    Velocity,
)
from sim.firmware.flying.mission_flight import Auto, Course
from sim.firmware.flying.setpoint import FRAME_BODY_NED, FRAME_LOCAL_NED, NOTHING, Setpoint, moved
from sim.firmware.message import (
    MAV_MODE_FLAG_CUSTOM,
    MAV_MODE_FLAG_GUIDED,
    MAV_MODE_FLAG_STABILIZE,
    Cmd,
    Result,
    Severity,
)
from sim.firmware.protocol import missions
from sim.firmware.protocol.commands import COMMON, Command, Handler
from sim.firmware.protocol.mission_lists import Item
from sim.firmware.protocol.parameters import BYTEWISE, PX4_DEFAULTS, Parameters
from sim.physics.geodesy import Vector3


@dataclass(frozen=True, slots=True)
class Mode:
    """A row of the mode table."""

    main: int
    sub: int
    name: str
    armable: bool
    manual: bool = False
    """Needs a pilot's sticks; there are none here, so it can't be chosen while armed."""

    @property
    def custom(self) -> int:
        """HEARTBEAT.custom_mode."""
        return self.main << 16 | self.sub << 24


MODES: Mapping[tuple[int, int], Mode] = {
    (mode.main, mode.sub): mode
    for mode in (
        Mode(1, 0, "MANUAL", armable=False, manual=True),
        Mode(2, 0, "ALTCTL", armable=False, manual=True),
        Mode(3, 0, "POSCTL", armable=False, manual=True),
        Mode(4, 2, "AUTO.TAKEOFF", armable=True),
        Mode(4, 3, "AUTO.LOITER", armable=True),
        Mode(4, 4, "AUTO.MISSION", armable=True),
        Mode(4, 5, "AUTO.RTL", armable=False),
        Mode(4, 6, "AUTO.LAND", armable=False),
        Mode(6, 0, "OFFBOARD", armable=True),
        Mode(7, 0, "STABILIZED", armable=False, manual=True),
    )
}
POSCTL, TAKEOFF, LOITER, MISSION, RTL, LAND, OFFBOARD = (
    MODES[n] for n in ((3, 0), (4, 2), (4, 3), (4, 4), (4, 5), (4, 6), (6, 0))
)

OFFBOARD_LOSS: Mapping[int, Mode] = {0: POSCTL, 1: POSCTL, 2: POSCTL, 3: RTL, 4: LAND, 5: LOITER}
"""COM_OBL_RC_ACT to mode. The manual ones have no sticks here: the vehicle descends, lands and
disarms in them."""
DATALINK_LOSS: Mapping[int, Mode] = {1: LOITER, 2: RTL, 3: LAND}
"""NAV_DLL_ACT to mode; 0 is off."""

BATTERY_FAILSAFE: Mapping[int, Mode] = {2: LAND, 3: RTL}
"""COM_LOW_BAT_ACT to mode; 0 only warns."""

STREAM_GAP_S, STREAM_TIME_S = 0.5, 1.0
"""OFFBOARD wants setpoints at 2 Hz or faster for over a second."""
DESCEND_MPS = 0.7
"""Descent of the failsafe that has neither setpoints nor sticks."""


class Px4(Firmware):
    """PX4 multicopter."""

    autopilot: ClassVar[int] = 12
    version: ClassVar[int] = 1 << 24 | 15 << 16
    capabilities: ClassVar[int] = (
        0x2 | 0x4 | 0x8 | 0x10 | 0x40 | 0x80 | 0x100 | 0x2000 | 0x4000 | 0x8000
    )
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
    force_arm_magic: ClassVar[float] = 21196.0
    arm_nonsense: ClassVar[Result | None] = None
    refusal: ClassVar[Result] = Result.TEMPORARILY_REJECTED
    asks_in_kind: ClassVar[bool] = True
    first_index: ClassVar[int] = 0

    mode: Mode

    def __init__(self, setup: Setup, boot_s: float) -> None:
        parameters = Parameters(PX4_DEFAULTS | SIM_DEFAULTS, BYTEWISE)
        parameters.set("MAV_SYS_ID", setup.sysid)
        super().__init__(setup, parameters, boot_s)

    def booted(self) -> None:
        """See `Firmware`."""
        self.mode = LOITER
        self._setpoint: Setpoint | None = None
        self._setpoint_s = -math.inf
        self._stream_since_s = -math.inf
        self._takeoff_down_m: float | None = None
        self._flown = False

    def custom_mode(self) -> int:
        """See `Firmware`."""
        return self.mode.custom

    def mode_flags(self) -> int:
        """See `Firmware`."""
        return MAV_MODE_FLAG_STABILIZE | (0 if self.mode.manual else MAV_MODE_FLAG_GUIDED)

    def style(self) -> Style:
        """See `Firmware`."""
        p = self.parameters
        return Style(
            speed_mps=p["MPC_XY_CRUISE"] if self.speed_mps is None else self.speed_mps,
            climb_mps=p["MPC_Z_V_AUTO_UP"],
            descent_mps=p["MPC_Z_V_AUTO_DN"],
            land_mps=p["MPC_LAND_SPEED"],
            land_below_m=p["MPC_LAND_ALT2"],
            captures=True,
        )

    def battery_capacity_mah(self) -> float:
        """See `Firmware`."""
        return self.parameters["BAT1_CAPACITY"]

    def battery_low(self) -> bool:
        """See `Firmware`; BAT_CRIT_THR."""
        return self.battery.percent() < 100.0 * self.parameters["BAT_CRIT_THR"]

    def on_battery_low(self) -> None:
        """See `Firmware`; COM_LOW_BAT_ACT."""
        self.text(Severity.CRITICAL, "Critical battery level")
        action = BATTERY_FAILSAFE.get(round(self.parameters["COM_LOW_BAT_ACT"]))
        if action is not None and self.armed and not self.sensed.landed and self.mode is not LAND:
            self._fail(action)

    def addressed(self, command: Command) -> bool:
        """Only commands for exactly this system and its autopilot (or all its components) are
        served."""
        return command.target[0] == self.sysid and command.target[1] in (0, 1)

    # --- arming ---

    def arm(self, *, force: bool) -> Result:
        """See `Firmware`."""
        if not force and not (
            self.armable() and self.mode.armable and self._mode_possible(self.mode)
        ):
            self.text(Severity.CRITICAL, "Arming denied: Resolve system health failures first")
            return Result.TEMPORARILY_REJECTED
        self.set_armed()
        self._flown = False
        self.text(Severity.INFO, "Armed by external command")
        self.begin(self._maneuver(self.mode))
        return Result.ACCEPTED

    def disarm(self, *, force: bool) -> Result:
        """See `Firmware`."""
        if not self.sensed.landed and not force:
            self.text(Severity.CRITICAL, "Disarming denied: not landed")
            return Result.TEMPORARILY_REJECTED
        self.set_disarmed("Disarmed by external command")
        return Result.ACCEPTED

    def set_disarmed(self, text: str) -> None:
        """See `Firmware`; what has ended with the flight gives way to the mode a vehicle waits
        in."""
        super().set_disarmed(text)
        if self.mode in (TAKEOFF, LAND, RTL, MISSION):
            self.mode = LOITER

    # --- modes ---

    def _do_set_mode(self, command: Command) -> Result:
        if not all(math.isfinite(p) for p in command.p[:3]):
            return Result.DENIED
        base, main, sub = (int(p) for p in command.p[:3])
        return self._choose(base, main, sub)

    def set_mode(self, base_mode: int, custom_mode: int) -> Result:
        """See `Firmware`."""
        return self._choose(base_mode, custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF)

    def _choose(self, base: int, main: int, sub: int) -> Result:
        """What makes no sense is accepted and changes nothing, as PX4 does."""
        mode = MODES.get((main, sub)) if base & MAV_MODE_FLAG_CUSTOM else None
        return Result.ACCEPTED if mode is None else self.enter(mode)

    def _mode_possible(self, mode: Mode) -> bool:
        if mode is OFFBOARD:
            return self._streaming()
        if mode is MISSION:
            return missions.present(self)
        return not mode.manual

    def enter(self, mode: Mode) -> Result:
        """Changes the mode, or says why not."""
        if (mode is MISSION or self.armed) and not self._mode_possible(mode):
            return Result.TEMPORARILY_REJECTED
        if not self.ready():
            return Result.TEMPORARILY_REJECTED
        self.failsafe = False
        if mode is not self.mode or mode is TAKEOFF:
            self._change(mode)
        return Result.ACCEPTED

    def _change(self, mode: Mode) -> None:
        self.mode = mode
        self.begin(self._maneuver(mode))

    def _maneuver(self, mode: Mode) -> Maneuver:
        heading = self.sensed.heading_rad
        if mode is OFFBOARD and self._setpoint is not None:
            return self._follow(self._setpoint)
        if mode is TAKEOFF and self.sensed.landed:
            down = self._takeoff_down_m
            if down is None:
                down = self.sensed.position_ned_m[2] - self.parameters["MIS_TAKEOFF_ALT"]
            return Takeoff(
                self.sensed, down, self.now + SPOOL_UP_S, self.parameters["MPC_TKO_SPEED"]
            )
        if mode is LAND:
            return Land(heading, self.home_ned[2])
        if mode is MISSION and self.armed:
            return missions.flight(self)
        if self.sensed.landed:
            return Ground()
        if mode is RTL:
            wait = max(0.0, self.parameters["RTL_LAND_DELAY"])
            return Return(self.sensed, self.home_ned, self.parameters["RTL_RETURN_ALT"], wait)
        return Hold(heading)

    # --- missions ---

    def course(
        self,
        place: Callable[[Item], Vector3],
        reached: Callable[[int], None],
        set_speed: Callable[[float], None],
    ) -> Course:
        """See `Firmware`."""
        p = self.parameters
        return Course(
            place=place,
            home=lambda: self.home_ned,
            radius_m=p["NAV_ACC_RAD"],
            return_height_m=p["RTL_RETURN_ALT"],
            return_wait_s=max(0.0, p["RTL_LAND_DELAY"]),
            takeoff_mps=p["MPC_TKO_SPEED"],
            spool_up_s=SPOOL_UP_S,
            set_speed=set_speed,
            reached=reached,
        )

    def mission_lost(self) -> None:
        """See `Firmware`."""
        self._change(LOITER)

    def _mission_start(self, _: Command) -> Result:
        result = self.enter(MISSION)
        if result is not Result.ACCEPTED or self.armed:
            return result
        return self.arm(force=False)

    def _pause(self, command: Command) -> Result:
        if command.p[0] not in (0.0, 1.0):
            return Result.DENIED
        return self.enter(LOITER if command.p[0] == 0.0 else MISSION)

    # --- offboard ---

    def on_setpoint(self, setpoint: Setpoint) -> None:
        """See `Firmware`; counted as a sign of life in every mode, flown in OFFBOARD. Axes are
        ignored one by one."""
        usable = setpoint.position != NOTHING or setpoint.velocity != NOTHING
        if setpoint.frame not in (FRAME_LOCAL_NED, FRAME_BODY_NED) or not usable:
            self.ignored += 1
            return
        if self.now - self._setpoint_s > STREAM_GAP_S:
            self._stream_since_s = self.now
        self._setpoint, self._setpoint_s = setpoint, self.now
        if self.mode is OFFBOARD and self.armed:
            self.begin(self._follow(setpoint))

    def _streaming(self) -> bool:
        fresh = self.now - self._setpoint_s <= STREAM_GAP_S
        return fresh and self.now - self._stream_since_s > STREAM_TIME_S

    def _follow(self, setpoint: Setpoint) -> Velocity:
        yaw = self.demand.heading_rad if setpoint.yaw_rad is None else setpoint.yaw_rad
        n, e, d = setpoint.velocity
        held = moved(setpoint.position, self.local_origin_ned)
        rate = setpoint.yaw_rate_radps or 0.0
        return Velocity((n or 0.0, e or 0.0, d or 0.0), yaw, held, rate, self.now)

    # --- commands ---

    def _takeoff(self, command: Command) -> Result:
        if not self.ready():
            return Result.TEMPORARILY_REJECTED
        self._takeoff_down_m = None
        if math.isfinite(command.p[6]):
            above = command.p[6] - self.plane.geodetic_from_ned(self.sensed.position_ned_m).alt_m
            if above > 0:
                self._takeoff_down_m = self.sensed.position_ned_m[2] - above
        self._change(TAKEOFF)
        return Result.ACCEPTED

    def go_to(self, place_ned: Vector3) -> Result:
        """See `Firmware`."""
        self.mode = LOITER
        self.begin(Velocity((0.0, 0.0, 0.0), self.sensed.heading_rad, place_ned))
        return Result.ACCEPTED

    # --- time ---

    def housekeeping(self) -> None:
        """See `Firmware`."""
        if not self.armed:
            return
        self._flown = self._flown or not self.sensed.landed
        self._check_offboard()
        self._check_datalink()
        if (
            not self.ready()
            and not self.sensed.landed
            and self.mode is not POSCTL
            and self.mode is not LAND
        ):
            self._fail(POSCTL)  # no position: descends
        if isinstance(self.maneuver, Auto) and self.maneuver.finished and not self.maneuver.done:
            missions.keep_up(self)
            self.mode = LOITER
            self.begin(
                Velocity((0.0, 0.0, 0.0), self.demand.heading_rad, self.demand.position_ned_m)
            )
        if self.mode is TAKEOFF and self.maneuver.done and not self.sensed.landed:
            self.mode = LOITER  # where the take-off led, not where it happens to be
        if self.sensed.landed:
            self._check_landed()

    def _check_offboard(self) -> None:
        silent = self.now - self._setpoint_s > self.parameters["COM_OF_LOSS_T"]
        if self.mode is OFFBOARD and silent:
            self._fail(OFFBOARD_LOSS.get(round(self.parameters["COM_OBL_RC_ACT"]), POSCTL))

    def _check_datalink(self) -> None:
        action = DATALINK_LOSS.get(round(self.parameters["NAV_DLL_ACT"]))
        heard = self.gcs_heartbeat_s
        if action is None or heard is None or self.failsafe or self.mode in (action, LAND):
            return
        if self.now - heard > self.parameters["COM_DL_LOSS_T"]:
            self._fail(action)

    def _fail(self, mode: Mode) -> None:
        self.failsafe = True
        self.text(Severity.CRITICAL, "Failsafe activated")
        self.mode = mode
        if mode.manual:
            self.begin(Land(self.sensed.heading_rad, self.home_ned[2], slow_mps=DESCEND_MPS))
        else:
            self.begin(self._maneuver(mode))

    def _check_landed(self) -> None:
        if isinstance(self.maneuver, Land | Return | Auto):
            delay = self.parameters["COM_DISARM_LAND"]
            if self.maneuver.done and delay >= 0 and self.standing_s() >= delay:
                self.set_disarmed("Disarmed by landing")
            return
        if isinstance(self.maneuver, Hold):
            self.begin(Ground())
        delay = self.parameters["COM_DISARM_PRFLT"]
        if not self._flown and delay > 0 and self.now - self.armed_s >= delay:
            self.set_disarmed("Disarmed by auto preflight disarming")

    commands: ClassVar[Mapping[int, Handler]] = COMMON | {
        Cmd.DO_SET_MODE: _do_set_mode,
        Cmd.MISSION_START: _mission_start,
        Cmd.DO_PAUSE_CONTINUE: _pause,
        Cmd.NAV_TAKEOFF: _takeoff,
        Cmd.NAV_LAND: lambda f, _: f.enter(LAND),
        Cmd.NAV_RETURN_TO_LAUNCH: lambda f, _: f.enter(RTL),
    }


SPOOL_UP_S = 1.0
"""From take-off command to lift."""
