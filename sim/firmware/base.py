"""What both personas share: the services every MAVLink vehicle offers. Pure: no socket, no clock, no pymavlink.

A firmware is told of messages (`handle`) and of time (`run`), both with what its sensors say; it answers through
`outbox` and by `demand`. Behaviour that differs between the real firmwares is in `ardupilot.py` and `px4.py`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import astuple, dataclass
from typing import Any, ClassVar

from sim.firmware.battery import Battery
from sim.firmware.flight import Demand, Ground, Maneuver, Sensed, Style
from sim.firmware.message import (
    MAV_TYPE_GCS,
    MESSAGE_NAMES,
    Cmd,
    Landed,
    Message,
    Result,
    Severity,
)
from sim.firmware.parameters import Parameters
from sim.firmware.setpoint import Setpoint, read_setpoint
from sim.firmware.streams import Streams
from sim.firmware.telemetry import BUILDERS
from sim.geodesy import Geodetic, TangentPlane, Vector3

Contact = tuple[int, Vector3, Vector3]
"""Address, position and velocity (NED) of an aircraft in sensing range."""

TICK_S = 0.1
"""Failsafes, mode logic and landing detection run this often."""
MAX_RATE_HZ = 400.0
"""The firmwares' main loop: no stream is faster."""
_PARAMETERS_PER_TICK = 25
_NAN_ALLOWED = frozenset({"COMMAND_LONG", "COMMAND_INT", "PARAM_SET", "PARAM_VALUE", "SET_POSITION_TARGET_LOCAL_NED"})


@dataclass(frozen=True)
class Setup:
    """What one simulated autopilot is built with."""

    sysid: int
    plane: TangentPlane
    start: Sensed
    local_origin_ned_m: Vector3
    ready_after_s: float
    traffic: Callable[[], Iterable[Contact]]


@dataclass(frozen=True, slots=True)
class Command:
    """COMMAND_LONG or COMMAND_INT; x and y of the latter already in degrees."""

    id: int
    frame: int
    """MAV_FRAME of the position in p[4:7]."""
    p: tuple[float, float, float, float, float, float, float]
    target: tuple[int, int]
    source: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A message to send: to every client, or only to the one that asked."""

    message: Message
    private: bool


CommandHandler = Callable[[Command], Result | None]
"""None: no answer at all."""


class Firmware(ABC):
    """One autopilot."""

    autopilot: ClassVar[int]
    version: ClassVar[int]
    capabilities: ClassVar[int]
    boot_streams: ClassVar[Mapping[str, float]]
    """Intervals [s] of what is streamed unasked."""
    force_arm_magic: ClassVar[float]
    arm_nonsense: ClassVar[Result | None]
    """The answer to arming with a first parameter that is neither 0 nor 1."""

    def __init__(self, setup: Setup, parameters: Parameters, boot_s: float) -> None:
        self.sysid = setup.sysid
        self.plane = setup.plane
        self.traffic = setup.traffic
        self.local_origin_ned = setup.local_origin_ned_m
        self.parameters = parameters
        self.outbox: list[Outgoing] = []
        self.ignored = 0
        """Messages that were not for us, not known, or made no sense."""
        self._ready_after_s = setup.ready_after_s
        self._handlers: dict[str, Callable[[Message], None]] = {
            "HEARTBEAT": self._on_heartbeat,
            "COMMAND_LONG": self._on_command_long,
            "COMMAND_INT": self._on_command_int,
            "SET_MODE": self._on_set_mode,
            "SET_POSITION_TARGET_LOCAL_NED": self._on_setpoint,
            "PARAM_REQUEST_LIST": self._on_param_list,
            "PARAM_REQUEST_READ": self._on_param_read,
            "PARAM_SET": self._on_param_set,
            "REQUEST_DATA_STREAM": self._on_data_stream,
            "MISSION_REQUEST_LIST": self._on_mission_list,
            "TIMESYNC": self._on_timesync,
        }
        self.commands: dict[int, CommandHandler] = {
            Cmd.COMPONENT_ARM_DISARM: self._arm_command,
            Cmd.SET_MESSAGE_INTERVAL: self._set_message_interval,
            Cmd.REQUEST_MESSAGE: self._request_message,
            Cmd.REQUEST_AUTOPILOT_CAPABILITIES: self._request_version,
            Cmd.GET_HOME_POSITION: self._request_home,
            Cmd.PREFLIGHT_REBOOT_SHUTDOWN: self._reboot_command,
        } | self.persona_commands()
        self._start(setup.start, boot_s)

    def _start(self, sensed: Sensed, boot_s: float) -> None:
        """Everything a (re)boot makes fresh."""
        self.boot_s = boot_s
        self.now = boot_s
        self.sensed = sensed
        self.armed = False
        self.failsafe = False
        self.home_ned = sensed.position_ned_m
        self.booted()
        self.battery = Battery(self.battery_capacity_mah())
        self.maneuver: Maneuver = Ground()
        self.demand: Demand = self.maneuver.demand(boot_s, sensed, self.style())
        self.gcs_heartbeat_s: float | None = None
        self.armed_s = -math.inf
        self.landed_s: float | None = boot_s
        """Since when the vehicle stands on the ground; None in the air."""
        self.streams = Streams()
        for name, interval_s in self.boot_streams.items():
            self.streams.set(name, interval_s, boot_s)
        self._pending_parameters: deque[str] = deque()
        self._tick_s = boot_s
        self._was_ready = False

    # --- the persona's part ---

    @abstractmethod
    def persona_commands(self) -> dict[int, CommandHandler]:
        """Commands beside the common ones."""

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
    def arm(self, *, force: bool) -> Result:
        """Arms, or says why not."""

    @abstractmethod
    def disarm(self, *, force: bool) -> Result:
        """Disarms, or says why not."""

    @abstractmethod
    def set_mode(self, base_mode: int, custom_mode: int) -> Result:
        """A mode asked for by SET_MODE."""

    @abstractmethod
    def on_setpoint(self, setpoint: Setpoint) -> None:
        """A readable SET_POSITION_TARGET_LOCAL_NED."""

    @abstractmethod
    def housekeeping(self) -> None:
        """Failsafes, landing, ends of maneuvers; every `TICK_S`."""

    @abstractmethod
    def addressed(self, command: Command, /) -> bool:
        """Whether a command with these targets is answered."""

    def data_stream(self, stream: int, interval_s: float | None) -> None:  # noqa: B027 - PX4 has none
        """REQUEST_DATA_STREAM."""

    # --- time ---

    @property
    def due_s(self) -> float:
        """When `run` has something to do next."""
        return min(self._tick_s, self.streams.next_s)

    def run(self, now: float, sensed: Sensed) -> None:
        """Does what is due at `now`."""
        self.now, self.sensed = now, sensed
        if now < self.boot_s:
            return
        if now >= self._tick_s:
            self._tick_s = max(self._tick_s + TICK_S, now + TICK_S / 2)
            self._tick()
        for name in self.streams.take_due(now):
            for fields in BUILDERS[name](self):
                self.say(name, fields)

    def _tick(self) -> None:
        if not self.sensed.landed:
            self.landed_s = None
        elif self.landed_s is None:
            self.landed_s = self.now
        self.battery.drain(TICK_S, flying=not self.sensed.landed)
        if self.ready() and not self._was_ready:
            self._was_ready = True
            self.say("GPS_GLOBAL_ORIGIN", BUILDERS["GPS_GLOBAL_ORIGIN"](self)[0])
            self.say("HOME_POSITION", BUILDERS["HOME_POSITION"](self)[0])
        self.housekeeping()
        self.update_demand()
        for _ in range(min(_PARAMETERS_PER_TICK, len(self._pending_parameters))):
            self.say("PARAM_VALUE", self.parameters.value_message(self._pending_parameters.popleft()))

    def update_demand(self) -> None:
        """The maneuver's demand now; nothing lifts while disarmed."""
        maneuver = self.maneuver if self.armed else Ground()
        demand = maneuver.demand(self.now, self.sensed, self.style())
        if demand != self.demand:
            self.demand = demand

    def begin(self, maneuver: Maneuver) -> None:
        """From now on does this."""
        self.maneuver = maneuver
        self.update_demand()

    # --- facts ---

    def ready(self) -> bool:
        """Position estimate and pre-arm checks are good."""
        return self.now - self.boot_s >= self._ready_after_s

    def fix(self) -> bool:
        """GPS has a position."""
        return self.now - self.boot_s >= 0.5 * self._ready_after_s

    def boot_ms(self) -> int:
        """Milliseconds since boot."""
        return max(0, round((self.now - self.boot_s) * 1000)) & 0xFFFFFFFF

    def local_position(self) -> Vector3:
        """Position in the vehicle's own local frame."""
        n, e, d = self.sensed.position_ned_m
        on, oe, od = self.local_origin_ned
        return n - on, e - oe, d - od

    def place(self, command: Command) -> Vector3 | None:
        """NED of the point in p[4:7] of a command; missing coordinates are the current ones; None: no such point."""
        here = self.plane.geodetic_from_ned(self.sensed.position_ned_m)
        lat, lon, alt = (b if math.isnan(a) else a for a, b in zip(command.p[4:7], astuple(here), strict=True))
        if not (abs(lat) <= 90 and abs(lon) <= 180 and abs(alt) < 1e5):
            return None
        if command.frame in _RELATIVE_FRAMES and not math.isnan(command.p[6]):
            alt += self.plane.geodetic_from_ned(self.home_ned).alt_m
        return self.plane.ned_from_geodetic(Geodetic(lat, lon, alt))

    def landed_state(self) -> Landed:
        """EXTENDED_SYS_STATE.landed_state."""
        if self.sensed.landed:
            return Landed.ON_GROUND
        return self.maneuver.landed_state if self.armed and not self.maneuver.done else Landed.IN_AIR

    # --- speaking ---

    def say(self, name: str, fields: dict[str, Any], *, private: bool = False) -> None:
        """Queues a message for everybody, or only for who asked."""
        self.outbox.append(Outgoing(Message(name, fields), private))

    def text(self, severity: Severity, text: str) -> None:
        """STATUSTEXT; longer ones in chunks of 50 characters."""
        chunks = [text[i : i + 50] for i in range(0, len(text), 50)]
        for i, chunk in enumerate(chunks):
            ident = {"id": 1 if len(chunks) > 1 else 0, "chunk_seq": i}
            self.say("STATUSTEXT", {"severity": int(severity), "text": chunk.encode()} | ident)

    # --- messages ---

    def handle(self, message: Message, now: float, sensed: Sensed) -> None:
        """Acts on a received message; what is not for us or makes no sense is counted in `ignored`."""
        self.now, self.sensed = max(now, self.boot_s), sensed
        handler = self._handlers.get(message.name)
        target = message.fields.get("target_system", 0)
        if handler is None or now < self.boot_s or target not in (0, self.sysid) or not _sane(message):
            self.ignored += 1
            return
        handler(message)

    def _on_heartbeat(self, message: Message) -> None:
        if message.fields["type"] == MAV_TYPE_GCS:
            self.gcs_heartbeat(message.source[0])

    def gcs_heartbeat(self, system: int) -> None:
        """A ground station was heard."""
        del system
        self.gcs_heartbeat_s = self.now

    def _on_command_long(self, message: Message) -> None:
        f = message.fields
        p = (f["param1"], f["param2"], f["param3"], f["param4"], f["param5"], f["param6"], f["param7"])
        self._command(Command(f["command"], 0, p, (f["target_system"], f["target_component"]), message.source))

    def _on_command_int(self, message: Message) -> None:
        f = message.fields
        p = (f["param1"], f["param2"], f["param3"], f["param4"], f["x"] * 1e-7, f["y"] * 1e-7, f["z"])
        self._command(Command(f["command"], f["frame"], p, (f["target_system"], f["target_component"]), message.source))

    def _command(self, command: Command) -> None:
        if not self.addressed(command):
            self.ignored += 1
            return
        handler = self.commands.get(command.id)
        result = Result.UNSUPPORTED if handler is None else handler(command)
        if result is not None:
            self.acknowledge(command.id, result, command.source)

    def acknowledge(self, command: int, result: Result, to: tuple[int, int]) -> None:
        """COMMAND_ACK to who asked."""
        fields = {"command": command, "result": int(result), "target_system": to[0], "target_component": to[1]}
        self.say("COMMAND_ACK", fields, private=True)

    def _on_set_mode(self, message: Message) -> None:
        result = self.set_mode(message.fields["base_mode"], message.fields["custom_mode"])
        self.acknowledge(11, result, message.source)

    def _on_setpoint(self, message: Message) -> None:
        setpoint = read_setpoint(message.fields, self.sensed.heading_rad, self.local_position())
        if setpoint is None:
            self.ignored += 1
            return
        self.on_setpoint(setpoint)

    def _on_timesync(self, message: Message) -> None:
        if message.fields["tc1"] == 0:
            own = round((self.now - self.boot_s) * 1e9)
            self.say("TIMESYNC", {"tc1": own, "ts1": message.fields["ts1"]}, private=True)

    def _on_mission_list(self, message: Message) -> None:
        kind = message.fields.get("mission_type", 0)
        to = {"target_system": message.source[0], "target_component": message.source[1]}
        self.say("MISSION_COUNT", to | {"count": 0, "mission_type": kind}, private=True)

    # --- parameters ---

    def _on_param_list(self, message: Message) -> None:
        del message
        names = (self.parameters.name_at(i) for i in range(len(self.parameters)))
        self._pending_parameters = deque(name for name in names if name is not None)

    def _on_param_read(self, message: Message) -> None:
        index = message.fields["param_index"]
        name = message.fields["param_id"] if index == -1 else self.parameters.name_at(index)
        if name is None or name not in self.parameters:
            self.ignored += 1
            return
        self.say("PARAM_VALUE", self.parameters.value_message(name))

    def _on_param_set(self, message: Message) -> None:
        name, value = message.fields["param_id"], message.fields["param_value"]
        if name not in self.parameters:
            self.ignored += 1
            return
        if not self.parameters.set_from_wire(name, value):
            self.ignored += 1
        self.say("PARAM_VALUE", self.parameters.value_message(name))

    # --- streams ---

    def _on_data_stream(self, message: Message) -> None:
        f = message.fields
        rate = f["req_message_rate"] if f["start_stop"] else 0
        self.data_stream(f["req_stream_id"], 1.0 / min(rate, MAX_RATE_HZ) if rate else None)

    def _set_message_interval(self, command: Command) -> Result:
        name = _message_name(command.p[0])
        if name is None or name not in BUILDERS or not math.isfinite(command.p[1]):
            return Result.DENIED
        if command.p[1] < 0:
            self.streams.set(name, None, self.now)
        elif command.p[1] == 0:
            self.streams.set(name, self.boot_streams.get(name), self.now)
        elif command.p[1] < 1e6 / MAX_RATE_HZ:
            return Result.DENIED
        else:
            self.streams.set(name, command.p[1] * 1e-6, self.now)
        return Result.ACCEPTED

    def _request_message(self, command: Command) -> Result:
        name = _message_name(command.p[0])
        if name is None:
            return Result.FAILED
        for fields in BUILDERS[name](self):
            self.say(name, fields, private=True)
        return Result.ACCEPTED

    def _request_version(self, command: Command) -> Result:
        del command
        self.say("AUTOPILOT_VERSION", BUILDERS["AUTOPILOT_VERSION"](self)[0], private=True)
        return Result.ACCEPTED

    def _request_home(self, command: Command) -> Result:
        del command
        found = BUILDERS["HOME_POSITION"](self)
        for fields in found:
            self.say("HOME_POSITION", fields, private=True)
        return Result.ACCEPTED if found else Result.FAILED

    # --- arming, reboot ---

    def _arm_command(self, command: Command) -> Result | None:
        wanted, magic = command.p[0], command.p[1]
        if wanted == 1.0:
            return Result.ACCEPTED if self.armed else self.arm(force=magic == self.force_arm_magic)
        if wanted == 0.0:
            return self.disarm(force=magic == _FORCE_DISARM) if self.armed else Result.ACCEPTED
        return self.arm_nonsense

    def set_armed(self) -> None:
        """Motors run; home is here."""
        self.armed = True
        self.armed_s = self.now
        self.home_ned = self.sensed.position_ned_m

    def set_disarmed(self) -> None:
        """Motors stop."""
        self.armed = False
        self.failsafe = False
        self.begin(Ground())

    def _reboot_command(self, command: Command) -> Result | None:
        if command.p[0] != 1.0:
            return Result.DENIED
        if self.armed and not self.sensed.landed:
            return Result.TEMPORARILY_REJECTED
        self.acknowledge(command.id, Result.ACCEPTED, command.source)
        self._start(self.sensed, self.now + _REBOOT_S)
        return None


_RELATIVE_FRAMES = (3, 6)
_FORCE_DISARM = 21196.0
_REBOOT_S = 3.0


def _message_name(number: float) -> str | None:
    return MESSAGE_NAMES.get(int(number)) if math.isfinite(number) and number == int(number) else None


def _sane(message: Message) -> bool:
    """Whether all numbers are finite, for messages in which NaN has no meaning."""
    if message.name in _NAN_ALLOWED:
        return True
    return all(math.isfinite(v) for v in message.fields.values() if isinstance(v, float))
