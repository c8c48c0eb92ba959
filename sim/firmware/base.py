"""What both personas share: one autopilot's state, its time, and how it speaks. Pure: no socket,
clock or pymavlink.

A firmware is told of messages (`handle`) and of time (`run`), both with what its sensors say; it
answers through `outbox` and by `demand`. What every MAVLink vehicle serves is in `services.py` and
`commands.py`; behaviour that differs between the real firmwares is in `ardupilot.py` and `px4.py`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from sim.firmware.flying.battery import Battery
from sim.firmware.flying.maneuvers import Demand, Ground, Maneuver, Sensed, Style
from sim.firmware.flying.mission_flight import Course
from sim.firmware.flying.setpoint import Setpoint
from sim.firmware.message import MAV_TYPE_GCS, Landed, Message, Result, Severity
from sim.firmware.protocol import missions
from sim.firmware.protocol.commands import Command, Handler
from sim.firmware.protocol.mission_lists import Item, Plans, remind
from sim.firmware.protocol.parameters import Parameters
from sim.firmware.protocol.services import HANDLERS, sane
from sim.firmware.protocol.streams import Streams, next_on_grid
from sim.firmware.protocol.telemetry import BUILDERS
from sim.physics.geodesy import TangentPlane, Vector3

Contact = tuple[int, Vector3, Vector3]
"""Address, position and velocity (NED) of an aircraft in sensing range."""

TICK_S = 0.1
"""Failsafes, mode logic and landing detection run this often."""
_PARAMETERS_PER_TICK = 25
_BATTERY_S = 0.5
"""The battery is looked at this often."""
_TEXT = 50
"""Characters in one STATUSTEXT."""


@dataclass(frozen=True)
class Setup:
    """What one simulated autopilot is built with."""

    sysid: int
    plane: TangentPlane
    """The simulator's common frame, in which `Sensed` is."""
    start: Sensed
    local_origin_ned_m: Vector3
    """Where the vehicle's own local frame has its zero."""
    ready_after_s: float
    traffic: Callable[[], Iterable[Contact]]


class Outgoing(NamedTuple):
    """A message to send: to every client, or only to the one that asked."""

    message: Message
    private: bool


class Firmware(ABC):
    """One autopilot. All times are mission seconds."""

    autopilot: ClassVar[int]
    """MAV_AUTOPILOT."""
    version: ClassVar[int]
    capabilities: ClassVar[int]
    boot_streams: ClassVar[Mapping[str, float]]
    """Intervals [s] of what is streamed unasked."""
    commands: ClassVar[Mapping[int, Handler]]
    force_arm_magic: ClassVar[float]
    arm_nonsense: ClassVar[Result | None]
    """The answer to arming with a first parameter that is neither 0 nor 1."""
    asks_in_kind: ClassVar[bool]
    """It asks for mission items by MISSION_REQUEST_INT once the client has shown that it knows
    it."""
    first_index: ClassVar[int]
    """Index of the first mission item that is flown."""
    refusal: ClassVar[Result]
    """How it says no to what it knows but won't do now."""

    def __init__(self, setup: Setup, parameters: Parameters, boot_s: float) -> None:
        self.sysid = setup.sysid
        self.plane = setup.plane
        self.traffic = setup.traffic
        self.local_origin_ned = setup.local_origin_ned_m
        self.parameters = parameters
        self.outbox: list[Outgoing] = []
        self.ignored = 0
        """Messages that were not for us, not known, or made no sense."""
        self.plans = Plans()
        self.mission_complete = False
        self._ready_after_s = setup.ready_after_s
        self.start(setup.start, boot_s)

    def start(self, sensed: Sensed, boot_s: float) -> None:
        """Everything a (re)boot at `boot_s` makes fresh; before that time the firmware is dead."""
        self.boot_s = boot_s
        self.now = boot_s
        self.sensed = sensed
        self.armed = False
        self.failsafe = False
        self.home_ned = sensed.position_ned_m
        self.speed_mps: float | None = None
        """DO_CHANGE_SPEED's, in place of the parameter's."""
        self.gcs_heartbeat_s: float | None = None
        self.armed_s = -math.inf
        self.landed_s: float | None = boot_s
        """Since when the vehicle stands on the ground; None in the air."""
        self._style: tuple[int, float | None, Style] | None = None
        self.booted()
        self.battery = Battery(max(1.0, self.battery_capacity_mah()))
        self.maneuver: Maneuver = Ground()
        self.demand: Demand = self.maneuver.demand(boot_s, sensed, self.style())
        self.pending_parameters: deque[str] = deque()
        self.streams = Streams()
        for name, interval_s in self.boot_streams.items():
            self.streams.set(name, interval_s, boot_s)
        self._tick_s = boot_s
        self._was_ready = False
        self._low = False
        self._battery_s = boot_s

    # --- the persona's part ---

    @abstractmethod
    def booted(self) -> None:
        """Sets the mode a vehicle starts in."""

    @abstractmethod
    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode."""

    @abstractmethod
    def mode_flags(self) -> int:
        """HEARTBEAT.base_mode beside custom and armed."""

    @abstractmethod
    def style(self) -> Style:
        """How it flies by itself, from the parameters."""

    @abstractmethod
    def battery_capacity_mah(self) -> float:
        """From the parameters."""

    @abstractmethod
    def battery_low(self) -> bool:
        """Below the failsafe's threshold."""

    @abstractmethod
    def on_battery_low(self) -> None:
        """The failsafe of a low battery."""

    @abstractmethod
    def addressed(self, command: Command, /) -> bool:
        """Whether a command with these targets is answered."""

    @abstractmethod
    def arm(self, *, force: bool) -> Result:
        """Arms, or says why not."""

    @abstractmethod
    def disarm(self, *, force: bool) -> Result:
        """Disarms, or says why not."""

    @abstractmethod
    def set_mode(self, base_mode: int, custom_mode: int) -> Result:
        """A mode asked for by SET_MODE."""

    @abstractmethod
    def go_to(self, place_ned: Vector3) -> Result:
        """Flies to a point and stays, in the air and armed."""

    @abstractmethod
    def course(
        self,
        place: Callable[[Item], Vector3],
        reached: Callable[[int], None],
        set_speed: Callable[[float], None],
    ) -> Course:
        """How missions are flown, from the parameters."""

    @abstractmethod
    def mission_lost(self) -> None:
        """The mission that is being flown was cleared."""

    def first_item(self, item: Item | None) -> Item | None:
        """What is told as the first mission item, for the one uploaded."""
        return item

    def guided_item(self, _item: Item) -> bool | None:
        """A mission item outside any upload, to be flown at once: whether it is; None: not
        answered."""
        return None

    @abstractmethod
    def on_setpoint(self, setpoint: Setpoint) -> None:
        """A readable SET_POSITION_TARGET_LOCAL_NED."""

    @abstractmethod
    def housekeeping(self) -> None:
        """Failsafes, landing, ends of maneuvers; every `TICK_S`."""

    def data_stream(self, stream: int, interval_s: float | None) -> None:  # noqa: B027 - PX4 has none
        """REQUEST_DATA_STREAM."""

    def is_gcs(self, _system: int, kind: int) -> bool:
        """Whether a heartbeat of this system and MAV_TYPE is a ground station's."""
        return kind == MAV_TYPE_GCS

    def gcs_heartbeat(self) -> None:
        """A ground station was heard."""
        self.gcs_heartbeat_s = self.now

    # --- time and messages ---

    @property
    def due_s(self) -> float:
        """When `run` has something to do next."""
        return min(self._tick_s, self.streams.next_s)

    def run(self, now: float, sensed: Sensed) -> None:
        """Does what is due at `now`."""
        if now < self.boot_s:
            return
        self.now, self.sensed = now, sensed
        if now + 1e-6 >= self._tick_s:  # a sum of steps, and a multiple
            self._tick_s = next_on_grid(now, TICK_S)
            self._tick()
        for name in self.streams.take_due(now):
            for fields in BUILDERS[name](self):
                self.say(name, fields)

    def handle(self, message: Message, now: float, sensed: Sensed) -> None:
        """Acts on a received message; what is not for us or makes no sense is counted in
        `ignored`."""
        handler = HANDLERS.get(message.name)
        target = message.fields.get("target_system", 0)
        if (
            handler is None
            or now < self.boot_s
            or target not in (0, self.sysid)
            or not sane(message)
        ):
            self.ignored += 1
            return
        self.now, self.sensed = now, sensed
        handler(self, message)

    def _tick(self) -> None:
        if not self.sensed.landed:
            self.landed_s = None
        elif self.landed_s is None:
            self.landed_s = self.now
        if self.now >= self._battery_s:
            self._battery_s = self.now + _BATTERY_S - TICK_S / 2
            self._watch_battery()
        if self.ready() and not self._was_ready:
            self._was_ready = True
            for name in ("GPS_GLOBAL_ORIGIN", "HOME_POSITION"):
                self.say(name, BUILDERS[name](self)[0])
        remind(self)
        self.housekeeping()
        self.update_demand()
        missions.keep_up(self)
        for _ in range(min(_PARAMETERS_PER_TICK, len(self.pending_parameters))):
            self.say(
                "PARAM_VALUE", self.parameters.value_message(self.pending_parameters.popleft())
            )

    def _watch_battery(self) -> None:
        p = self.parameters
        self.battery.failed = p["SIM_BATT_FAIL"] == 1.0
        self.battery.drain(
            _BATTERY_S, flying=not self.sensed.landed, factor=max(0.0, p["SIM_BATT_DRAIN"])
        )
        low = self.battery_low()
        if low and not self._low:
            self.on_battery_low()
        self._low = low

    def crashed(self) -> None:
        """It fell to the ground."""
        self.text(Severity.EMERGENCY, "Crash: Disarming")
        if self.armed:
            self.set_disarmed("Disarming motors")

    # --- motion ---

    def begin(self, maneuver: Maneuver) -> None:
        """From now on does this."""
        self.maneuver = maneuver
        self.update_demand()

    def update_demand(self) -> None:
        """The maneuver's demand now; nothing lifts while disarmed."""
        maneuver = self.maneuver if self.armed else Ground()
        demand = maneuver.demand(self.now, self.sensed, self.current_style())
        if demand != self.demand:
            self.demand = demand

    def current_style(self) -> Style:
        """`style`, worked out again only after a change."""
        known = self._style
        if known is None or known[0] != self.parameters.version or known[1] != self.speed_mps:
            self._style = known = (self.parameters.version, self.speed_mps, self.style())
        return known[2]

    def set_armed(self) -> None:
        """Motors run; home is here."""
        self.armed = True
        self.armed_s = self.now
        self.home_ned = self.sensed.position_ned_m

    def set_disarmed(self, text: str) -> None:
        """Motors stop."""
        self.armed = False
        self.failsafe = False
        self.begin(Ground())
        self.text(Severity.INFO, text)

    # --- missions ---

    def mission_changed(self) -> None:
        """The mission list was replaced."""
        missions.changed(self)

    def go_on_at(self, index: int) -> bool:
        """The mission item to fly next."""
        return missions.go_on_at(self, index)

    def say_current(self) -> None:
        """MISSION_CURRENT, now."""
        missions.say_current(self)

    def mission_current(self) -> dict[str, Any]:
        """MISSION_CURRENT's fields."""
        return missions.current_fields(self)

    # --- facts ---

    def ready(self) -> bool:
        """Position estimate and pre-arm checks are good."""
        return (
            self.now - self.boot_s >= self._ready_after_s and self.parameters["SIM_GPS_OFF"] != 1.0
        )

    def fix(self) -> bool:
        """GPS has a position."""
        return (
            self.now - self.boot_s >= 0.5 * self._ready_after_s
            and self.parameters["SIM_GPS_OFF"] != 1.0
        )

    def armable(self) -> bool:
        """Pre-arm checks are good."""
        return self.ready() and self.parameters["SIM_ARM_REFUSE"] != 1.0 and not self._low

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

    def landed_state(self) -> Landed:
        """EXTENDED_SYS_STATE.landed_state."""
        if self.sensed.landed:
            return Landed.ON_GROUND
        return (
            self.maneuver.landed_state if self.armed and not self.maneuver.done else Landed.IN_AIR
        )

    # --- speaking ---

    def say(self, name: str, fields: dict[str, Any], *, private: bool = False) -> None:
        """Queues a message for everybody, or only for who asked."""
        self.outbox.append(Outgoing(Message(name, fields), private))

    def text(self, severity: Severity, text: str) -> None:
        """STATUSTEXT; longer ones in chunks of 50 characters."""
        chunks = [text[i : i + _TEXT] for i in range(0, len(text), _TEXT)]
        for i, chunk in enumerate(chunks):
            ident = {"id": 1 if len(chunks) > 1 else 0, "chunk_seq": i}
            self.say("STATUSTEXT", {"severity": int(severity), "text": chunk.encode()} | ident)

    def acknowledge(self, command: int, result: Result, to: tuple[int, int]) -> None:
        """COMMAND_ACK to who asked."""
        fields = {
            "command": command,
            "result": int(result),
            "target_system": to[0],
            "target_component": to[1],
        }
        self.say("COMMAND_ACK", fields, private=True)
