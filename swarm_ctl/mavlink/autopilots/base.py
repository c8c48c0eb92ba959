"""What all autopilots have in common, and the narrow seam behind which each keeps its quirks.

Pure: goal, what was heard and the time go in, messages come out. Goals are pursued by observed
state: what is not yet as wanted is asked for again about once a second, and no single answer is
counted on. The only memory is when what was asked last, and whether a mode was reached.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.vehicle import (
    AirborneGoal,
    FlyGoal,
    Goal,
    LandGoal,
    ReleaseGoal,
    StandbyGoal,
    TerminateGoal,
    Vector3,
    YieldGoal,
)
from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.autopilots.parameters import FailsafeParameters
from swarm_ctl.mavlink.autopilots.timing import (
    FIX_MAX_AGE_S,
    GROUNDED_S,
    HEARTBEAT_LOST_S,
    HEARTBEAT_S,
    KILL_RETRY_S,
    MAX_SETPOINT_MPS,
    MAY_BE_SILENT,
    ORIGIN_REFRESH_S,
    QUIET_RETRY_S,
    RETRY_S,
    STATUS_MAX_AGE_S,
    STREAMS_HZ,
    WIND_HZ,
    Pacer,
)
from swarm_ctl.mavlink.incoming import Heard, message_id
from swarm_ctl.mavlink.outgoing import Message

MULTIROTORS = frozenset(
    {
        dialect.MAV_TYPE_QUADROTOR,
        dialect.MAV_TYPE_COAXIAL,
        dialect.MAV_TYPE_HEXAROTOR,
        dialect.MAV_TYPE_OCTOROTOR,
        dialect.MAV_TYPE_TRICOPTER,
        dialect.MAV_TYPE_DODECAROTOR,
        dialect.MAV_TYPE_DECAROTOR,
    }
)
"""Vehicles that can stop in the air and go in any direction."""

_SENSORS = {
    dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO: "gyro",
    dialect.MAV_SYS_STATUS_SENSOR_3D_ACCEL: "accelerometer",
    dialect.MAV_SYS_STATUS_SENSOR_3D_MAG: "compass",
    dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE: "barometer",
    dialect.MAV_SYS_STATUS_SENSOR_GPS: "GPS",
    dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER: "RC receiver",
    dialect.MAV_SYS_STATUS_GEOFENCE: "geofence",
    dialect.MAV_SYS_STATUS_AHRS: "position estimate",
    dialect.MAV_SYS_STATUS_LOGGING: "logging",
    dialect.MAV_SYS_STATUS_SENSOR_BATTERY: "battery",
}

_NEVER = -math.inf


class Autopilot(ABC):
    """One firmware's ways. An instance belongs to one vehicle and remembers what it has asked."""

    name: ClassVar[str]
    wire_id: ClassVar[int]
    """MAV_AUTOPILOT of its heartbeats."""
    controlled_mode: ClassVar[str]
    landing_mode: ClassVar[str]
    takeoff_modes: ClassVar[tuple[str, ...]] = ()
    """What its own take-off leads to, where that is not the controlled mode."""
    wind_message: ClassVar[str]
    """Sent while the firmware estimates the wind; neither does as delivered."""
    failsafes: ClassVar[Mapping[str, float]]
    """The failsafe parameters we fly with, and put back in the end."""

    def __init__(self, system: int) -> None:
        self.system = system
        self.parameters = FailsafeParameters(
            system, self.failsafes, self.decode_parameter, self.encode_parameter
        )
        self.pacer = Pacer()
        self._goal: type[Goal] | None = None
        self._reached = False
        self._grounded_since: float | None = None
        self._stream_counts: dict[int, int] = {}
        self._pursue: dict[type[Goal], Callable[..., list[Message]]] = {
            StandbyGoal: lambda goal, heard, now: self.parameters.take(heard, now),  # noqa: ARG005
            AirborneGoal: lambda goal, heard, now: self.climb(heard, goal.height_m, now),
            FlyGoal: lambda goal, heard, now: self._fly(heard, goal.velocity_ned_mps, now),
            LandGoal: lambda goal, heard, now: self._land(heard, now),  # noqa: ARG005
            ReleaseGoal: lambda goal, heard, now: self.parameters.restore(heard, now),  # noqa: ARG005
            TerminateGoal: lambda goal, heard, now: self._terminate(heard, now),  # noqa: ARG005
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
        """The messages to send now so that the vehicle comes nearer to `goal`. To be called every
        tick."""
        messages = [outgoing.heartbeat()] if self.pacer.due("heartbeat", HEARTBEAT_S, now) else []
        if isinstance(goal, YieldGoal) or heard.heartbeat_s == _NEVER or self.fault(heard):
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
        unconfirmed = self.parameters.unconfirmed(heard)
        return f"failsafe parameters not confirmed: {', '.join(unconfirmed)}" if unconfirmed else ""

    def left(self, mode: str, *wanted: str) -> bool:
        """One of `wanted` was reached under this goal and is not the mode now: somebody else
        decided so."""
        inside = mode in wanted
        self._reached = self._reached or inside
        return self._reached and not inside

    def _streams(self, heard: Heard, now: float, messages: list[Message]) -> None:
        """Once a second, ask for the streams of which less than half has come. Another client may
        have slowed them."""
        if not self.pacer.due("streams", RETRY_S, now):
            return
        for name, rate_hz in (*STREAMS_HZ.items(), (self.wind_message, WIND_HZ)):
            number = message_id(name)
            count = heard.counts.get(number, 0)
            came, self._stream_counts[number] = count - self._stream_counts.get(number, 0), count
            every_s = QUIET_RETRY_S if name in MAY_BE_SILENT else RETRY_S
            enough = came >= 1 if name in MAY_BE_SILENT else came >= 0.5 * rate_hz * RETRY_S
            if not enough and self.pacer.due(name, every_s, now):
                messages.append(outgoing.interval(self.system, number, rate_hz))
        if self.pacer.due("origin", RETRY_S if heard.origin is None else ORIGIN_REFRESH_S, now):
            messages.append(outgoing.request(self.system, message_id("GPS_GLOBAL_ORIGIN")))

    def _fly(self, heard: Heard, velocity_ned_mps: Vector3, now: float) -> list[Message]:
        """Nothing where a NaN or a monster comes: the autopilot's time-out then stops the
        vehicle."""
        usable = all(-MAX_SETPOINT_MPS <= axis <= MAX_SETPOINT_MPS for axis in velocity_ned_mps)
        return self.fly(heard, velocity_ned_mps, now) if usable else []

    def _land(self, heard: Heard, now: float) -> list[Message]:
        """Land mode until disarmed; stop while it is not reached yet; disarm what stays armed on
        the ground."""
        if not heard.armed:
            return []
        mode = self.mode(heard.custom_mode)
        if self.left(mode, self.landing_mode):
            return []
        if mode != self.landing_mode:
            messages = (
                [self.set_mode(self.landing_mode)] if self.pacer.due("land", RETRY_S, now) else []
            )
            if mode == self.controlled_mode:
                messages.append(outgoing.velocity(self.system, (0.0, 0.0, 0.0), now))
            return messages
        if not heard.on_ground:
            self._grounded_since = None
        elif self._grounded_since is None:
            self._grounded_since = now
        elif now - self._grounded_since >= GROUNDED_S and self.pacer.due("disarm", RETRY_S, now):
            return [outgoing.command(self.system, outgoing.ARM_DISARM, 0.0)]
        return []

    def _terminate(self, heard: Heard, now: float) -> list[Message]:
        """Disarm, in the air too, until the heartbeat says that it is."""
        if not heard.armed or not self.pacer.due("terminate", KILL_RETRY_S, now):
            return []
        return [outgoing.command(self.system, outgoing.ARM_DISARM, 0.0, outgoing.FORCE)]


def _not_passed(heard: Heard) -> str:
    bad = heard.sensors_present & heard.sensors_enabled & ~heard.sensors_health
    names = [name for bit, name in _SENSORS.items() if bad & bit]
    return (
        f"pre-arm checks not passed: {', '.join(names)}" if names else "pre-arm checks not passed"
    )


def _enum_name(enum: str, number: int) -> str:
    entry = dialect.enums[enum].get(number)
    return (
        f"{entry.name.removeprefix(enum + '_').lower()} ({number})"
        if entry
        else f"unknown ({number})"
    )
