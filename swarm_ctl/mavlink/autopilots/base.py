"""What all autopilots have in common, and the seam behind which each firmware keeps its own ways.

Pure: a goal, the vehicle's telemetry and the time go in, messages come out. A goal is pursued by
observed state: what is not yet as wanted is asked for again about once a second, and no single
answer is relied on. The only memory is when each thing was asked for, and whether a mode was
reached.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import ClassVar, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.fleet import AGENT_SYSID
from swarm_ctl.core.model.vehicle import (
    AirborneGoal,
    FlyGoal,
    Goal,
    LandGoal,
    ReleaseGoal,
    StandbyGoal,
    TerminateGoal,
    Vector3,
    VehicleIdentity,
    YieldGoal,
)
from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.autopilots.failsafe_parameters import FailsafeParameters, ParameterRule
from swarm_ctl.mavlink.autopilots.flight_limits import FlightLimits, LimitSource
from swarm_ctl.mavlink.autopilots.modes import ModeTable
from swarm_ctl.mavlink.autopilots.timing import (
    CLIMBS_MPS,
    ESTIMATE_HZ,
    FIX_MAX_AGE_S,
    GROUNDED_S,
    HEARTBEAT_LOST_S,
    HEARTBEAT_S,
    KILL_RETRY_S,
    LANDED_MAX_AGE_S,
    LISTEN_S,
    MAX_SETPOINT_MPS,
    MAY_BE_SILENT,
    ORIGIN_REFRESH_S,
    QUIET_RETRY_S,
    RETRY_S,
    SLOW_HZ,
    STATUS_MAX_AGE_S,
    STREAMS_HZ,
    TAKEOFF_RETRY_S,
    TAKEOFF_WAIT_S,
    VERSION_TRIES,
    WIND_HZ,
    Pacer,
)
from swarm_ctl.mavlink.outgoing import Message
from swarm_ctl.mavlink.telemetry.estimate import EstimateRules
from swarm_ctl.mavlink.telemetry.heartbeats import ASK_S, DOUBT_S, FlightState
from swarm_ctl.mavlink.telemetry.incoming import message_id
from swarm_ctl.mavlink.telemetry.vehicle_telemetry import Telemetry

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
_COMMAND = dialect.MAVLINK_MSG_ID_COMMAND_LONG


class Autopilot(ABC):
    """One firmware's behaviour. An instance belongs to one vehicle and stores what it asked for.

    Args:
        system: the vehicle's system id.
        agent_sysid: what we speak with.
        streams_hz: how often it is asked for its messages, by name.
    """

    name: ClassVar[str]
    wire_id: ClassVar[int]
    """MAV_AUTOPILOT of its heartbeats."""
    modes: ClassVar[ModeTable]
    controlled_mode: ClassVar[str]
    climbs_by_setpoints: ClassVar[bool]
    """A take-off is a stream of our setpoints, not a command."""
    landing_mode: ClassVar[str]
    wind_message: ClassVar[str]
    wind_switch: ClassVar[str]
    """The parameter that makes the firmware estimate the wind; as delivered it is 0."""
    estimate_rules: ClassVar[EstimateRules]
    limit_sources: ClassVar[tuple[LimitSource, ...]]

    def __init__(
        self,
        system: int,
        agent_sysid: int = AGENT_SYSID,
        streams_hz: Mapping[str, float] = STREAMS_HZ,
    ) -> None:
        self.system = system
        self.agent_sysid = agent_sysid
        self.parameters = FailsafeParameters(
            system, self.failsafes(), self.decode_parameter, self.encode_parameter
        )
        self.flight_limits = FlightLimits(system, self.limit_sources, self.decode_parameter)
        self.pacer = Pacer()
        self._goal: type[Goal] | None = None
        self._reached = False
        self._withheld_s = math.inf
        """When the first command was withheld under this goal, since the last one sent in doubt."""
        self._grounded_since: float | None = None
        own = {self.wind_message: WIND_HZ, self.estimate_rules.message: ESTIMATE_HZ}
        self._wanted = Streams(system, streams_hz, own)
        self._version_tries = 0

    # --- the seam: what differs from firmware to firmware ---

    @abstractmethod
    def failsafes(self) -> tuple[ParameterRule, ...]:
        """The failsafe parameters we fly with; afterwards the vehicle gets its own values back."""

    @abstractmethod
    def prearm(self, heard: Telemetry) -> bool:
        """SYS_STATUS says that the vehicle would arm."""

    @abstractmethod
    def take_off(self, heard: Telemetry, goal: AirborneGoal, now: float) -> list[Message]:
        """The next messages towards armed and at the goal's height above the take-off point."""

    @abstractmethod
    def fly(self, heard: Telemetry, velocity_ned_mps: Vector3, now: float) -> list[Message]:
        """One setpoint, and what the controlled mode needs; nothing once that mode was left."""

    def yielding(self, heard: Telemetry, now: float) -> list[Message]:  # noqa: ARG002
        """What a pilot needs to give the vehicle back; here nothing."""
        return []

    def stand_by(self, heard: Telemetry, now: float) -> list[Message]:
        """What a vehicle on the ground needs to become ready for a flight, or to know before."""
        known = self.wind_switch in heard.parameters
        due = not known and self.pacer.due("wind switch", QUIET_RETRY_S, now)
        return [outgoing.read_parameter(self.system, self.wind_switch)] if due else []

    def estimates_wind(self, heard: Telemetry) -> bool:
        """Whether the vehicle is known to estimate the wind."""
        switch = heard.parameters.get(self.wind_switch)
        return switch is not None and self.decode_parameter(switch.raw, switch.kind) > 0

    def decode_parameter(self, raw: float, kind: int) -> float:  # noqa: ARG002
        """The value in a PARAM_VALUE of MAV_PARAM_TYPE `kind`; here a float of the same value."""
        return raw

    def encode_parameter(self, value: float, kind: int) -> float:  # noqa: ARG002
        """The inverse of `decode_parameter`."""
        return value

    # --- what is the same for all firmware ---

    @property
    def watched(self) -> frozenset[str]:
        """The parameters to store."""
        return self.parameters.names | self.flight_limits.names | {self.wind_switch}

    def mode(self, heard: Telemetry) -> str:
        """The name of the vehicle's mode, '' while unknown."""
        return self.modes.name(heard.custom_mode)

    def set_mode(self, mode: str) -> Message:
        """The command that asks for `mode`."""
        return self.modes.command(self.system, mode)

    def arm(self, now: float) -> list[Message]:
        """COMPONENT_ARM_DISARM, again after `RETRY_S`."""
        command = outgoing.command(self.system, outgoing.ARM_DISARM, 1.0)
        return [command] if self.pacer.due("arm", RETRY_S, now) else []

    def take_off_due(self, heard: Telemetry, now: float) -> bool:
        """Whether to ask for the take-off: at first, and again only while the vehicle is known to
        stand. In the air, on its way there, or silent, it keeps the climb that it has begun."""
        accepted = heard.answers.get(outgoing.TAKEOFF) == dialect.MAV_RESULT_ACCEPTED
        if self.pacer.asked("take-off"):
            fix, silent_s = heard.local, now - heard.landed_s
            if silent_s > LANDED_MAX_AGE_S or (fix and fix.velocity_ned_mps[2] < -CLIMBS_MPS):
                return False
        return self.pacer.due("take-off", TAKEOFF_WAIT_S if accepted else TAKEOFF_RETRY_S, now)

    def pursue(self, goal: Goal, heard: Telemetry, now: float) -> list[Message]:
        """The messages of this tick that bring the vehicle nearer to `goal`; call it every tick."""
        messages = [outgoing.heartbeat()] if self.pacer.due("heartbeat", HEARTBEAT_S, now) else []
        if type(goal) is not self._goal:
            self._goal, self._reached, self._grounded_since = type(goal), False, None
            self._withheld_s = math.inf
        heard.evidence.expects = self._expects
        if heard.heartbeat_s == _NEVER or self.fault(heard):
            return messages
        if isinstance(goal, YieldGoal):
            return messages + self.yielding(heard, now) + self._see_down(heard, now)
        messages += self._streams(heard, now)
        if isinstance(goal, AirborneGoal | FlyGoal | LandGoal):
            messages += self.parameters.watch(heard, now)
        return messages + self._unless_in_doubt(self._towards(goal, heard, now), heard, now)

    def _expects(self, told: FlightState) -> bool:
        """Whether the goal asks for what a heartbeat tells."""
        mode, goal = self.modes.name(told.custom_mode), self._goal
        if goal in (AirborneGoal, FlyGoal):
            return told.armed and mode == self.controlled_mode
        if goal is LandGoal:
            return told.armed and mode == self.landing_mode
        return goal is TerminateGoal and not told.armed

    def _unless_in_doubt(
        self, messages: list[Message], heard: Telemetry, now: float
    ) -> list[Message]:
        """While the heartbeats say other than what is believed, a pilot may have changed the mode:
        the vehicle is asked for more of them and gets setpoints, which only the controlled mode
        follows, but no command. A flood of forged heartbeats must not keep a vehicle in the air,
        so commands wait for `DOUBT_S` at most."""
        if not heard.evidence.doubt or self._goal is TerminateGoal:
            return messages
        if any(message.get_msgId() == _COMMAND for message in messages):
            self._withheld_s = min(self._withheld_s, now)
            if now - self._withheld_s >= DOUBT_S:
                self._withheld_s = math.inf
            else:
                messages = [each for each in messages if each.get_msgId() != _COMMAND]
        if self.pacer.due("heartbeats", ASK_S, now):
            messages.append(outgoing.request(self.system, message_id("HEARTBEAT")))
        return messages

    def _towards(self, goal: Goal, heard: Telemetry, now: float) -> list[Message]:
        match goal:
            case StandbyGoal():
                begin = self.ask_version(heard, now) + self.stand_by(heard, now)
                begin += self.flight_limits.read(heard, now)
                return begin + self.parameters.take(heard, now)
            case AirborneGoal():
                return self.take_off(heard, goal, now)
            case FlyGoal():
                return self._fly(heard, goal.velocity_ned_mps, now)
            case LandGoal():
                return self._land(heard, now)
            case ReleaseGoal():
                begin = self.ask_version(heard, now) + self.stand_by(heard, now)
                return begin + self.parameters.restore(heard, now)
            case TerminateGoal():
                return self._terminate(heard, now)
            case YieldGoal():
                return []

    def fault(self, heard: Telemetry) -> str:
        """Why this vehicle can't be flown at all, or ''."""
        good = heard.autopilot == self.wire_id and heard.vehicle_type in MULTIROTORS
        if good or heard.heartbeat_s == _NEVER:
            return ""
        vehicle = f"sysid {self.system} is"
        if heard.autopilot != self.wire_id:
            found = _enum_name("MAV_AUTOPILOT", heard.autopilot)
            return f"{vehicle} an autopilot {found}; allowed here: {self.name} ({self.wire_id})"
        allowed = ", ".join(_enum_name("MAV_TYPE", kind) for kind in sorted(MULTIROTORS))
        found = _enum_name("MAV_TYPE", heard.vehicle_type)
        return f"{vehicle} a vehicle of type {found}; allowed: {allowed}"

    def missing(self, heard: Telemetry, now: float) -> str:
        """What keeps the vehicle from being healthy, or ''."""
        if heard.clash:
            return heard.clash
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
        if heard.global_ is None or now - heard.global_.time_s > STATUS_MAX_AGE_S:
            return "no global position (GLOBAL_POSITION_INT)"
        if now - heard.landed_s > STATUS_MAX_AGE_S:
            return "whether it stands on the ground is unknown (EXTENDED_SYS_STATE)"
        if heard.origin is None:
            return "origin of the local frame unknown (GPS_GLOBAL_ORIGIN)"
        if not math.isfinite(heard.estimate.report_s):
            return f"no {self.estimate_rules.message}"
        unconfirmed = self.parameters.unconfirmed(heard)
        if unconfirmed and self.parameters.obstacle:
            return f"failsafe parameters not set: {self.parameters.obstacle}"
        if unconfirmed:
            return f"failsafe parameters not confirmed: {', '.join(unconfirmed)}"
        if not heard.armed and now - heard.first_heartbeat_s < LISTEN_S:
            return "listening for others with its system id or ours"
        return ""

    def left(self, mode: str, *wanted: str) -> bool:
        """The vehicle was in one of the modes `wanted` under this goal and is not now: a pilot or a
        failsafe has changed the mode."""
        inside = mode in wanted
        self._reached = self._reached or inside
        return self._reached and not inside

    def identity(self, heard: Telemetry) -> VehicleIdentity | None:
        """Which vehicle this is; None until it has said so, or has not answered for long enough."""
        if heard.uid is None and self._version_tries <= VERSION_TRIES:
            return None
        return VehicleIdentity(self.name, self.system, heard.uid or "")

    def ask_version(self, heard: Telemetry, now: float) -> list[Message]:
        """A request for AUTOPILOT_VERSION, while it is not known; a few in all."""
        done = heard.uid is not None or self._version_tries > VERSION_TRIES
        if done or not self.pacer.due("version", RETRY_S, now):
            return []
        self._version_tries += 1  # the last one is not sent: it is the time for an answer
        asked = outgoing.request(self.system, message_id("AUTOPILOT_VERSION"))
        return [asked] if self._version_tries <= VERSION_TRIES else []

    def _streams(self, heard: Telemetry, now: float) -> list[Message]:
        if not self.pacer.due("streams", RETRY_S, now):
            return []
        messages = self._wanted.ask(heard, self.pacer, now)
        if self.pacer.due("origin", RETRY_S if heard.origin is None else ORIGIN_REFRESH_S, now):
            messages.append(outgoing.request(self.system, message_id("GPS_GLOBAL_ORIGIN")))
        return messages

    def _fly(self, heard: Telemetry, velocity_ned_mps: Vector3, now: float) -> list[Message]:
        """No setpoint for NaN or a monstrous speed: the autopilot's time-out stops the vehicle."""
        most, (north, east, down) = MAX_SETPOINT_MPS, velocity_ned_mps
        usable = -most <= north <= most and -most <= east <= most and -most <= down <= most
        return self.fly(heard, velocity_ned_mps, now) if usable else []

    def _land(self, heard: Telemetry, now: float) -> list[Message]:
        """The landing mode, with zero velocity until it is reached; disarm a vehicle that stays
        armed on the ground."""
        mode = self.mode(heard)
        if not heard.armed or self.left(mode, self.landing_mode):
            return []
        if mode != self.landing_mode:
            due = self.pacer.due("land", RETRY_S, now)
            messages = [self.set_mode(self.landing_mode)] if due else []
            if mode == self.controlled_mode:
                messages.append(outgoing.velocity(self.system, (0.0, 0.0, 0.0), now))
            return messages
        return self._disarm_stuck(heard, now)

    def _see_down(self, heard: Telemetry, now: float) -> list[Message]:
        """A vehicle that a pilot or its own failsafe lands."""
        if not heard.armed or heard.evidence.doubt or self.mode(heard) != self.landing_mode:
            self._grounded_since = None
            return []
        return self._disarm_stuck(heard, now)

    def _disarm_stuck(self, heard: Telemetry, now: float) -> list[Message]:
        """Disarm a vehicle that lands, says that it is on the ground, and stays armed there. It
        refuses where its own land detector knows better."""
        if not heard.on_ground:
            self._grounded_since = None
        elif self._grounded_since is None:
            self._grounded_since = now
        elif now - self._grounded_since >= GROUNDED_S and self.pacer.due("disarm", RETRY_S, now):
            return [outgoing.command(self.system, outgoing.ARM_DISARM, 0.0)]
        return []

    def _terminate(self, heard: Telemetry, now: float) -> list[Message]:
        """Disarm, in the air too, until HEARTBEAT says disarmed."""
        if not heard.armed or not self.pacer.due("terminate", KILL_RETRY_S, now):
            return []
        return [outgoing.command(self.system, outgoing.ARM_DISARM, 0.0, outgoing.FORCE)]


def _not_passed(heard: Telemetry) -> str:
    bad = heard.sensors_present & heard.sensors_enabled & ~heard.sensors_health
    names = [name for bit, name in _SENSORS.items() if bad & bit]
    return f"pre-arm checks not passed{': ' if names else ''}{', '.join(names)}"


def _enum_name(enum: str, number: int) -> str:
    entry = dialect.enums[enum].get(number)
    name = entry.name.removeprefix(enum + "_").lower() if entry else "unknown"
    return f"{name} ({number})"


_NO_STREAMS: Final = frozenset(
    map(
        message_id,
        (
            "AUTOPILOT_VERSION",
            "COMMAND_ACK",
            "GPS_GLOBAL_ORIGIN",
            "HEARTBEAT",
            "PARAM_VALUE",
            "STATUSTEXT",
            "TIMESYNC",
        ),
    )
)
"""Needed, and sent on request or by themselves."""
_STOPS_AT_ONCE: Final = 4
"""Requests a second of one vehicle that end a stream."""


class Streams:
    """Of one vehicle. `hz` has each message that is wanted, with its rate.

    With another `hz` than `STREAMS_HZ` the link is narrow: then what is not wanted, or comes far
    too often, is asked to stop. A vehicle's own streams as delivered would fill a shared radio.
    """

    def __init__(self, system: int, hz: Mapping[str, float], more_hz: Mapping[str, float]) -> None:
        self._system = system
        self._hz = {message_id(name): rate for name, rate in {**more_hz, **hz}.items()}
        self._silent = frozenset(map(message_id, MAY_BE_SILENT))
        self._narrow = hz is not STREAMS_HZ
        self._counts: dict[int, int] = {}

    def ask(self, heard: Telemetry, pacer: Pacer, now: float) -> list[Message]:
        """To be called each `RETRY_S`: ask for the streams of which less than half has come,
        because another ground station may have slowed them."""
        before, self._counts = self._counts, dict(heard.counts)
        came = {number: count - before.get(number, 0) for number, count in self._counts.items()}
        wanted = [*self._wanted(came, pacer, now)]
        return wanted + [*self._unwanted(came, pacer, now)][:_STOPS_AT_ONCE]

    def _wanted(self, came: Mapping[int, int], pacer: Pacer, now: float) -> Iterator[Message]:
        for number, rate_hz in self._hz.items():
            quiet = number in self._silent or rate_hz <= SLOW_HZ
            least = 1 if quiet else 0.5 * rate_hz * RETRY_S
            count = came.get(number, 0)
            wrong = count < least or (self._narrow and count > 2 * rate_hz * RETRY_S + 1)
            if wrong and pacer.due(f"stream {number}", QUIET_RETRY_S if quiet else RETRY_S, now):
                yield outgoing.interval(self._system, number, rate_hz)

    def _unwanted(self, came: Mapping[int, int], pacer: Pacer, now: float) -> Iterator[Message]:
        others = came.keys() - self._hz.keys() - _NO_STREAMS if self._narrow else set()
        for number in sorted(others, key=lambda each: -came[each]):
            if came[number] and not pacer.recent(f"stop {number}", QUIET_RETRY_S, now):
                pacer.due(f"stop {number}", QUIET_RETRY_S, now)
                yield outgoing.no_stream(self._system, number)
