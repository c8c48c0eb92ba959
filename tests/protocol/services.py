"""What QGroundControl, MAVSDK and MAVProxy ask of a vehicle, as a table of requests, and two ground
stations on one link that ask: a simulated vehicle on a virtual clock, a real autopilot on its own.

`tests/data/services.json` has what ArduCopter 4.7-dev and PX4 1.16-dev answered.
"""

from __future__ import annotations

import contextlib
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.engine.vehicles.order import Started
from swarm_ctl.mavlink.framer import Framer, MavlinkFrame
from swarm_ctl.mavlink.wires import open_wire
from swarm_sim.network.hub import Hub
from swarm_sim.world.world import STEP_S
from tests.unit.sim.harness import ORIGIN, config

STATION, OTHER = 255, 254
"""System ids of two ground stations on one link."""
COMPONENT = 190
NAN = math.nan
Ask = Callable[["Talk"], Any]
"""Makes a message for the vehicle of a link."""
_NEWER = {435: "AVAILABLE_MODES", 436: "CURRENT_MODE", 397: "COMPONENT_METADATA"}
"""Not in pymavlink's dialect."""
_SETTLE_S = 0.4
"""After an answer, others may follow."""
_SILENCE_S = 1.5


def _of(message: Any, station: int) -> bool:
    return getattr(message, "target_system", station) in (0, station)


def _told(message: Any) -> str | None:
    """An answer in short; None: not an answer to anything."""
    kind = message.get_type()
    if kind == "COMMAND_ACK":
        return f"ack {message.result}"
    if kind == "MISSION_ACK":
        return f"{kind} {message.type}"
    if kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ITEM", "MISSION_ITEM_INT"):
        return f"{kind} {message.seq}"
    if kind == "MISSION_COUNT":
        return f"{kind} {message.count}"
    if kind == "PARAM_VALUE":
        return kind if message.param_id in _PARAMETERS else None
    if kind == "PING":
        return kind if message.target_system else None
    if kind == "MESSAGE_INTERVAL":
        return f"{kind} {message.message_id}"
    if kind == "FILE_TRANSFER_PROTOCOL":
        return f"FTP {message.payload[3]}"
    if kind == "TIMESYNC" and not message.tc1:
        return None
    return kind if kind in _ANSWERS else None


_ANSWERS = frozenset(
    (
        *("AUTOPILOT_VERSION", "PROTOCOL_VERSION", "HOME_POSITION", "AVAILABLE_MODES", "PING"),
        *("CAMERA_INFORMATION", "GIMBAL_MANAGER_INFORMATION", "LOG_ENTRY", "LOG_DATA", "TIMESYNC"),
        *("COMPONENT_METADATA", "PARAM_EXT_VALUE", "FENCE_POINT", "RALLY_POINT"),
        *("SERIAL_CONTROL", "GPS_GLOBAL_ORIGIN", "COMPONENT_INFORMATION", "PARAM_EXT_ACK"),
    )
)
_PARAMETERS = ("COM_OF_LOSS_T", "GUID_TIMEOUT")
_STREAMED = frozenset(("HOME_POSITION", "GPS_GLOBAL_ORIGIN"))
"""Some vehicles say these unasked."""


class Talk(ABC):
    """A link to one vehicle, over which two ground stations speak."""

    system = 1
    place: tuple[float, float]
    """Where it stands [deg]."""
    field_m: float
    """Above sea level."""
    patience = 1.0
    """Factor on how long further answers are waited for."""

    def __init__(self, *, px4: bool) -> None:
        self.px4 = px4
        self.height_m = 0.0
        self.armed = False
        self.mode = -1
        self.texts: list[str] = []
        self._framer = Framer(unknown=True)
        self._decoder = mavlink.MAVLink(None)
        self._codecs = {
            system: mavlink.MAVLink(None, system, COMPONENT) for system in (STATION, OTHER)
        }
        self._heard: list[Any] = []
        self._beat_s = -math.inf

    @abstractmethod
    def now(self) -> float:
        """Mission time [s]."""

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Sends it."""

    @abstractmethod
    def read(self) -> list[bytes]:
        """What has come, after a moment in which something may come."""

    def tell(self, message: Any, station: int = STATION) -> None:
        """Sends a message."""
        codec = self._codecs[station]
        data = bytes(message.pack(codec))
        codec.seq = (codec.seq + 1) & 0xFF
        self.write(data)

    def listen(self, seconds: float) -> None:
        """For so long; the first station's heartbeats go out."""
        end = self.now() + seconds
        while self.now() < end:
            self.pump()

    def pump(self) -> None:
        """Hears what has come."""
        if self.now() - self._beat_s >= 1.0:
            self._beat_s = self.now()
            self.tell(mavlink.MAVLink_heartbeat_message(6, 8, 192, 0, 4, 3))
        for data in self.read():
            for frame in self._framer.feed(data):
                self._take(frame)

    def _take(self, frame: MavlinkFrame) -> None:
        if (frame.system, frame.component) != (self.system, 1):
            return
        if frame.message_id in _NEWER:
            self._heard.append(_Newer(_NEWER[frame.message_id]))
            return
        with contextlib.suppress(mavlink.MAVError):
            message: Any = self._decoder.decode(bytearray(frame.raw))
            kind = message.get_type()
            if kind == "HEARTBEAT":
                self.armed = bool(message.base_mode & 128)
                self.mode = message.custom_mode
            elif kind == "GLOBAL_POSITION_INT":
                self.height_m = message.alt / 1000 - self.field_m
            elif kind == "STATUSTEXT":
                self.texts.append(message.text)
            self._heard.append(message)

    def ask(self, message: Any, station: int = STATION) -> list[str]:
        """What is answered to this station, each once, until some moments of silence."""
        self._heard.clear()
        self.tell(message, station)
        end = self.now() + _SILENCE_S
        answers: list[str] = []
        done = 0
        while self.now() < end:
            self.pump()
            for heard in self._heard[done:]:
                answer = _told(heard) if _of(heard, station) else None
                if answer is not None and answer not in answers:
                    answers.append(answer)
                    if answer not in _STREAMED:
                        end = self.now() + _SETTLE_S * self.patience
            done = len(self._heard)
        return answers

    def wait(self, seconds: float) -> list[str]:
        """The acknowledgements of mission transfers in so long."""
        self._heard.clear()
        self.listen(seconds)
        told = (_told(each) for each in self._heard if each.get_type() == "MISSION_ACK")
        return sorted({each for each in told if each is not None})

    def until(self, what: Callable[[], bool], again: Ask, most_s: float) -> None:
        """Ask each second until it is so."""
        end, due = self.now() + most_s, -math.inf
        while not what():
            assert self.now() < end, (self.mode, self.armed, self.height_m, self.texts[-6:])
            if self.now() >= due:
                due = self.now() + 1.0
                self.tell(again(self))
            self.pump()

    def be(self, state: str) -> None:
        """`disarmed` or `flying`, in GUIDED or Hold."""
        hold, custom = ((1, 4, 3), 4 << 16 | 3 << 24) if self.px4 else ((1, 4, 0), 4)
        takes = command(176, *hold)
        if state == "disarmed":
            self.until(lambda: self.height_m < 1.0 or not self.armed, command(21), 90.0)
            self.until(lambda: not self.armed, command(400, 0), 30.0)
        if self.mode != custom or (state == "flying" and not self.armed):
            self.until(lambda: self.mode == custom, takes, 20.0)
        if state == "flying" and not (self.armed and self.height_m > 3.0):
            self.until(lambda: self.armed, command(400, 1), 60.0)
            self.until(lambda: self.height_m > 7.0, self._up(8.0), 60.0)
            self.until(lambda: self.mode == custom, takes, 20.0)

    def _up(self, height_m: float) -> Ask:
        if self.px4:
            return command(22, 0, 0, 0, NAN, NAN, NAN, self.field_m + height_m)
        return command(22, 0, 0, 0, 0, 0, 0, height_m)

    def prepare(self) -> None:
        """Positions come, nothing disarms by itself, the battery lasts, and no list is left of an
        earlier test."""
        self.until(lambda: self.mode >= 0, command(512, 148), 30.0)
        values = {b"COM_DISARM_PRFLT": -1.0} if self.px4 else {b"DISARM_DELAY": 0.0}
        for name, value in (values | {b"SIM_BATT_DRAIN": 0.0}).items():
            kind = 9 if self.px4 else 2
            self.ask(say("param_set", name, value, kind)(self))
        self.ask(command(511, 33, 2e5)(self))
        for kind in (0, 1, 2):
            self.ask(clear(kind)(self))


class _Newer:
    """A message that the dialect does not have."""

    def __init__(self, name: str) -> None:
        self._name = name

    def get_type(self) -> str:
        """As pymavlink calls it."""
        return self._name


class Simulated(Talk):
    """A simulated vehicle, on a virtual clock."""

    field_m = ORIGIN.alt_m
    place = (ORIGIN.lat_deg, ORIGIN.lon_deg)

    def __init__(self, persona: str) -> None:
        super().__init__(px4=persona == "px4")
        self._came: list[bytes] = []
        self._hub = Hub(config(1, persona), 0.0, lambda _, data, __: self._came.append(data))

    def now(self) -> float:
        return self._hub.world.time_s

    def write(self, data: bytes) -> None:
        self._hub.receive(0, data, ("127.0.0.1", 1))

    def read(self) -> list[bytes]:
        for _ in range(round(0.1 / STEP_S)):
            self._hub.step()
        came, self._came = self._came, []
        return came


class Real(Talk):
    """A real autopilot, on the wall clock times its speed."""

    patience = 2.0

    def __init__(self, vehicle: Started, speedup: float, place: tuple[float, float, float]) -> None:
        super().__init__(px4=vehicle.kind is VehicleKind.PX4)
        self.place, self.field_m = place[:2], place[2]
        self.system = vehicle.sysid
        self._speedup = speedup
        self._wire = open_wire(vehicle.ground_station)

    def now(self) -> float:
        return time.monotonic() * self._speedup

    def write(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            self._wire.write(data, time.monotonic())

    def read(self) -> list[bytes]:
        time.sleep(0.01)
        out = []
        with contextlib.suppress(OSError):
            while (chunk := self._wire.read(time.monotonic())) is not None:
                out.append(bytes(chunk))
        return out

    def close(self) -> None:
        """Lets the port go."""
        self._wire.close()


def say(name: str, *fields: Any) -> Ask:
    """The message of this name, for the vehicle's autopilot."""
    kind = getattr(mavlink, f"MAVLink_{name}_message")
    return lambda t: kind(t.system, 1, *fields)


def command(number: int, *p: float, target: tuple[int, int] | None = None) -> Ask:
    """COMMAND_LONG."""
    numbers = [*p, *[0.0] * (7 - len(p))]
    return lambda t: mavlink.MAVLink_command_long_message(
        *(target or (t.system, 1)), number, 0, *numbers
    )


def there(number: int, *p: float, north_e7: int = 0, up_m: float = 0.0, frame: int = 0) -> Ask:
    """COMMAND_INT, at the vehicle's place and ground or so."""
    numbers = [*p, *[0.0] * (4 - len(p))]

    def make(t: Talk) -> Any:
        x, y = (round(v * 1e7) for v in t.place)
        z = up_m if frame == 6 else t.field_m + up_m
        head = (t.system, 1, frame, number, 0, 0)
        return mavlink.MAVLink_command_int_message(*head, *numbers, x + north_e7, y, z)

    return make


def nowhere(number: int, *p: float, x: int = 0, frame: int = 0) -> Ask:
    """COMMAND_INT."""
    numbers = [*p, *[0.0] * (4 - len(p))]
    return say("command_int", frame, number, 0, 0, *numbers, x, 0, 0.0)


def count(number: int, kind: int = 0) -> Ask:
    """MISSION_COUNT."""
    return say("mission_count", number, kind)


def item(seq: int, number: int = 16, kind: int = 0, frame: int = 6) -> Ask:
    """MISSION_ITEM_INT."""
    p = (30.0 if number == 5003 else 0.0, 0.0, 0.0, 0.0)

    def make(t: Talk) -> Any:
        x, y = (round(v * 1e7) + 500 for v in t.place)
        head = (t.system, 1, seq, frame, number, 0, 1)
        return mavlink.MAVLink_mission_item_int_message(*head, *p, x, y, 8.0, kind)

    return make


def want(seq: int) -> Ask:
    """MISSION_REQUEST_INT."""
    return say("mission_request_int", seq, 0)


def listed(kind: int = 0) -> Ask:
    """MISSION_REQUEST_LIST."""
    return say("mission_request_list", kind)


def clear(kind: int = 0) -> Ask:
    """MISSION_CLEAR_ALL."""
    return say("mission_clear_all", kind)


def thanks(result: int = 0) -> Ask:
    """MISSION_ACK."""
    return say("mission_ack", result, 0)


def file(opcode: int, name: bytes = b"") -> Ask:
    """FILE_TRANSFER_PROTOCOL."""
    data = [1, 0, 0, opcode, len(name), 0, 0, 0, 0, 0, 0, 0, *name]
    payload = data + [0] * (251 - len(data))
    return lambda t: mavlink.MAVLink_file_transfer_protocol_message(0, t.system, 1, payload)


def _parameter(name: str, *fields: Any) -> Ask:
    """Read or set one that both have, in their names."""
    kind = getattr(mavlink, f"MAVLink_{name}_message")
    return lambda t: kind(t.system, 1, _PARAMETERS[not t.px4].encode(), *fields)


class By(NamedTuple):
    """A step of the other station."""

    ask: Ask


Step = Ask | By | float
"""A message, or so many seconds."""


def play(talk: Talk, name: str) -> str:
    """What is answered to the request of this name, step by step."""
    told = []
    reminder = ""
    asked = "HOME_POSITION" if name == "identity: home" else name
    for step in SERVICES[name]:
        if isinstance(step, float):
            answers = talk.wait(step)
        elif isinstance(step, By):
            answers = talk.ask(step.ask(talk), OTHER)
        else:
            answers = talk.ask(step(talk))
        answers = [each for each in answers if each not in _STREAMED or each in asked]
        if any(each.startswith("MISSION_ACK") for each in answers):
            answers = [each for each in answers if each != reminder]
        reminder = next((each for each in answers if "REQUEST" in each), reminder)
        told.append(" + ".join(sorted(answers)) or "-")
    return " | ".join(told)


_UP: tuple[Step, ...] = (count(3), item(0), item(1), item(2))
_HALF: tuple[Step, ...] = (count(3), item(0))
_REST: tuple[Step, ...] = (item(1), item(2), 9.0)
SERVICES: dict[str, tuple[Step, ...]] = {
    "parameters: read": (_parameter("param_request_read", -1),),
    "parameters: read, wrong name": (say("param_request_read", b"NO_SUCH_NAME", -1),),
    "parameters: read, wrong index": (say("param_request_read", b"", 30000),),
    "parameters: set": (_parameter("param_set", 2.0, 9),),
    "parameters: set, wrong type": (_parameter("param_set", 2.0, 6),),
    "parameters: set, wrong name": (say("param_set", b"NO_SUCH_NAME", 1.0, 9),),
    "parameters: of a camera": (say("param_ext_request_list"),),
    "command: unknown": (command(31999),),
    "command: unknown, as COMMAND_INT": (nowhere(31999),),
    "command: for another system": (command(31999, target=(77, 1)),),
    "command: for another component": (command(31999, target=(1, 100)),),
    "command: for all": (command(31999, target=(0, 0)),),
    "message: SYS_STATUS": (command(512, 1),),
    "message: AUTOPILOT_VERSION": (command(512, 148),),
    "message: HOME_POSITION": (command(512, 242),),
    "message: ATTITUDE": (command(512, 30),),
    "message: BATTERY_STATUS": (command(512, 147),),
    "message: GPS_GLOBAL_ORIGIN": (command(512, 49),),
    "message: MISSION_CURRENT": (command(512, 42),),
    "message: AVAILABLE_MODES": (command(512, 435),),
    "message: AVAILABLE_MODES, one": (command(512, 435, 1),),
    "message: AVAILABLE_MODES, wrong index": (command(512, 435, 99),),
    "message: MESSAGE_INTERVAL": (command(512, 244, 30),),
    "message: MESSAGE_INTERVAL, unknown": (command(512, 244, 9999),),
    "message: PROTOCOL_VERSION": (command(512, 300),),
    "message: COMPONENT_METADATA": (command(512, 397),),
    "message: COMPONENT_INFORMATION": (command(512, 395),),
    "message: CAMERA_INFORMATION": (command(512, 259),),
    "message: GIMBAL_MANAGER_INFORMATION": (command(512, 280),),
    "message: unknown": (command(512, 9999),),
    "interval: get": (command(510, 30),),
    "interval: get, unknown": (command(510, 9999),),
    "interval: set": (command(511, 30, 1e5),),
    "interval: set, unknown": (command(511, 9999, 1e5),),
    "interval: default": (command(511, 30, 0),),
    "identity: capabilities": (command(520, 1),),
    "identity: protocol version": (command(519, 1),),
    "identity: home": (command(410),),
    "identity: camera": (command(521, 1),),
    "identity: AUTOPILOT_VERSION_REQUEST": (say("autopilot_version_request"),),
    "time: TIMESYNC": (lambda _: mavlink.MAVLink_timesync_message(0, 12345),),
    "time: PING": (lambda _: mavlink.MAVLink_ping_message(5, 9, 0, 0),),
    "time: SYSTEM_TIME": (lambda _: mavlink.MAVLink_system_time_message(1_700_000_000_000_000, 5),),
    "files: open, not there": (file(4, b"@NONE/no.bin"),),
    "files: list, not there": (file(3, b"/none"),),
    "files: reset": (file(2),),
    "files: unknown": (file(77),),
    "logs: list": (say("log_request_list", 0, 0xFFFF),),
    "logs: data": (say("log_request_data", 77, 0, 90),),
    "logs: end": (say("log_request_end"),),
    "old lists: fence point": (say("fence_fetch_point", 0),),
    "old lists: rally point": (say("rally_fetch_point", 0),),
    "mission: list, empty": (clear(), listed()),
    "mission: list of fences, empty": (listed(1),),
    "mission: list of rally points, empty": (listed(2),),
    "mission: list of an unknown type": (listed(7), 6.0),
    "mission: item without a list": (thanks(), want(0), want(5)),
    "mission: upload": (*_UP,),
    "mission: upload, last answer lost": (*_UP, item(2)),
    "mission: an item nobody asked for": (item(7),),
    "mission: download": (listed(), want(0), want(1), want(2), thanks()),
    "mission: download, an item twice": (listed(), want(0), want(0), want(1), want(2), thanks()),
    "mission: download, wrong number": (listed(), want(9), thanks()),
    "mission: download by floats": (listed(), say("mission_request", 0, 0), thanks()),
    "mission: upload, wrong number": (*_HALF, item(2), item(1), item(2)),
    "mission: upload, an item twice": (*_HALF, item(0), item(1), item(2)),
    "mission: upload, count twice": (count(3), *_UP),
    "mission: upload, count in the middle": (*_HALF, count(2), item(0), item(1), 9.0),
    "mission: upload, unknown item": (count(2), item(0), item(1, 4999)),
    "mission: upload, unknown frame": (count(2), item(0), item(1, frame=77)),
    "mission: upload, a fence's item": (count(2), item(0, 5001, 1), 9.0),
    "mission: upload, time-out": (*_HALF, 13.0),
    "mission: upload, cancelled": (*_HALF, thanks(15), 2.0, listed(), thanks(), 9.0),
    "mission: another counts meanwhile": (*_HALF, By(count(2)), *_REST),
    "mission: another clears meanwhile": (*_HALF, By(clear()), *_REST),
    "mission: another lists meanwhile": (*_HALF, By(listed()), *_REST),
    "mission: another sends an item": (count(3), By(item(0)), item(0), *_REST),
    "mission: another asks meanwhile": (*_HALF, By(want(0)), *_REST),
    "mission: own list meanwhile": (*_HALF, listed(), *_REST),
    "mission: own clear meanwhile": (*_HALF, clear(), *_REST),
    "mission: another lists during a download": (
        *_UP,
        listed(),
        want(0),
        By(listed()),
        By(want(0)),
        want(1),
        9.0,
    ),
    "mission: another clears during a download": (*_UP, listed(), want(0), By(clear()), 9.0, *_UP),
    "mission: fences during a download": (listed(), want(0), listed(1), 9.0),
    "mission: part of the list": (
        *_UP,
        say("mission_write_partial_list", 1, 1, 0),
        item(1),
        listed(),
        thanks(),
    ),
    "mission: part outside of the list": (say("mission_write_partial_list", 7, 9, 0), 9.0),
    "mission: part backwards": (say("mission_write_partial_list", 2, 1, 0), 9.0),
    "mission: current": (command(224, 1),),
    "mission: current, outside": (command(224, 99),),
    "mission: current as a message, outside": (say("mission_set_current", 99),),
    "mission: a fence": (count(1, 1), item(0, 5003, 1, 0), clear(1)),
    "mission: a rally point": (count(1, 2), item(0, 5100, 2, 3), clear(2)),
    "mission: empty upload": (count(0),),
    "mission: items 31 and 94": (count(3), item(0), item(1, 31), item(2, 94), clear()),
    "mission: clear all types": (clear(255),),
    "mission: clear an unknown type": (clear(7),),
    "home: here": (command(179, 1),),
    "home: 0, 0, 0": (command(179, 0), command(179, 1)),
    "home: 0, 0, 0, as COMMAND_INT": (nowhere(179, 0), command(179, 1)),
    "home: there": (there(179, 0, north_e7=100), command(179, 1)),
    "home: 500 km off": (there(179, 0, north_e7=45_000_000), command(179, 1)),
    "home: impossible": (command(179, 0, 0, 0, 0, 200.0, 10.0, 5.0), command(179, 1)),
    "mode: unknown": (command(176, 1, 99),),
    "mode: without the custom flag": (command(176, 0, 4),),
    "mode: unknown, as SET_MODE": (lambda t: mavlink.MAVLink_set_mode_message(t.system, 1, 99),),
    "mode: the present one, as SET_MODE": (
        lambda t: mavlink.MAVLink_set_mode_message(t.system, 1, 4 << 16 | 3 << 24 if t.px4 else 4),
    ),
    "mode: the present one": (lambda t: command(176, 1, 4, 3 if t.px4 else 0)(t),),
    "arming: 2": (command(400, 2),),
    "arming: checks": (command(401),),
    "flight: speed 0": (command(178, 1, 0, -1),),
    "flight: speed 3": (command(178, 1, 3, -1),),
    "flight: reposition to nowhere": (nowhere(192, -1, 1, 0, NAN, x=2_000_000_000, frame=6),),
    "flight: reposition": (there(192, -1, 1, 0, NAN, up_m=8.0, frame=6),),
    "flight: pause": (command(193, 0),),
    "flight: go on, without a mission": (clear(), command(193, 1)),
    "flight: mission start, without one": (command(300),),
    "flight: orbit": (command(34, 5, 1),),
    "flight: height": (command(186, 8, 3),),
    "flight: yaw": (command(115, 0, 20, 1, 0),),
    "flight: land": (command(21),),
    "flight: return": (command(20),),
    "others: restart, nonsense": (command(246, 9),),
    "others: gimbal": (command(205),),
    "others: gimbal manager": (command(1000),),
    "others: photo": (command(2000, 0, 0, 1),),
    "others: region of interest": (there(195),),
    "others: no region of interest": (command(197),),
    "others: servo": (command(183, 9, 1500),),
    "others: relay": (command(181, 0, 1),),
    "others: gripper": (command(211, 1, 0),),
    "others: storage": (command(245),),
    "others: fence off": (command(207),),
    "others: landing sequence": (command(189),),
    "others: no termination": (command(185),),
    "others: RC_CHANNELS_OVERRIDE, none": (say("rc_channels_override", *[65535] * 8),),
    "others: MANUAL_CONTROL of another": (
        lambda _: mavlink.MAVLink_manual_control_message(77, 0, 0, 500, 0, 0),
    ),
    "others: SERIAL_CONTROL": (
        lambda _: mavlink.MAVLink_serial_control_message(10, 0, 0, 0, 0, [0] * 70),
    ),
}
"""The requests of each service, by name."""
