"""The ArduCopter persona (autopilot 3): GUIDED flight, with the answers a running ArduCopter 4.7
gives. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.firmware.base import Firmware, Setup
from sim.firmware.fault_parameters import SIM_DEFAULTS
from sim.firmware.flying.guided import condition_yaw
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
from sim.firmware.flying.setpoint import (
    FRAME_BODY_NED,
    FRAME_BODY_OFFSET_NED,
    FRAME_LOCAL_NED,
    FRAME_LOCAL_OFFSET_NED,
    NOTHING,
    Setpoint,
    moved,
)
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
from sim.firmware.protocol.parameters import ARDUPILOT_DEFAULTS, CAST, Parameters
from sim.physics.geodesy import Vector3


@dataclass(frozen=True, slots=True)
class Mode:
    """A row of the mode table."""

    number: int
    name: str
    armable: bool
    """Arming by a ground station is allowed in it."""
    positioned: bool
    """Needs a position estimate."""


MODES: Mapping[int, Mode] = {
    mode.number: mode
    for mode in (
        Mode(0, "STABILIZE", armable=True, positioned=False),
        Mode(2, "ALT_HOLD", armable=True, positioned=False),
        Mode(3, "AUTO", armable=False, positioned=True),
        Mode(4, "GUIDED", armable=True, positioned=True),
        Mode(5, "LOITER", armable=True, positioned=True),
        Mode(6, "RTL", armable=False, positioned=True),
        Mode(9, "LAND", armable=False, positioned=False),
        Mode(16, "POSHOLD", armable=True, positioned=True),
        Mode(17, "BRAKE", armable=False, positioned=True),
    )
}
STABILIZE, AUTO, GUIDED, LOITER, RTL, LAND, BRAKE = (MODES[n] for n in (0, 3, 4, 5, 6, 9, 17))

GCS_FAILSAFE: Mapping[int, Mode] = {1: RTL, 2: RTL, 3: RTL, 4: LAND, 5: LAND, 6: RTL, 7: BRAKE}
"""FS_GCS_ENABLE to mode. Smart RTL (3, 4) keeps no track here and takes its second choice; 0 is
off."""

BATTERY_FAILSAFE: Mapping[int, Mode] = {1: LAND, 2: RTL, 3: RTL, 4: RTL}
"""BATT_FS_LOW_ACT to mode; 0 only warns."""

STREAM_GROUPS: Mapping[int, tuple[str, ...]] = {
    2: ("SYS_STATUS", "GPS_RAW_INT", "MISSION_CURRENT"),
    6: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"),
    10: ("ATTITUDE",),
    11: ("VFR_HUD",),
    12: (
        "SYSTEM_TIME",
        "BATTERY_STATUS",
        "EKF_STATUS_REPORT",
        "ADSB_VEHICLE",
        "EXTENDED_SYS_STATE",
        "WIND",
    ),
}
"""REQUEST_DATA_STREAM: MAV_DATA_STREAM to messages; 0 is all of them."""

SPOOL_UP_S = 1.0
"""From take-off command to lift."""
_FRAMES = (FRAME_LOCAL_NED, FRAME_LOCAL_OFFSET_NED, FRAME_BODY_NED, FRAME_BODY_OFFSET_NED)


class Ardupilot(Firmware):
    """ArduCopter."""

    autopilot: ClassVar[int] = 3
    version: ClassVar[int] = 4 << 24 | 7 << 16
    capabilities: ClassVar[int] = (
        0x2 | 0x4 | 0x8 | 0x80 | 0x100 | 0x2000 | 0x4000 | 0x8000 | 0x20000
    )
    boot_streams: ClassVar[Mapping[str, float]] = {"HEARTBEAT": 1.0}
    force_arm_magic: ClassVar[float] = 2989.0
    arm_nonsense: ClassVar[Result | None] = Result.UNSUPPORTED
    refusal: ClassVar[Result] = Result.FAILED
    asks_in_kind: ClassVar[bool] = False
    first_index: ClassVar[int] = 1

    mode: Mode

    def __init__(self, setup: Setup, boot_s: float) -> None:
        parameters = Parameters(ARDUPILOT_DEFAULTS | SIM_DEFAULTS, CAST)
        parameters.set("MAV_SYSID", setup.sysid)
        super().__init__(setup, parameters, boot_s)

    def booted(self) -> None:
        """See `Firmware`."""
        self.mode = STABILIZE
        self._setpoint_s = -math.inf
        self._takeoff_s = -math.inf

    def custom_mode(self) -> int:
        """See `Firmware`."""
        return self.mode.number

    def mode_flags(self) -> int:
        """See `Firmware`."""
        guided = MAV_MODE_FLAG_GUIDED if self.mode in (GUIDED, AUTO, RTL) else 0
        return MAV_MODE_FLAG_STABILIZE | guided

    def style(self) -> Style:
        """See `Firmware`."""
        p = self.parameters
        return Style(
            speed_mps=p["WPNAV_SPEED"] / 100 if self.speed_mps is None else self.speed_mps,
            climb_mps=p["WPNAV_SPEED_UP"] / 100,
            descent_mps=(p["LAND_SPEED_HIGH"] or p["WPNAV_SPEED_DN"]) / 100,
            land_mps=p["LAND_SPEED"] / 100,
            land_below_m=p["LAND_ALT_LOW"] / 100,
            captures=False,
        )

    def battery_capacity_mah(self) -> float:
        """See `Firmware`."""
        return self.parameters["BATT_CAPACITY"]

    def battery_low(self) -> bool:
        """See `Firmware`; BATT_LOW_VOLT, BATT_LOW_MAH."""
        volt, mah = self.parameters["BATT_LOW_VOLT"], self.parameters["BATT_LOW_MAH"]
        return (volt > 0 and self.battery.voltage_v < volt) or (
            mah > 0 and self.battery.left_mah < mah
        )

    def on_battery_low(self) -> None:
        """See `Firmware`; BATT_FS_LOW_ACT."""
        used = round(self.battery.used_mah)
        self.text(
            Severity.WARNING, f"Battery 1 is low {self.battery.voltage_v:.2f}V used {used} mAh"
        )
        action = BATTERY_FAILSAFE.get(round(self.parameters["BATT_FS_LOW_ACT"]))
        if action is None or not self.armed:
            return
        self.text(Severity.WARNING, "Battery Failsafe")
        if self.sensed.landed:
            self.set_disarmed("Disarming motors")
        elif self.mode is not LAND and self.enter(action) is not Result.ACCEPTED:
            self.enter(LAND)

    def addressed(self, _command: Command) -> bool:
        """Any component, and system 0, are served."""
        return True

    # --- arming ---

    def arm(self, *, force: bool) -> Result:
        """See `Firmware`."""
        refusal = self._arm_refusal(force=force)
        if refusal is not None:
            self.text(Severity.CRITICAL, f"Arm: {refusal}")
            return Result.FAILED
        self.set_armed()
        self.text(Severity.INFO, "Arming motors")
        return Result.ACCEPTED

    def _arm_refusal(self, *, force: bool) -> str | None:
        if not self.mode.armable:
            return f"{self.mode.name} mode not armable"
        if not force and self.parameters["ARMING_CHECK"] and not self.ready():
            return "Need Position Estimate"
        if not force and self.parameters["ARMING_CHECK"] and not self.armable():
            return (
                "Battery 1 below minimum arming voltage"
                if self.battery_low()
                else "Hardware safety switch"
            )
        return None

    def disarm(self, *, force: bool) -> Result:
        """See `Firmware`."""
        if not self.sensed.landed and not force:
            return Result.FAILED
        self.set_disarmed("Disarming motors")
        return Result.ACCEPTED

    # --- modes ---

    def _do_set_mode(self, command: Command) -> Result:
        base, custom = command.p[0], command.p[1]
        if not (math.isfinite(base) and math.isfinite(custom)):
            return Result.DENIED
        return self.set_mode(int(base), int(custom))

    def set_mode(self, base_mode: int, custom_mode: int) -> Result:
        """See `Firmware`."""
        if not base_mode & MAV_MODE_FLAG_CUSTOM:
            return Result.DENIED
        mode = MODES.get(custom_mode)
        if mode is None:
            self.text(Severity.WARNING, f"No such mode {custom_mode}")
            return Result.FAILED
        return self.enter(mode)

    def enter(self, mode: Mode) -> Result:
        """Changes the mode, or says why not."""
        if mode is self.mode:
            return Result.ACCEPTED
        refusal = self._mode_refusal(mode)
        if refusal is not None:
            self.text(Severity.WARNING, f"Mode change to {mode.name} failed: {refusal}")
            return Result.FAILED
        self.mode = mode
        self.begin(self._maneuver(mode))
        return Result.ACCEPTED

    def _mode_refusal(self, mode: Mode) -> str | None:
        if mode is AUTO and not missions.present(self):
            return "no mission"
        if (
            mode is AUTO
            and self.armed
            and self.sensed.landed
            and not missions.begins_with_takeoff(self)
        ):
            return "Missing Takeoff Cmd"
        if self.armed and mode.positioned and not self.ready():
            return "requires position"
        return None

    def _maneuver(self, mode: Mode) -> Maneuver:
        heading = self.sensed.heading_rad
        if mode is LAND:
            return Land(heading, self.home_ned[2])
        if self.sensed.landed and mode is not RTL:
            return Ground()
        if mode is AUTO:
            return missions.flight(self)
        if mode is RTL:
            wait = self.parameters["RTL_LOIT_TIME"] / 1000
            return Return(self.sensed, self.home_ned, self.parameters["RTL_ALT"] / 100, wait)
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
            radius_m=p["WPNAV_RADIUS"] / 100,
            return_height_m=p["RTL_ALT"] / 100,
            return_wait_s=p["RTL_LOIT_TIME"] / 1000,
            takeoff_mps=p["WPNAV_SPEED_UP"] / 100,
            spool_up_s=SPOOL_UP_S,
            set_speed=set_speed,
            reached=reached,
        )

    def first_item(self, item: Item | None) -> Item | None:
        """See `Firmware`; item 0 is home, whatever was uploaded there."""
        if not self.ready():
            return item
        at = self.plane.geodetic_from_ned(self.home_ned)
        return Item(
            16, 0, (0.0, 0.0, 0.0, 0.0), round(at.lat_deg * 1e7), round(at.lon_deg * 1e7), at.alt_m
        )

    def mission_lost(self) -> None:
        """See `Firmware`."""
        self.begin(Ground() if self.sensed.landed else Hold(self.sensed.heading_rad))

    def _mission_start(self, _: Command) -> Result:
        if not self.armed or self.enter(AUTO) is not Result.ACCEPTED:
            return Result.FAILED
        if not isinstance(self.maneuver, Auto):
            self.begin(missions.flight(self))
        return Result.ACCEPTED

    def _pause(self, command: Command) -> Result:
        if not isinstance(self.maneuver, Auto) or command.p[0] not in (0.0, 1.0):
            return Result.FAILED
        self.maneuver.paused = command.p[0] == 0.0
        self.update_demand()
        return Result.ACCEPTED

    # --- guided flight ---

    def _takeoff(self, command: Command) -> Result:
        height = command.p[6]
        if self.mode is not GUIDED or not self.armed or not self.sensed.landed:
            return Result.FAILED
        if not (math.isfinite(height) and height > 0):
            return Result.FAILED
        self._takeoff_s = self.now
        down = self.home_ned[2] - height
        self.begin(Takeoff(self.sensed, down, self.now + SPOOL_UP_S, self.style().climb_mps))
        return Result.ACCEPTED

    def on_setpoint(self, setpoint: Setpoint) -> None:
        """See `Firmware`; one ignored axis drops its whole group, and with nothing usable left the
        vehicle stops."""
        if self.mode is not GUIDED or not self.armed:
            self.ignored += 1
            return
        if self.sensed.landed:
            self.begin(Ground())
            return
        heading = self.sensed.heading_rad
        position = NOTHING if None in setpoint.position else setpoint.position
        velocity = None if None in setpoint.velocity else setpoint.velocity
        if setpoint.frame not in _FRAMES or (position is NOTHING and velocity is None):
            self.begin(Hold(heading))
            return
        yaw = self.demand.heading_rad if setpoint.yaw_rad is None else setpoint.yaw_rad
        n, e, d = velocity or (0.0, 0.0, 0.0)
        held = position if position is NOTHING else moved(position, self.local_origin_ned)
        rate = setpoint.yaw_rate_radps or 0.0
        self._setpoint_s = self.now
        self.begin(Velocity((n or 0.0, e or 0.0, d or 0.0), yaw, held, rate, self.now))

    def go_to(self, place_ned: Vector3) -> Result:
        """See `Firmware`."""
        if self.mode is not GUIDED and self.enter(GUIDED) is not Result.ACCEPTED:
            return Result.FAILED
        self.begin(Velocity((0.0, 0.0, 0.0), self.sensed.heading_rad, place_ned))
        return Result.ACCEPTED

    def guided_item(self, item: Item) -> bool | None:
        """See `Firmware`."""
        if self.mode is not GUIDED or not self.armed or self.sensed.landed:
            return False
        return self.go_to(missions.place(self, item)) is Result.ACCEPTED

    # --- time ---

    def data_stream(self, stream: int, interval_s: float | None) -> None:
        """See `Firmware`; overrides earlier message intervals of the group."""
        groups = STREAM_GROUPS.values() if stream == 0 else (STREAM_GROUPS.get(stream, ()),)
        for group in groups:
            for name in group:
                self.streams.set(name, interval_s, self.now)

    def is_gcs(self, system: int, _kind: int) -> bool:
        """The configured one alone, whatever it calls itself."""
        return system == round(self.parameters["MAV_GCS_SYSID"])

    def gcs_heartbeat(self) -> None:
        """See `Firmware`."""
        super().gcs_heartbeat()
        if self.failsafe:
            self.failsafe = False
            self.text(Severity.WARNING, "GCS Failsafe Cleared")

    def housekeeping(self) -> None:
        """See `Firmware`."""
        if not self.armed:
            return
        self._check_gcs()
        self._check_estimate()
        self._check_setpoint()
        if self.sensed.landed:
            self._check_landed()

    def _check_gcs(self) -> None:
        action = GCS_FAILSAFE.get(round(self.parameters["FS_GCS_ENABLE"]))
        if action is None or self.gcs_heartbeat_s is None or self.failsafe:
            return
        if self.now - self.gcs_heartbeat_s < self.parameters["FS_GCS_TIMEOUT"]:
            return
        self.failsafe = True
        self.text(Severity.WARNING, "GCS Failsafe")
        if self.sensed.landed and not isinstance(self.maneuver, Takeoff):
            self.set_disarmed("Disarming motors")
        elif self.mode is not LAND and self.enter(action) is not Result.ACCEPTED:
            self.enter(LAND)

    def _check_estimate(self) -> None:
        """FS_EKF_ACTION 1: without a position estimate, modes that need one end in LAND."""
        if not self.ready() and self.mode.positioned and not self.sensed.landed:
            self.text(Severity.CRITICAL, "EKF Failsafe: changed to LAND Mode")
            self.enter(LAND)

    def _check_setpoint(self) -> None:
        """GUID_TIMEOUT: without news a velocity becomes zero; a position stays."""
        moving = isinstance(self.maneuver, Velocity) and self.maneuver.velocity_ned_mps != (
            0.0,
            0.0,
            0.0,
        )
        if moving and self.now - self._setpoint_s > self.parameters["GUID_TIMEOUT"]:
            self.begin(Hold(self.sensed.heading_rad))

    def _check_landed(self) -> None:
        if isinstance(self.maneuver, Land | Return | Auto):
            if self.maneuver.done and self.standing_s() >= LAND_DETECT_S:
                self.set_disarmed("Disarming motors")
            return
        if isinstance(self.maneuver, Hold | Velocity):
            self.begin(Ground())
        delay = self.parameters["DISARM_DELAY"]
        idle_s = min(self.standing_s(), self.now - self.armed_s, self.now - self._takeoff_s)
        if delay and idle_s >= delay:
            self.set_disarmed("Disarming motors")

    commands: ClassVar[Mapping[int, Handler]] = COMMON | {
        Cmd.DO_SET_MODE: _do_set_mode,
        Cmd.MISSION_START: _mission_start,
        Cmd.DO_PAUSE_CONTINUE: _pause,
        Cmd.NAV_TAKEOFF: _takeoff,
        Cmd.CONDITION_YAW: condition_yaw,
        Cmd.NAV_LAND: lambda f, _: f.enter(LAND),
        Cmd.NAV_RETURN_TO_LAUNCH: lambda f, _: f.enter(RTL),
    }


LAND_DETECT_S = 1.0
"""The land detector wants the vehicle still for this long."""
