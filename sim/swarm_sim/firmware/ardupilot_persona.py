"""The ArduCopter persona (autopilot 3): GUIDED flight, and the answers of ArduCopter 4.7. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from swarm_sim.firmware.autopilot import CommandHandler, FlightMode
from swarm_sim.firmware.firmware import Firmware
from swarm_sim.firmware.flying.maneuvers import (
    STILL,
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
from swarm_sim.firmware.flying.mission_items import MissionItem
from swarm_sim.firmware.flying.position_target import (
    FRAME_BODY_NED,
    FRAME_BODY_OFFSET_NED,
    FRAME_LOCAL_NED,
    FRAME_LOCAL_OFFSET_NED,
    NOTHING,
    PositionTarget,
)
from swarm_sim.firmware.message import (
    MAV_MODE_FLAG_CUSTOM,
    MavCmd,
    MavCommand,
    MavResult,
    MavSeverity,
)
from swarm_sim.firmware.parameters import ARDUPILOT_DEFAULTS, CAST
from swarm_sim.firmware.protocol import ardupilot_transfer, uploaded_mission
from swarm_sim.firmware.protocol.commands import COMMON, condition_yaw, set_mission_current
from swarm_sim.firmware.protocol.telemetry import readings
from swarm_sim.physics.geodesy import Vector3

STABILIZE = FlightMode(0, "STABILIZE", armable=True)
ALT_HOLD = FlightMode(2, "ALT_HOLD", armable=True)
AUTO = FlightMode(3, "AUTO", guided=True, positioned=True)
GUIDED = FlightMode(4, "GUIDED", armable=True, guided=True, positioned=True)
LOITER = FlightMode(5, "LOITER", armable=True, positioned=True)
RTL = FlightMode(6, "RTL", guided=True, positioned=True)
LAND = FlightMode(9, "LAND")
POSHOLD = FlightMode(16, "POSHOLD", armable=True, positioned=True)
BRAKE = FlightMode(17, "BRAKE", positioned=True)
MODES: Mapping[int, FlightMode] = {
    mode.custom: mode
    for mode in (STABILIZE, ALT_HOLD, AUTO, GUIDED, LOITER, RTL, LAND, POSHOLD, BRAKE)
}

GCS_FAILSAFE: Mapping[int, FlightMode] = {
    1: RTL,
    2: RTL,
    3: RTL,
    4: LAND,
    5: LAND,
    6: RTL,
    7: BRAKE,
}
"""FS_GCS_ENABLE to mode; 0 is off. Smart RTL (3, 4) is not simulated: its second choice."""
BATTERY_FAILSAFE: Mapping[int, FlightMode] = {1: LAND, 2: RTL, 3: RTL, 4: RTL}
"""BATT_FS_LOW_ACT to mode; 0 only warns."""
FENCE_BREACH: Mapping[int, FlightMode] = {1: RTL, 2: LAND, 3: RTL, 4: BRAKE, 5: RTL}
"""FENCE_ACTION to mode; 0 only tells."""
POLYGONS = 4
"""Of FENCE_TYPE: areas."""

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

SPOOL_UP_S = 2.5
"""Motors, from a take-off command to lift: seen on ArduCopter 4.7 in SITL, like the next two."""
LAND_DETECT_S = 1.3
"""From the touch-down until the land detector says so: it wants the vehicle still for 1 s."""
DISARM_S = 2.2
"""From the touch-down until the motors have spooled down and stop."""
_FRAMES = (FRAME_LOCAL_NED, FRAME_LOCAL_OFFSET_NED, FRAME_BODY_NED, FRAME_BODY_OFFSET_NED)


_KNOWN_ITEMS = frozenset(
    (
        *(*range(16, 23), 30, 31, *range(82, 86), 92, 93, 94, 112, 114, 115, 177, 178, 179),
        *(*range(181, 185), 188, 189, 191, 193, 194, 195, 197, 201, 202, 203, *range(205, 209)),
        *(*range(210, 214), *range(215, 219), 222, 223, 531, 532, 534, 600, 601, 1000, 2000, 2001),
        *(2500, 2501, 3000, 42600, 42703),
    )
)
"""MAV_CMDs that an uploaded mission may have: all that ArduCopter 4.7-dev took, one by one."""


class ArdupilotPersona(Firmware):
    """ArduCopter."""

    autopilot = 3
    version = 4 << 24 | 7 << 16
    capabilities = 0x2 | 0x4 | 0x8 | 0x80 | 0x100 | 0x2000 | 0x4000 | 0x8000 | 0x20000
    defaults = ARDUPILOT_DEFAULTS
    encoding = CAST
    sysid_parameter = "MAV_SYSID"
    capacity_parameter = "BATT_CAPACITY"
    modes = MODES
    pilot_modes: ClassVar[Mapping[str, FlightMode]] = {
        "hold": LOITER,
        "land": LAND,
        "return": RTL,
        "manual": STABILIZE,
    }
    boot_mode = STABILIZE
    boot_streams: ClassVar[Mapping[str, float]] = {"HEARTBEAT": 1.0}
    fence_bit = 0x100000
    force_arm_magic = 2989.0
    arm_nonsense = MavResult.UNSUPPORTED
    refusal = MavResult.FAILED
    mission_services = ardupilot_transfer.HANDLERS
    promised_messages = frozenset((259, 280))  # CAMERA_INFORMATION, GIMBAL_MANAGER_INFORMATION
    unknown_message = MavResult.FAILED
    unknown_interval = MavResult.DENIED
    zero_is_here = True
    bad_number = MavResult.DENIED
    merely_answered: ClassVar[Mapping[int, MavResult | None]] = {
        MavCmd.DO_SET_RELAY: MavResult.ACCEPTED,
        MavCmd.DO_SET_SERVO: MavResult.ACCEPTED,
        MavCmd.DO_FLIGHTTERMINATION: MavResult.FAILED,
        MavCmd.DO_LAND_START: MavResult.FAILED,
        MavCmd.DO_SET_ROI_LOCATION: MavResult.ACCEPTED,
        MavCmd.DO_SET_ROI_NONE: MavResult.ACCEPTED,
        MavCmd.DO_MOUNT_CONTROL: MavResult.FAILED,
        MavCmd.DO_GRIPPER: MavResult.FAILED,
        MavCmd.PREFLIGHT_STORAGE: MavResult.DENIED,
        MavCmd.DO_GIMBAL_MANAGER_PITCHYAW: MavResult.FAILED,
        MavCmd.IMAGE_START_CAPTURE: MavResult.FAILED,
    }
    first_index = 1
    land_detect_s = LAND_DETECT_S

    def start(self, sensed: Sensed, boot_s: float) -> None:
        super().start(sensed, boot_s)
        self._setpoint_s = self._takeoff_s = -math.inf

    def style_by_parameters(self) -> FlightStyle:
        p = self.parameters
        return FlightStyle(
            speed_mps=p["WPNAV_SPEED"] / 100,
            climb_mps=p["WPNAV_SPEED_UP"] / 100,
            descent_mps=(p["LAND_SPEED_HIGH"] or p["WPNAV_SPEED_DN"]) / 100,
            land_mps=p["LAND_SPEED"] / 100,
            land_below_m=p["LAND_ALT_LOW"] / 100,
            land_from_m=p["LAND_ALT_LOW"] / 100,
            spool_up_s=SPOOL_UP_S,
            takeoff_ramp_s=0.0,
            takeoff_mps=p["WPNAV_SPEED_UP"] / 100,
            return_height_m=p["RTL_ALT"] / 100,
            return_wait_s=p["RTL_LOIT_TIME"] / 1000,
            waypoint_radius_m=p["WPNAV_RADIUS"] / 100,
            captures=False,
        )

    def battery_low(self) -> bool:
        """By BATT_LOW_VOLT or BATT_LOW_MAH."""
        volt, mah = self.parameters["BATT_LOW_VOLT"], self.parameters["BATT_LOW_MAH"]
        low_volt = volt > 0 and self.battery.voltage_v < volt
        return low_volt or (mah > 0 and self.battery.left_mah < mah)

    def on_battery_low(self) -> None:
        """By BATT_FS_LOW_ACT."""
        state = f"{self.battery.voltage_v:.2f}V used {round(self.battery.used_mah)} mAh"
        self.text(MavSeverity.WARNING, f"Battery 1 is low {state}")
        action = BATTERY_FAILSAFE.get(round(self.parameters["BATT_FS_LOW_ACT"]))
        if action is None or not self.armed:
            return
        self.text(MavSeverity.WARNING, "Battery Failsafe")
        self._fail(action, on_ground=self.sensed.landed)

    # --- arming ---

    def arm(self, *, force: bool) -> MavResult:
        refusal = self._arm_refusal(force=force)
        if refusal is not None:
            self.text(MavSeverity.CRITICAL, f"Arm: {refusal}")
            return MavResult.FAILED
        self.set_armed()
        self.text(MavSeverity.INFO, "Arming motors")
        return MavResult.ACCEPTED

    def _arm_refusal(self, *, force: bool) -> str | None:
        if not self.mode.armable:
            return f"{self.mode.name} mode not armable"
        if force or not self.parameters["ARMING_CHECK"] or self.armable():
            return None
        if not self.ready():
            return "Need Position Estimate"
        low = self.battery_low()
        return "Battery 1 below minimum arming voltage" if low else "Hardware safety switch"

    # --- modes ---

    def _do_set_mode(self, command: MavCommand) -> MavResult:
        base, custom = command.p[0], command.p[1]
        if not (math.isfinite(base) and math.isfinite(custom)):
            return MavResult.DENIED
        return self.set_mode(int(base), int(custom))

    def set_mode(self, base_mode: int, custom_mode: int) -> MavResult:
        if not base_mode & MAV_MODE_FLAG_CUSTOM:
            return MavResult.DENIED
        mode = MODES.get(custom_mode)
        if mode is None:
            self.text(MavSeverity.WARNING, f"No such mode {custom_mode}")
            return MavResult.FAILED
        return self.enter(mode)

    def enter(self, mode: FlightMode) -> MavResult:
        if mode is self.mode:
            return MavResult.ACCEPTED
        refusal = self._mode_refusal(mode)
        if refusal is not None:
            self.text(MavSeverity.WARNING, f"Mode change to {mode.name} failed: {refusal}")
            return MavResult.FAILED
        self.mode = mode
        self.begin(self._maneuver(mode))
        for fields in readings(self, "HEARTBEAT"):  # a new mode is told at once
            self.say("HEARTBEAT", fields)
        return MavResult.ACCEPTED

    def _mode_refusal(self, mode: FlightMode) -> str | None:
        if mode is AUTO and not uploaded_mission.present(self):
            return "no mission"
        starts = mode is AUTO and self.armed and self.sensed.landed
        if starts and not uploaded_mission.begins_with_takeoff(self):
            return "Missing Takeoff Cmd"
        if self.armed and mode.positioned and not self.ready():
            return "requires position"
        return None

    def _maneuver(self, mode: FlightMode) -> Maneuver:
        heading = self.sensed.heading_rad
        if mode is LAND:
            return LandManeuver(heading, self.home_ned[2])
        if mode is RTL:
            return self.return_home()
        if self.sensed.landed:
            return GroundManeuver()
        return uploaded_mission.fly(self) if mode is AUTO else HoldManeuver(heading)

    # --- missions ---

    def first_item(self, item: MissionItem | None) -> MissionItem | None:
        """Item 0 is home, whatever was uploaded there."""
        if not self.ready():
            return item
        at = self.geodetic(self.home_ned)
        x, y = round(at.lat_deg * 1e7), round(at.lon_deg * 1e7)
        return MissionItem(MavCmd.NAV_WAYPOINT, 0, (0.0, 0.0, 0.0, 0.0), x, y, at.alt_m)

    def known_item(self, command: int, frame: int) -> bool:
        del frame
        return command in _KNOWN_ITEMS

    def keep_transfer_going(self) -> None:
        ardupilot_transfer.keep_going(self)

    def mission_lost(self) -> None:
        landed, heading = self.sensed.landed, self.sensed.heading_rad
        self.begin(GroundManeuver() if landed else HoldManeuver(heading))

    def _mission_start(self, _: MavCommand) -> MavResult:
        if not self.armed or self.enter(AUTO) is not MavResult.ACCEPTED:
            return MavResult.FAILED
        if not isinstance(self.maneuver, MissionManeuver):
            self.begin(uploaded_mission.fly(self))
        return MavResult.ACCEPTED

    def _pause(self, command: MavCommand) -> MavResult:
        if command.p[0] not in (0.0, 1.0):
            return MavResult.DENIED
        if isinstance(self.maneuver, MissionManeuver):
            self.maneuver.paused = command.p[0] == 0.0
            self.update_demand()
        return MavResult.ACCEPTED

    # --- guided flight ---

    def _takeoff(self, command: MavCommand) -> MavResult:
        height = command.p[6]
        if self.mode is not GUIDED or not self.armed or not self.sensed.landed:
            return MavResult.FAILED
        if not (math.isfinite(height) and height > 0):
            return MavResult.FAILED
        self._takeoff_s = self.now
        self.begin(self.take_off(self.home_ned[2] - height))
        return MavResult.ACCEPTED

    def on_position_target(self, target: PositionTarget) -> None:
        """One ignored axis drops its whole group; with nothing usable left the vehicle stops."""
        if self.mode is not GUIDED or not self.armed:
            self.ignored += 1
            return
        if self.sensed.landed:
            self.begin(GroundManeuver())
            return
        position = NOTHING if None in target.position else target.position
        velocity = NOTHING if None in target.velocity else target.velocity
        if target.frame not in _FRAMES or position == velocity == NOTHING:
            self.begin(HoldManeuver(self.sensed.heading_rad))
            return
        self._setpoint_s = self.now
        self.follow(target, position, velocity)

    def go_to(self, place_ned: Vector3) -> MavResult:
        if self.mode is not GUIDED and self.enter(GUIDED) is not MavResult.ACCEPTED:
            return MavResult.FAILED
        self.begin(VelocityManeuver(STILL, self.sensed.heading_rad, place_ned))
        return MavResult.ACCEPTED

    def guided_item(self, item: MissionItem) -> bool | None:
        if self.mode is not GUIDED or not self.armed or self.sensed.landed:
            return False
        return self.go_to(uploaded_mission.place(self, item)) is MavResult.ACCEPTED

    # --- time ---

    def data_stream(self, stream: int, interval_s: float | None) -> None:
        """Overrides earlier message intervals of the group."""
        groups = STREAM_GROUPS.values() if stream == 0 else (STREAM_GROUPS.get(stream, ()),)
        for group in groups:
            for name in group:
                self.streams.set(name, interval_s, self.now)

    def is_gcs(self, system: int, _kind: int) -> bool:
        """By the configured id or range of ids alone, whatever type it tells."""
        first, last = self.parameters["MAV_GCS_SYSID"], self.parameters["MAV_GCS_SYSID_HI"]
        return first <= system <= max(first, last)

    def gcs_heartbeat(self) -> None:
        super().gcs_heartbeat()
        if self.failsafe:
            self.failsafe = False
            self.text(MavSeverity.WARNING, "GCS Failsafe Cleared")

    def housekeeping(self) -> None:
        self._check_gcs()
        self._check_estimate()
        self._check_setpoint()
        self._check_fence()
        if self.sensed.landed:
            self._check_landed()

    def _check_gcs(self) -> None:
        action = GCS_FAILSAFE.get(round(self.parameters["FS_GCS_ENABLE"]))
        if action is None or self.gcs_heartbeat_s is None or self.failsafe:
            return
        if self.now - self.gcs_heartbeat_s >= self.parameters["FS_GCS_TIMEOUT"]:
            self.failsafe = True
            self.text(MavSeverity.WARNING, "GCS Failsafe")
            starting = isinstance(self.maneuver, TakeoffManeuver)
            self._fail(action, on_ground=self.sensed.landed and not starting)

    def _check_fence(self) -> None:
        """The areas that it was sent (FENCE_TYPE 4), by FENCE_ACTION."""
        enabled, kinds = self.parameters["FENCE_ENABLE"], round(self.parameters["FENCE_TYPE"])
        if enabled != 1.0 or not kinds & POLYGONS or not self.fence_breached():
            return
        self.text(MavSeverity.WARNING, "Polygon fence breached")
        action = FENCE_BREACH.get(round(self.parameters["FENCE_ACTION"]))
        if action is not None:
            self._fail(action, on_ground=False)

    def _fail(self, action: FlightMode, *, on_ground: bool) -> None:
        if on_ground:
            self.set_disarmed(self.disarmed_text)
        elif self.mode is not LAND and self.enter(action) is not MavResult.ACCEPTED:
            self.enter(LAND)

    def _check_estimate(self) -> None:
        """FS_EKF_ACTION 1: without a position estimate, modes that need one end in LAND."""
        if not self.ready() and self.mode.positioned and not self.sensed.landed:
            self.text(MavSeverity.CRITICAL, "EKF Failsafe: changed to LAND Mode")
            self.enter(LAND)

    def _check_setpoint(self) -> None:
        """GUID_TIMEOUT: without a new setpoint a velocity becomes zero; a position stays."""
        now_flown = self.maneuver
        moving = isinstance(now_flown, VelocityManeuver) and now_flown.velocity_ned_mps != STILL
        if moving and self.now - self._setpoint_s > self.parameters["GUID_TIMEOUT"]:
            self.begin(HoldManeuver(self.sensed.heading_rad))

    def _check_landed(self) -> None:
        if isinstance(self.maneuver, LandManeuver | ReturnManeuver | MissionManeuver):
            if self.maneuver.done and self.standing_s() >= DISARM_S:
                self.set_disarmed(self.disarmed_text)
            return
        if isinstance(self.maneuver, HoldManeuver | VelocityManeuver):
            self.begin(GroundManeuver())
        delay = self.parameters["DISARM_DELAY"]
        idle_s = min(self.standing_s(), self.now - self.armed_s, self.now - self._takeoff_s)
        if delay and idle_s >= delay:
            self.set_disarmed(self.disarmed_text)

    commands: ClassVar[Mapping[int, CommandHandler]] = COMMON | {
        MavCmd.DO_SET_MODE: _do_set_mode,
        MavCmd.MISSION_START: _mission_start,
        MavCmd.DO_PAUSE_CONTINUE: _pause,
        MavCmd.DO_SET_MISSION_CURRENT: set_mission_current,
        MavCmd.NAV_TAKEOFF: _takeoff,
        MavCmd.CONDITION_YAW: condition_yaw,
        MavCmd.DO_FENCE_ENABLE: lambda _, command: (
            MavResult.UNSUPPORTED if command.p[0] else MavResult.ACCEPTED  # it is off
        ),
        MavCmd.RUN_PREARM_CHECKS: lambda f, _: (
            MavResult.TEMPORARILY_REJECTED if f.armed else MavResult.ACCEPTED
        ),
        MavCmd.NAV_LAND: lambda f, _: f.enter(LAND),
        MavCmd.NAV_RETURN_TO_LAUNCH: lambda f, _: f.enter(RTL),
    }
