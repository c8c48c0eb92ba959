"""What all autopilots have in common, and the narrow seam behind which each keeps its quirks.

Pure: goal, what was heard and the time go in, messages come out. Goals are pursued by observed state: what is not yet
as wanted is asked for again about once a second, and no single answer is counted on. The only memory is when what was
asked last, and whether a mode was reached.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import ClassVar

from pymavlink.dialects.v20 import common

from swarm_ctl.core.vehicle import Airborne, Fly, Goal, Land, Release, Standby, Vector3, Yield
from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.messages import Heard, message_id
from swarm_ctl.mavlink.outgoing import Message

HEARTBEAT_S = 1.0
"""Ours. ArduPilot's GCS failsafe waits 5 s: one in five has to arrive."""
RETRY_S = 1.0
"""A vehicle's heartbeat shows the effect of a command within 1 s: asking sooner would ask twice."""
TAKEOFF_RETRY_S = 3.0
"""Motors spool up and the landed state follows; a second take-off before that starts the climb anew."""
GROUNDED_S = 5.0
"""Armed on the ground this long in land mode: the autopilot's own disarming (ArduCopter at once, PX4 2 s) failed."""
HEARTBEAT_LOST_S = 3.0
"""MAVSDK's figure (the strictest of the known clients)."""
FIX_MAX_AGE_S = 1.0
"""20 local positions missing in a row."""
STATUS_MAX_AGE_S = 5.0
"""10 SYS_STATUS missing in a row."""
ORIGIN_REFRESH_S = 10.0
"""A known origin is asked for again this often: an EKF that is reset moves it."""
MAX_SETPOINT_MPS = 100.0
"""No multirotor is faster: such a setpoint is a mistake."""
QUIET_RETRY_S = 5.0
"""Streams that may rightly be silent (no traffic) are asked for again this often."""

STREAMS_HZ: Mapping[str, float] = {
    "LOCAL_POSITION_NED": 20.0,
    "GLOBAL_POSITION_INT": 5.0,
    "SYS_STATUS": 2.0,
    "EXTENDED_SYS_STATE": 2.0,
    "ADSB_VEHICLE": 5.0,
}
"""LOCAL_POSITION_NED at the tick (the law's input); GLOBAL_POSITION_INT ties it to the common frame; SYS_STATUS has
health and battery; ADSB_VEHICLE is the proximity sensor."""
MAY_BE_SILENT = frozenset({"ADSB_VEHICLE"})

MULTIROTORS = frozenset(
    {
        common.MAV_TYPE_QUADROTOR,
        common.MAV_TYPE_COAXIAL,
        common.MAV_TYPE_HEXAROTOR,
        common.MAV_TYPE_OCTOROTOR,
        common.MAV_TYPE_TRICOPTER,
        common.MAV_TYPE_DODECAROTOR,
        common.MAV_TYPE_DECAROTOR,
    }
)
"""Vehicles that can stop in the air and go in any direction."""

_SENSORS = {
    common.MAV_SYS_STATUS_SENSOR_3D_GYRO: "gyro",
    common.MAV_SYS_STATUS_SENSOR_3D_ACCEL: "accelerometer",
    common.MAV_SYS_STATUS_SENSOR_3D_MAG: "compass",
    common.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE: "barometer",
    common.MAV_SYS_STATUS_SENSOR_GPS: "GPS",
    common.MAV_SYS_STATUS_SENSOR_RC_RECEIVER: "RC receiver",
    common.MAV_SYS_STATUS_GEOFENCE: "geofence",
    common.MAV_SYS_STATUS_AHRS: "position estimate",
    common.MAV_SYS_STATUS_LOGGING: "logging",
    common.MAV_SYS_STATUS_SENSOR_BATTERY: "battery",
}

_NEVER = -math.inf


class Autopilot(ABC):
    """One firmware's ways. An instance belongs to one vehicle and remembers what it has asked."""

    name: ClassVar[str]
    wire_id: ClassVar[int]
    """MAV_AUTOPILOT of its heartbeats."""
    controlled_mode: ClassVar[str]
    landing_mode: ClassVar[str]
    failsafes: ClassVar[Mapping[str, float]]
    """The failsafe parameters we fly with, and put back in the end."""

    def __init__(self, system: int) -> None:
        self.system = system
        self.originals: dict[str, float] = {}
        """The vehicle's own values of `failsafes`, as first read."""
        self._asked: dict[str, float] = {}
        self._goal: type[Goal] | None = None
        self._reached = False
        self._grounded_since: float | None = None
        self._stream_counts: dict[int, int] = {}
        self._pursue: dict[type[Goal], Callable[..., list[Message]]] = {
            Standby: lambda goal, heard, now: self._take_parameters(heard, now),  # noqa: ARG005
            Airborne: lambda goal, heard, now: self.climb(heard, goal.height_m, now),
            Fly: lambda goal, heard, now: self._fly(heard, goal.velocity_ned_mps, now),
            Land: lambda goal, heard, now: self._land(heard, now),  # noqa: ARG005
            Release: lambda goal, heard, now: self._restore_parameters(heard, now),  # noqa: ARG005
        }

    # --- the seam: what differs from firmware to firmware ---

    @abstractmethod
    def mode(self, custom_mode: int | None) -> str:
        """The firmware's own word for a HEARTBEAT's custom_mode ('' for None)."""

    @abstractmethod
    def set_mode(self, mode: str) -> Message:
        """The command that asks for `mode` (one of the words of `mode`)."""

    @abstractmethod
    def prearm(self, heard: Heard) -> bool:
        """SYS_STATUS says that it would arm."""

    @abstractmethod
    def climb(self, heard: Heard, height_m: float, now: float) -> list[Message]:
        """The next messages towards armed and at `height_m` above the take-off point."""

    @abstractmethod
    def fly(self, heard: Heard, velocity_ned_mps: Vector3, now: float) -> list[Message]:
        """One setpoint, and whatever the controlled mode needs. Nothing once that mode was left."""

    @abstractmethod
    def decode_parameter(self, raw: float, kind: int) -> float:
        """The value in a PARAM_VALUE of MAV_PARAM_TYPE `kind`."""

    @abstractmethod
    def encode_parameter(self, value: float, kind: int) -> float:
        """The inverse of `decode_parameter`."""

    # --- what is the same everywhere ---

    def pursue(self, goal: Goal, heard: Heard, now: float) -> list[Message]:
        """The messages to send now so that the vehicle comes nearer to `goal`. To be called every tick."""
        messages = [outgoing.heartbeat()] if self.due("heartbeat", HEARTBEAT_S, now) else []
        if isinstance(goal, Yield) or heard.heartbeat_s == _NEVER or self.fault(heard):
            return messages
        if type(goal) is not self._goal:
            self._goal, self._reached, self._grounded_since = type(goal), False, None
        self._streams(heard, now, messages)
        messages += self._pursue[type(goal)](goal, heard, now)
        return messages

    def fault(self, heard: Heard) -> str:
        """Why this vehicle can't be flown at all, or ''."""
        if heard.heartbeat_s == _NEVER:
            return ""
        if heard.autopilot != self.wire_id:
            who = _enum_name("MAV_AUTOPILOT", heard.autopilot)
            return f"sysid {self.system} is an autopilot {who}; allowed here: {self.name} ({self.wire_id})"
        if heard.vehicle_type not in MULTIROTORS:
            allowed = ", ".join(_enum_name("MAV_TYPE", kind) for kind in sorted(MULTIROTORS))
            what = _enum_name("MAV_TYPE", heard.vehicle_type)
            return f"sysid {self.system} is a vehicle of type {what}; allowed: {allowed}"
        return ""

    def missing(self, heard: Heard, now: float) -> str:
        """What keeps the vehicle from being healthy, or ''."""
        if heard.heartbeat_s == _NEVER:
            stranger = f" (heard sysid {heard.stranger} instead)" if heard.stranger else ""
            return f"no heartbeat yet from sysid {self.system}{stranger}"
        if now - heard.heartbeat_s > HEARTBEAT_LOST_S:
            return "heartbeat lost"
        if now - heard.system_status_s > STATUS_MAX_AGE_S:
            return "no SYS_STATUS"
        if not self.prearm(heard):
            return _not_passed(heard)
        if heard.local is None or now - heard.local.time_s > FIX_MAX_AGE_S:
            return "no local position (LOCAL_POSITION_NED)"
        if heard.global_ is None:
            return "no global position (GLOBAL_POSITION_INT)"
        if heard.origin is None:
            return "origin of the local frame unknown (GPS_GLOBAL_ORIGIN)"
        open_ones = [name for name, value in self.failsafes.items() if self._value(heard, name) != value]
        return f"failsafe parameters not confirmed: {', '.join(open_ones)}" if open_ones else ""

    def released(self, heard: Heard) -> bool:
        """The vehicle has its own failsafe parameters back, as far as they were ever changed."""
        return all(self._value(heard, name) == value for name, value in self.originals.items())

    def due(self, what: str, every_s: float, now: float) -> bool:
        """Whether `what` has not been asked for during the last `every_s`; if so, it counts as asked now."""
        if now - self._asked.get(what, _NEVER) < every_s - 1e-6:
            return False
        self._asked[what] = now
        return True

    def left(self, mode: str, *wanted: str) -> bool:
        """One of `wanted` was reached under this goal and is not the mode now: somebody else decided so."""
        inside = mode in wanted
        self._reached = self._reached or inside
        return self._reached and not inside

    def _streams(self, heard: Heard, now: float, messages: list[Message]) -> None:
        """Once a second, ask for the streams of which less than half has come. Another client may have slowed them."""
        if not self.due("streams", RETRY_S, now):
            return
        for name, rate_hz in STREAMS_HZ.items():
            number = message_id(name)
            count = heard.counts.get(number, 0)
            came, self._stream_counts[number] = count - self._stream_counts.get(number, 0), count
            every_s = QUIET_RETRY_S if name in MAY_BE_SILENT else RETRY_S
            enough = came >= 1 if name in MAY_BE_SILENT else came >= 0.5 * rate_hz * RETRY_S
            if not enough and self.due(name, every_s, now):
                messages.append(outgoing.interval(self.system, number, rate_hz))
        if self.due("origin", RETRY_S if heard.origin is None else ORIGIN_REFRESH_S, now):
            messages.append(outgoing.request(self.system, message_id("GPS_GLOBAL_ORIGIN")))

    def _fly(self, heard: Heard, velocity_ned_mps: Vector3, now: float) -> list[Message]:
        """Nothing where a NaN or a monster comes: the autopilot's time-out then stops the vehicle."""
        usable = all(-MAX_SETPOINT_MPS <= axis <= MAX_SETPOINT_MPS for axis in velocity_ned_mps)
        return self.fly(heard, velocity_ned_mps, now) if usable else []

    def _land(self, heard: Heard, now: float) -> list[Message]:
        """Land mode until disarmed; stop while it is not reached yet; disarm what stays armed on the ground."""
        if not heard.armed:
            return []
        mode = self.mode(heard.custom_mode)
        if self.left(mode, self.landing_mode):
            return []
        if mode != self.landing_mode:
            messages = [self.set_mode(self.landing_mode)] if self.due("land", RETRY_S, now) else []
            if mode == self.controlled_mode:
                messages.append(outgoing.velocity(self.system, (0.0, 0.0, 0.0), now))
            return messages
        if not heard.on_ground:
            self._grounded_since = None
        elif self._grounded_since is None:
            self._grounded_since = now
        elif now - self._grounded_since >= GROUNDED_S and self.due("disarm", RETRY_S, now):
            return [outgoing.command(self.system, outgoing.ARM_DISARM, 0.0)]
        return []

    def _take_parameters(self, heard: Heard, now: float) -> list[Message]:
        for name in self.failsafes:
            value = self._value(heard, name)
            if value is not None:
                self.originals.setdefault(name, value)
        return self._towards(self.failsafes, heard, now)

    def _restore_parameters(self, heard: Heard, now: float) -> list[Message]:
        return [] if heard.armed else self._towards(self.originals, heard, now)

    def _towards(self, wanted: Mapping[str, float], heard: Heard, now: float) -> list[Message]:
        """Read what is unknown, set what differs; PARAM_VALUE confirms both."""
        messages = []
        for name, value in wanted.items():
            known = heard.parameters.get(name)
            if known is None:
                if self.due(f"read {name}", RETRY_S, now):
                    messages.append(outgoing.read_parameter(self.system, name))
            elif self._value(heard, name) != value and self.due(f"set {name} {value}", RETRY_S, now):
                raw = self.encode_parameter(value, known.kind)
                messages.append(outgoing.set_parameter(self.system, name, raw, known.kind))
        return messages

    def _value(self, heard: Heard, name: str) -> float | None:
        known = heard.parameters.get(name)
        return None if known is None else round(self.decode_parameter(known.raw, known.kind), 6)


def _not_passed(heard: Heard) -> str:
    bad = heard.sensors_present & heard.sensors_enabled & ~heard.sensors_health
    names = [name for bit, name in _SENSORS.items() if bad & bit]
    return f"pre-arm checks not passed: {', '.join(names)}" if names else "pre-arm checks not passed"


def _enum_name(enum: str, number: int) -> str:
    entry = common.enums[enum].get(number)
    return f"{entry.name.removeprefix(enum + '_').lower()} ({number})" if entry else f"unknown ({number})"
