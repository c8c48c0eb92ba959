"""One simulated autopilot: its state, the facts that follow from it, and how it speaks. Pure: no
socket, clock or pymavlink.

The persona's part (abstract here) is in `ardupilot_persona.py` and `px4_persona.py`. What every
MAVLink vehicle serves is in `protocol/`, whose functions act on a `SimAutopilot`; `firmware.py`
gives it time and messages. It answers through `outbox` and by `demand`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

from swarm_sim.firmware.flying.maneuvers import (
    Demand,
    FlightStyle,
    GroundManeuver,
    Maneuver,
    ReturnManeuver,
    Sensed,
    TakeoffManeuver,
    VelocityManeuver,
)
from swarm_sim.firmware.flying.mission_items import FENCE, MissionItem, MissionLists
from swarm_sim.firmware.flying.position_target import Axes, PositionTarget, moved
from swarm_sim.firmware.message import (
    MAV_TYPE_GCS,
    LandedState,
    MavCommand,
    MavResult,
    MavSeverity,
    Message,
)
from swarm_sim.firmware.parameters import SIM_DEFAULTS, Encoding, Parameters, TypedValue
from swarm_sim.firmware.streams import Streams
from swarm_sim.physics.geodesy import GeodeticPoint, TangentPlane, Vector3

Contact = tuple[int, Vector3, Vector3]
"""Address, position and velocity (NED) of an aircraft in sensing range."""
CommandHandler = Callable[[Any, MavCommand], MavResult | None]
"""From the autopilot and a command to the answer; None: no answer, or it has been given already."""

MAX_SPEED_MPS = 20.0
_TEXT = 50
"""Characters in one STATUSTEXT."""


@dataclass(frozen=True, slots=True)
class FlightMode:
    """A row of a persona's mode table."""

    custom: int
    """HEARTBEAT.custom_mode."""
    name: str
    armable: bool = False
    """Arming by a ground station is allowed in it."""
    guided: bool = False
    """HEARTBEAT tells MAV_MODE_FLAG_GUIDED. A PX4 needs a pilot's sticks in all other modes."""
    positioned: bool = False
    """Needs a position estimate (ArduCopter)."""
    standard: int = 0
    """MAV_STANDARD_MODE, 0 for none."""
    shown: str = ""
    """Its name in AVAILABLE_MODES; '' for `name`."""
    advanced: bool = False
    """Its users are to know what they do (AVAILABLE_MODES)."""


@dataclass(frozen=True)
class AutopilotSetup:
    """What one simulated autopilot is built with."""

    sysid: int
    plane: TangentPlane
    """The simulator's common frame, in which `Sensed` is."""
    start: Sensed
    local_origin_ned_m: Vector3
    """Where the vehicle's own local frame has its zero."""
    ready_after_s: float
    traffic: Callable[[], Iterable[Contact]]
    channels: int = 1
    """MAVLink ports; each has streams of its own, as on real autopilots."""


class Outgoing(NamedTuple):
    """A message to send: to every client, or only to the one that asked."""

    message: Message
    private: bool
    channel: int | None
    """The port that it leaves by; None: by all."""


class SimAutopilot(ABC):
    """One autopilot. All times are mission seconds."""

    autopilot: ClassVar[int]
    """MAV_AUTOPILOT."""
    version: ClassVar[int]
    capabilities: ClassVar[int]
    defaults: ClassVar[Mapping[str, TypedValue]]
    encoding: ClassVar[Encoding]
    sysid_parameter: ClassVar[str]
    capacity_parameter: ClassVar[str]
    """Of the battery [mAh]."""
    modes: ClassVar[Mapping[int, FlightMode]]
    """By HEARTBEAT.custom_mode."""
    pilot_modes: ClassVar[Mapping[str, FlightMode]]
    """Where a pilot's switch puts it: hold, land, return, manual."""
    boot_mode: ClassVar[FlightMode]
    boot_streams: ClassVar[Mapping[str, float]]
    """Intervals [s] of what is streamed unasked."""
    commands: ClassVar[Mapping[int, CommandHandler]]
    fence_bit: ClassVar[int]
    """MAV_SYS_STATUS_GEOFENCE where SYS_STATUS tells a fence that is there, healthy and off; 0: it
    tells of none, as a PX4 does, and MAVProxy calls that a breach."""
    force_arm_magic: ClassVar[float]
    arm_nonsense: ClassVar[MavResult | None]
    """The answer to arming with a first parameter that is neither 0 nor 1."""
    disarmed_text: ClassVar[str] = "Disarming motors"
    disarm_denied_text: ClassVar[str] = ""
    mission_services: ClassVar[Mapping[str, Callable[[Any, Message], None]]]
    """Messages of the mission protocol."""
    merely_answered: ClassVar[Mapping[int, MavResult | None]]
    """MAV_CMDs of things that are not simulated, and that a station asks for all the same; None:
    no answer."""
    promised_messages: ClassVar[frozenset[float]]
    """Numbers of messages of which REQUEST_MESSAGE is accepted, and that do not come."""
    unknown_message: ClassVar[MavResult]
    unknown_interval: ClassVar[MavResult]
    """The answers to REQUEST_MESSAGE and SET_MESSAGE_INTERVAL of a message that it doesn't have."""
    zero_is_here: ClassVar[bool]
    """DO_SET_HOME takes latitude 0, longitude 0 as no place, not as one in the Atlantic."""
    bad_number: ClassVar[MavResult]
    """The answer to a speed or place that is none."""
    first_index: ClassVar[int]
    """Index of the first mission item that is flown."""
    land_detect_s: ClassVar[float]
    """From a touch-down until the land detector says so."""
    own_faults: ClassVar[Mapping[str, TypedValue]] = {}
    """SIM_* parameters with another default than in `SIM_DEFAULTS`: the errors of its estimator."""
    refusal: ClassVar[MavResult]
    """The answer to a known command that can't be done now."""

    def __init__(self, setup: AutopilotSetup, boot_s: float) -> None:
        self.sysid = setup.sysid
        self.plane = setup.plane
        self.traffic = setup.traffic
        self.local_origin_ned = setup.local_origin_ned_m
        defaults = {**self.defaults, **SIM_DEFAULTS, **self.own_faults}
        self.parameters = Parameters(defaults, self.encoding)
        self.parameters.set(self.sysid_parameter, setup.sysid)
        self.outbox: list[Outgoing] = []
        self.asked_on: int | None = None
        """The channel of the message that is being handled; None between messages."""
        self._heard_on = {0}
        self.channel_streams = [Streams() for _ in range(setup.channels)]
        self.ignored = 0
        """Messages for another vehicle, not known, or without sense."""
        self.missions = MissionLists()
        self._fence: tuple[list[MissionItem], Geofence] | None = None
        """What was sent, and what it forbids."""
        self._beyond = False
        """It is there."""
        self._ready_after_s = setup.ready_after_s
        self.start(setup.start, boot_s)

    def start(self, sensed: Sensed, boot_s: float) -> None:
        """Everything a (re)boot at `boot_s` makes fresh; before that time the firmware is dead."""
        self.boot_s = self.now = self.tick_s = self.battery_s = boot_s
        self.sensed = sensed
        self.mode = self.boot_mode
        self.armed = self.failsafe = self.told_ready = self.low_battery = False
        self.home_ned = sensed.position_ned_m
        self.speed_mps: float | None = None
        """DO_CHANGE_SPEED's, in place of the parameter's."""
        self.gcs_heartbeat_s: float | None = None
        self.armed_s = -math.inf
        self.landed_s: float | None = -math.inf
        """Since when the vehicle stands on the ground; None in the air."""
        self.gps_jump = GpsJump(self.parameters)
        self._style: tuple[int, float | None, FlightStyle] | None = None
        self.battery = Battery(max(1.0, self.parameters[self.capacity_parameter]))
        self.maneuver: Maneuver = GroundManeuver()
        self.demand: Demand = self.maneuver.demand(boot_s, sensed, self.style())
        self.pending_parameters: deque[tuple[int, str]] = deque()
        """Channel and name of those that a client has asked for."""
        for channel in range(len(self.channel_streams)):
            self._start_streams(channel)

    @property
    def streams(self) -> Streams:
        """Of the channel on which the client asked."""
        return self.channel_streams[self.asked_on or 0]

    def hear(self, channel: int) -> None:
        """A client is there: the channel's streams begin. Until then a further channel sends its
        HEARTBEAT alone."""
        if channel not in self._heard_on:
            self._heard_on.add(channel)
            self._start_streams(channel)

    def _start_streams(self, channel: int) -> None:
        streams = self.channel_streams[channel] = Streams()
        for name, interval_s in self.boot_streams.items():
            if channel in self._heard_on or name == "HEARTBEAT":
                streams.set(name, interval_s, max(self.now, self.boot_s))

    # --- the persona's part ---

    @abstractmethod
    def style_by_parameters(self) -> FlightStyle:
        """How it flies by itself, from the parameters."""

    @abstractmethod
    def battery_low(self) -> bool:
        """Below the failsafe's threshold."""

    @abstractmethod
    def on_battery_low(self) -> None:
        """The failsafe of a low battery."""

    @abstractmethod
    def arm(self, *, force: bool) -> MavResult:
        """Arms, or says why not."""

    @abstractmethod
    def set_mode(self, base_mode: int, custom_mode: int) -> MavResult:
        """A mode asked for by SET_MODE."""

    @abstractmethod
    def enter(self, mode: FlightMode) -> MavResult:
        """Changes the mode, or says why not."""

    @abstractmethod
    def go_to(self, place_ned: Vector3) -> MavResult:
        """Flies to a point and stays, in the air and armed."""

    @abstractmethod
    def keep_transfer_going(self) -> None:
        """Asks again for a mission item that doesn't come, and gives up in the end; every tick."""

    @abstractmethod
    def mission_lost(self) -> None:
        """The mission that is being flown was cleared."""

    @abstractmethod
    def on_position_target(self, target: PositionTarget) -> None:
        """A readable setpoint."""

    @abstractmethod
    def housekeeping(self) -> None:
        """Failsafes, landing, ends of maneuvers; every tick, while armed."""

    def addressed(self, _command: MavCommand) -> bool:
        """Whether a command with this target is answered."""
        return True

    @abstractmethod
    def known_item(self, command: int, frame: int) -> bool:
        """Whether a mission may have this MAV_CMD in this MAV_FRAME."""

    def first_item(self, item: MissionItem | None) -> MissionItem | None:
        """What is told as the first mission item, for the one uploaded."""
        return item

    def guided_item(self, _item: MissionItem) -> bool | None:
        """Whether an item outside any upload is flown at once; None: no answer."""
        return None

    def data_stream(self, stream: int, interval_s: float | None) -> None:  # noqa: B027 - PX4 has none
        """REQUEST_DATA_STREAM."""

    def is_gcs(self, _system: int, kind: int) -> bool:
        """Whether a heartbeat of this system and MAV_TYPE is a ground station's."""
        return kind == MAV_TYPE_GCS

    def gcs_heartbeat(self) -> None:
        """A ground station was heard."""
        self.gcs_heartbeat_s = self.now

    # --- motion ---

    def begin(self, maneuver: Maneuver) -> None:
        """From now on does this."""
        self.maneuver = maneuver
        self.update_demand()

    def update_demand(self) -> None:
        """The maneuver's demand now; nothing lifts while disarmed."""
        maneuver = self.maneuver if self.armed else GroundManeuver()
        demand = self.limited(maneuver.demand(self.now, self.sensed, self.style()))
        if demand != self.demand:
            self.demand = demand

    def limited(self, demand: Demand) -> Demand:
        """What the persona's controller allows of a demand."""
        return demand

    def style(self) -> FlightStyle:
        """How it flies by itself; worked out again only after a change."""
        known = self._style
        if known is None or known[0] != self.parameters.version or known[1] != self.speed_mps:
            style = self.style_by_parameters()
            if self.speed_mps is not None:
                style = replace(style, speed_mps=self.speed_mps)
            self._style = known = (self.parameters.version, self.speed_mps, style)
        return known[2]

    def set_speed(self, speed_mps: float) -> None:
        """The speed at which it flies by itself."""
        self.speed_mps = min(speed_mps, MAX_SPEED_MPS)

    def set_armed(self) -> None:
        """Motors run; home is here."""
        self.armed = True
        self.armed_s = self.now
        self.home_ned = self.sensed.position_ned_m

    def disarm(self, *, force: bool) -> MavResult:
        """Disarms on the ground, or if forced."""
        if self.sensed.landed or force:
            self.set_disarmed(self.disarmed_text)
            return MavResult.ACCEPTED
        if self.disarm_denied_text:
            self.text(MavSeverity.CRITICAL, self.disarm_denied_text)
        return self.refusal

    def fence_breached(self) -> bool:
        """The vehicle flies where the fence that it was sent forbids it; told once, until it is
        back."""
        items = self.missions.lists[FENCE]
        if not items or not self.armed or self.sensed.landed:
            self._beyond = False
            return False
        if self._fence is None or self._fence[0] is not items:
            self._fence = items, Geofence(items, self._place)
        before, north_east = self._beyond, self.sensed.position_ned_m[:2]
        self._beyond = self._fence[1].breached(north_east)
        return self._beyond and not before

    def _place(self, item: MissionItem) -> tuple[float, float]:
        return self.ned(item.x * 1e-7, item.y * 1e-7, 0.0, above_home=True)[:2]

    def set_disarmed(self, text: str) -> None:
        """Motors stop."""
        self.armed = False
        self.failsafe = False
        self.begin(GroundManeuver())
        self.text(MavSeverity.INFO, text)

    def follow(self, target: PositionTarget, position: Axes, velocity: Axes) -> None:
        """Flies by a setpoint's yaw and by these of its axes; one without a velocity gets 0."""
        yaw = self.demand.heading_rad if target.yaw_rad is None else target.yaw_rad
        n, e, d = velocity
        held = moved(position, self.local_origin_ned)
        rate = target.yaw_rate_radps or 0.0
        forward = (n or 0.0, e or 0.0, d or 0.0)
        self.begin(VelocityManeuver(forward, yaw, held, rate, self.now))

    def return_home(self) -> ReturnManeuver:
        """The way home from here."""
        style = self.style()
        return ReturnManeuver(
            self.sensed, self.home_ned, style.return_height_m, style.return_wait_s
        )

    def take_off(self, down_m: float) -> TakeoffManeuver:
        """Up to there from here. One that is under way goes on: an order that comes again does not
        spool up again."""
        before, began_s = self.maneuver, self.now
        if isinstance(before, TakeoffManeuver) and before.began_s >= self.armed_s:
            began_s = before.began_s
        return TakeoffManeuver(self.sensed, down_m, began_s, self.style().takeoff_mps)

    def crashed(self) -> None:
        """It fell to the ground."""
        self.text(MavSeverity.EMERGENCY, "Crash: Disarming")
        if self.armed:
            self.set_disarmed("Disarming motors")

    # --- facts ---

    def ready(self) -> bool:
        """Position estimate and pre-arm checks are good."""
        return self._has_position(self._ready_after_s)

    def fix(self) -> bool:
        """GPS has a position, which takes half as long."""
        return self._has_position(0.5 * self._ready_after_s)

    def _has_position(self, after_s: float) -> bool:
        return self.now - self.boot_s >= after_s and self.parameters["SIM_GPS_OFF"] != 1.0

    def armable(self) -> bool:
        """Pre-arm checks are good."""
        healthy = self.parameters["SIM_ARM_REFUSE"] != 1.0 and not self.low_battery
        return healthy and self.ready()

    def standing_s(self) -> float:
        """For how long it has stood on the ground; 0 in the air."""
        return 0.0 if self.landed_s is None else self.now - self.landed_s

    def boot_ms(self) -> int:
        """Milliseconds since boot."""
        return round((self.now - self.boot_s) * 1000) & 0xFFFFFFFF

    def local_position(self) -> Vector3:
        """Position in the vehicle's own local frame."""
        n, e, d = self.sensed.position_ned_m
        on, oe, od = self.local_origin_ned
        return n - on, e - oe, d - od

    def geodetic(self, ned_m: Vector3 | None = None) -> GeodeticPoint:
        """A point (here, if not given) on the ellipsoid."""
        return self.plane.geodetic_from_ned(self.sensed.position_ned_m if ned_m is None else ned_m)

    def ned(self, lat_deg: float, lon_deg: float, alt_m: float, *, above_home: bool) -> Vector3:
        """NED of a point on the ellipsoid; its height is above sea level, or above home."""
        if above_home:
            alt_m += self.geodetic(self.home_ned).alt_m
        return self.plane.ned_from_geodetic(GeodeticPoint(lat_deg, lon_deg, alt_m))

    def landed_state(self) -> LandedState:
        """EXTENDED_SYS_STATE.landed_state. After a touch-down the land detector takes its time."""
        sure = not self.armed or self.standing_s() >= self.land_detect_s
        if self.sensed.landed and sure:
            return LandedState.ON_GROUND
        flies = self.armed and not self.maneuver.done
        return self.maneuver.landed_state if flies else LandedState.IN_AIR

    # --- speaking ---

    def say(
        self,
        name: str,
        fields: dict[str, Any],
        *,
        private: bool = False,
        channel: int | None = None,
    ) -> None:
        """Queues a message for every client, those of one channel, or the one that asked."""
        to = self.asked_on if private else channel
        self.outbox.append(Outgoing(Message(name, fields), private, to))

    def text(self, severity: MavSeverity, text: str) -> None:
        """STATUSTEXT; longer ones in chunks of 50 characters."""
        chunks = [text[i : i + _TEXT] for i in range(0, len(text), _TEXT)]
        for i, chunk in enumerate(chunks):
            ident = {"id": 1 if len(chunks) > 1 else 0, "chunk_seq": i}
            self.say("STATUSTEXT", {"severity": int(severity), "text": chunk.encode()} | ident)

    def acknowledge(self, command: int, result: MavResult, to: tuple[int, int]) -> None:
        """COMMAND_ACK to the client that asked."""
        target = {"target_system": to[0], "target_component": to[1]}
        self.say("COMMAND_ACK", {"command": command, "result": int(result)} | target, private=True)


_FULL_V, _EMPTY_V = 12.6, 10.5
_FAILED_V = 9.0
_IDLE_A, _FLYING_A = 0.5, 9.0


@dataclass(slots=True)
class Battery:
    """A three-cell pack; voltage falls linearly with the charge used."""

    capacity_mah: float
    used_mah: float = 0.0
    current_a: float = _IDLE_A
    failed: bool = False

    @property
    def voltage_v(self) -> float:
        """Voltage under load."""
        if self.failed:
            return _FAILED_V
        left = max(0.0, 1.0 - self.used_mah / self.capacity_mah)
        return _EMPTY_V + (_FULL_V - _EMPTY_V) * left

    def percent(self) -> int:
        """Charge left, 0..100."""
        if self.failed:
            return 0
        return max(0, min(100, round(100.0 * (1.0 - self.used_mah / self.capacity_mah))))

    @property
    def left_mah(self) -> float:
        """Charge left."""
        return 0.0 if self.failed else max(0.0, self.capacity_mah - self.used_mah)

    def drain(self, dt: float, *, flying: bool, factor: float = 1.0) -> None:
        """Takes what `dt` seconds cost."""
        self.current_a = (_FLYING_A if flying else _IDLE_A) * factor
        self.used_mah += self.current_a * dt / 3.6


_INSIDE, _OUTSIDE, _CIRCLE_INSIDE, _CIRCLE_OUTSIDE = 5001, 5002, 5003, 5004
Place = tuple[float, float]


class Geofence:
    """Which places a vehicle's fence forbids; `place` gives (north, east) [m] of an item."""

    def __init__(self, items: Sequence[MissionItem], place: Callable[[MissionItem], Place]) -> None:
        self._polygons: list[tuple[bool, list[Place]]] = []
        self._circles: list[tuple[bool, Place, float]] = []
        k = 0
        while k < len(items):
            item = items[k]
            if item.command in (_INSIDE, _OUTSIDE):
                count = max(1, round(item.p[0]))
                corners = [place(each) for each in items[k : k + count]]
                self._polygons.append((item.command == _INSIDE, corners))
                k += count
                continue
            if item.command in (_CIRCLE_INSIDE, _CIRCLE_OUTSIDE):
                inside = item.command == _CIRCLE_INSIDE
                self._circles.append((inside, place(item), item.p[0]))
            k += 1

    def breached(self, at: Place) -> bool:
        """It is out of an area to stay inside of, or in one to keep out of."""
        polygons = (_within(corners, at) is not inside for inside, corners in self._polygons)
        circles = ((math.dist(at, c) < r) is not inside for inside, c, r in self._circles)
        return any(polygons) or any(circles)


def _within(corners: Sequence[Place], at: Place) -> bool:
    north, east = at
    odd = False
    for (n1, e1), (n2, e2) in zip(corners, (*corners[1:], corners[0]), strict=True):
        if (e1 > east) != (e2 > east) and north < n1 + (east - e1) / (e2 - e1) * (n2 - n1):
            odd = not odd
    return odd


RATIO_PER_M = 0.265
"""Of the horizontal test ratio: over 1 (3.8 m) the estimator refuses the GPS."""
_REFUSES_S, _FLAGGED_S = 7.0, (1.5, 17.0)
"""Until it takes the new place after all; from when until when it flags a glitch."""


class GpsJump:
    """What an estimator says after its GPS has jumped (SIM_GPS_JUMP_*), timed on a real ArduCopter
    4.7 (4.4 m)."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._place = self._read()
        self._since_s, self._ratio = -math.inf, 0.0

    def ratio(self, now: float) -> float:
        """The horizontal position's test ratio; a small jump is taken at once."""
        place = self._read()
        if place != self._place:
            self._since_s, self._ratio = now, RATIO_PER_M * math.dist(place, self._place)
            self._place = place
        lasts_s = _REFUSES_S if self._ratio > 1.0 else 0.5
        return max(0.01, self._ratio) if now - self._since_s < lasts_s else 0.01

    def flagged(self, now: float) -> bool:
        """Whether it says that there is a glitch."""
        return self._ratio > 1.0 and _FLAGGED_S[0] <= now - self._since_s < _FLAGGED_S[1]

    def _read(self) -> Vector3:
        north, east, down = (self._parameters[f"SIM_GPS_JUMP_{axis}"] for axis in "NED")
        return north, east, down
