"""Folds what a vehicle says into what is known of it: one table, message name -> function.

A function gets the state, a decoded pymavlink message and the time; it returns False where a field
can't be true (NaN, infinite, out of range), and then has changed nothing. None of them may raise,
whatever the bytes were.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.core.model.vehicle import Contact, GlobalFix, LocalFix
from swarm_ctl.mavlink.outgoing import SOURCE_COMPONENT, SOURCE_SYSTEM
from swarm_ctl.mavlink.status_texts import Texts

MAX_POSITION_M = 1e5
"""A local position further from its origin than this is not one: EKFs work in a tangent plane."""
MAX_SPEED_MPS = 300.0
MAX_ALTITUDE_M = 2e4
MAX_CONTACTS = 256
MAX_ROUND_TRIP_S = 10.0
"""An older answer, or one from the future, answers somebody else's request."""
WIND_KEPT_S = 10.0
"""An estimate not repeated for this long (PX4 sends one in 2 s) is none."""
MAX_WIND_MPS = 100.0
CONTACT_KEPT_S = 10.0
"""A contact not repeated for this long is forgotten; what an older one means is the core's business
before that."""
IDENTITY_KEPT_S = 3.0
"""A heartbeat of another firmware or type is not this vehicle's, unless this vehicle has been
silent for so long."""
REBOOT_BACK_S = 5.0
"""The vehicle's own clock going back this far means that it restarted (less may be frames that
overtook others)."""


@dataclass(slots=True)
class Parameter:
    """A PARAM_VALUE as it came: `raw` still in the vehicle's encoding of type `kind`."""

    raw: float
    kind: int


@dataclass(slots=True)
class Heard:
    """Everything heard from one vehicle, in the wire's terms (SI units). Mutable; the link owns
    it."""

    watched: frozenset[str] = frozenset()
    """Names of the parameters worth remembering; others are dropped, so a flood of them costs no
    memory."""
    heartbeat_s: float = -math.inf
    stranger: int = 0
    """The system id of another vehicle heard on this link, 0 for none."""
    autopilot: int = -1
    """MAV_AUTOPILOT, -1 before the first heartbeat."""
    vehicle_type: int = -1
    armed: bool = False
    custom_mode: int | None = None
    """None while unknown, or where the heartbeat says that it has none."""
    on_ground: bool = True
    system_status_s: float = -math.inf
    sensors_present: int = 0
    sensors_enabled: int = 0
    sensors_health: int = 0
    battery_percent: float | None = None
    tilt_deg: float | None = None
    wind_mps: float = 0.0
    wind_s: float = -math.inf
    """When it was told; -inf: never."""
    origin: Geodetic | None = None
    local: LocalFix | None = None
    global_: GlobalFix | None = None
    contacts: dict[int, Contact] = field(default_factory=dict)
    parameters: dict[str, Parameter] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    """Messages folded so far, by message id."""
    answers: dict[int, int] = field(default_factory=dict)
    """Last COMMAND_ACK by command (those of `_REFUSABLE`): MAV_RESULT. A repeated refusal is told
    once."""
    texts: Texts = field(default_factory=Texts)
    round_trip_s: float | None = None
    """Of the newest TIMESYNC that came back."""
    boot_s: float = 0.0
    """The vehicle's own clock at its last LOCAL_POSITION_NED or GLOBAL_POSITION_INT."""

    def forget_old_contacts(self, now: float) -> None:
        """Drop the contacts not repeated for `CONTACT_KEPT_S`."""
        old = [a for a, contact in self.contacts.items() if now - contact.time_s > CONTACT_KEPT_S]
        for address in old:
            del self.contacts[address]

    def wind_now(self, now: float) -> float | None:
        """Horizontal wind [m/s], while the vehicle tells it."""
        return self.wind_mps if now - self.wind_s <= WIND_KEPT_S else None

    def clocked(self, boot_ms: int) -> None:
        """Note the vehicle's clock; forget what does not survive a restart when it went back."""
        boot_s = boot_ms * 1e-3
        if boot_s < self.boot_s - REBOOT_BACK_S:
            self.origin = self.local = self.global_ = None
            self.system_status_s = -math.inf
            self.parameters.clear()
            self.texts.add("the vehicle restarted")
        self.boot_s = boot_s


def _heartbeat(heard: Heard, message: Any, now: float) -> bool:
    identity = (message.autopilot, message.type)
    if now - heard.heartbeat_s < IDENTITY_KEPT_S and identity != (
        heard.autopilot,
        heard.vehicle_type,
    ):
        return False
    heard.heartbeat_s = now
    heard.autopilot = message.autopilot
    heard.vehicle_type = message.type
    heard.armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
    custom = message.base_mode & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    heard.custom_mode = message.custom_mode if custom else None
    return True


def _local_position(heard: Heard, message: Any, now: float) -> bool:
    position = (message.x, message.y, message.z)
    velocity = (message.vx, message.vy, message.vz)
    if not (_within(position, MAX_POSITION_M) and _within(velocity, MAX_SPEED_MPS)):
        return False
    heard.clocked(message.time_boot_ms)
    heard.local = LocalFix(now, position, velocity)
    return True


def _global_position(heard: Heard, message: Any, now: float) -> bool:
    position = _geodetic(message.lat, message.lon, message.alt)
    relative_m = message.relative_alt * 1e-3
    if position is None or abs(relative_m) > MAX_ALTITUDE_M:
        return False
    heard.clocked(message.time_boot_ms)
    velocity = (message.vx * 0.01, message.vy * 0.01, message.vz * 0.01)
    heard.global_ = GlobalFix(now, position, relative_m, velocity)
    return True


def _global_origin(heard: Heard, message: Any, now: float) -> bool:  # noqa: ARG001
    origin = _geodetic(message.latitude, message.longitude, message.altitude)
    if origin is None:
        return False
    heard.origin = origin
    return True


def _system_status(heard: Heard, message: Any, now: float) -> bool:
    if not _battery(heard, message.battery_remaining):
        return False
    heard.system_status_s = now
    heard.sensors_present = message.onboard_control_sensors_present
    heard.sensors_enabled = message.onboard_control_sensors_enabled
    heard.sensors_health = message.onboard_control_sensors_health
    return True


def _battery_status(heard: Heard, message: Any, now: float) -> bool:  # noqa: ARG001
    return message.id != 0 or _battery(heard, message.battery_remaining)


def _battery(heard: Heard, percent: int) -> bool:
    if 0 <= percent <= 100:
        heard.battery_percent = float(percent)
    return -1 <= percent <= 100


def _timesync(heard: Heard, message: Any, now: float) -> bool:
    """An answer (tc1 set) to our request: `ts1` is our own time [ns]. Requests of the vehicle are
    not answered."""
    trip = now - message.ts1 * 1e-9
    if message.tc1 != 0 and 0.0 <= trip <= MAX_ROUND_TRIP_S:
        heard.round_trip_s = trip
    return True


def _attitude(heard: Heard, message: Any, now: float) -> bool:  # noqa: ARG001
    if not _within((message.roll, message.pitch), 2 * math.pi):
        return False
    # between the vehicle's own up and the world's
    heard.tilt_deg = math.degrees(
        math.acos(max(-1.0, min(1.0, math.cos(message.roll) * math.cos(message.pitch))))
    )
    return True


def _wind(heard: Heard, message: Any, now: float) -> bool:
    """ArduPilot: speed and where it comes from."""
    return _winds(heard, message.speed, now)


def _wind_cov(heard: Heard, message: Any, now: float) -> bool:
    """PX4: where it blows."""
    return _winds(heard, math.hypot(message.wind_x, message.wind_y), now)


def _winds(heard: Heard, speed_mps: float, now: float) -> bool:
    if not 0.0 <= speed_mps <= MAX_WIND_MPS:  # NaN is not
        return False
    heard.wind_mps, heard.wind_s = speed_mps, now
    return True


def _extended_state(heard: Heard, message: Any, now: float) -> bool:  # noqa: ARG001
    if message.landed_state == dialect.MAV_LANDED_STATE_UNDEFINED:
        return True
    if message.landed_state > dialect.MAV_LANDED_STATE_LANDING:
        return False
    heard.on_ground = message.landed_state == dialect.MAV_LANDED_STATE_ON_GROUND
    return True


_ADSB_NEEDED = dialect.ADSB_FLAGS_VALID_COORDS | dialect.ADSB_FLAGS_VALID_ALTITUDE
_ADSB_MOVING = dialect.ADSB_FLAGS_VALID_HEADING | dialect.ADSB_FLAGS_VALID_VELOCITY


def _traffic(heard: Heard, message: Any, now: float) -> bool:
    position = _geodetic(message.lat, message.lon, message.altitude)
    if position is None or message.flags & _ADSB_NEEDED != _ADSB_NEEDED or message.heading > 36000:
        return False
    contacts = heard.contacts
    if message.ICAO_address not in contacts and len(contacts) >= MAX_CONTACTS:
        del contacts[min(contacts, key=lambda address: contacts[address].time_s)]
    velocity = (0.0, 0.0, 0.0)
    if message.flags & _ADSB_MOVING == _ADSB_MOVING:
        heading, speed = math.radians(message.heading * 0.01), message.hor_velocity * 0.01
        velocity = (
            speed * math.cos(heading),
            speed * math.sin(heading),
            -message.ver_velocity * 0.01,
        )
    contacts[message.ICAO_address] = Contact(now, message.ICAO_address, position, velocity)
    return True


def _status_text(heard: Heard, message: Any, now: float) -> bool:
    if message.severity > dialect.MAV_SEVERITY_WARNING:
        return message.severity <= dialect.MAV_SEVERITY_DEBUG  # type: ignore[no-any-return]
    if message.id:
        heard.texts.add_chunk(message.text, message.id, now)
    elif message.text:
        heard.texts.add(message.text)
    return True


def _command_ack(heard: Heard, message: Any, now: float) -> bool:  # noqa: ARG001
    if message.target_system not in (0, SOURCE_SYSTEM) or message.target_component not in (
        0,
        SOURCE_COMPONENT,
    ):
        return True  # an answer to somebody else
    name, result = _REFUSABLE.get(message.command), message.result
    if name is None or heard.answers.get(message.command) == result:
        return True
    heard.answers[message.command] = result
    if result not in (dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_IN_PROGRESS):
        heard.texts.add(f"{name} refused: {_RESULTS.get(result, result)}")
    return True


_REFUSABLE = {
    dialect.MAV_CMD_COMPONENT_ARM_DISARM: "arming",
    dialect.MAV_CMD_NAV_TAKEOFF: "take-off",
    dialect.MAV_CMD_DO_SET_MODE: "mode change",
}
"""Commands whose refusal an operator wants to know; nothing else depends on an answer."""
_RESULTS = {
    number: entry.name.removeprefix("MAV_RESULT_")
    for number, entry in dialect.enums["MAV_RESULT"].items()
}


def _parameter_value(heard: Heard, message: Any, now: float) -> bool:  # noqa: ARG001
    name, real = message.param_id, message.param_type == dialect.MAV_PARAM_TYPE_REAL32
    if real and not math.isfinite(message.param_value):
        return False
    if name in heard.watched:
        heard.parameters[name] = Parameter(message.param_value, message.param_type)
    return True


def _within(vector: tuple[float, ...], limit: float) -> bool:
    return all(-limit <= component <= limit for component in vector)


def _geodetic(lat: int, lon: int, alt_mm: int) -> Geodetic | None:
    """From 1e-7 degrees and millimetres; None out of range, and for 0/0: autopilots say so before
    they have a fix."""
    if abs(lat) > 900_000_000 or abs(lon) > 1_800_000_000 or (lat == 0 and lon == 0):
        return None
    altitude_m = alt_mm * 1e-3
    return (
        Geodetic(lat * 1e-7, lon * 1e-7, altitude_m) if abs(altitude_m) <= MAX_ALTITUDE_M else None
    )


FOLDS: dict[str, Callable[[Heard, Any, float], bool]] = {
    "HEARTBEAT": _heartbeat,
    "LOCAL_POSITION_NED": _local_position,
    "GLOBAL_POSITION_INT": _global_position,
    "GPS_GLOBAL_ORIGIN": _global_origin,
    "SYS_STATUS": _system_status,
    "BATTERY_STATUS": _battery_status,
    "ATTITUDE": _attitude,
    "EXTENDED_SYS_STATE": _extended_state,
    "WIND": _wind,
    "WIND_COV": _wind_cov,
    "TIMESYNC": _timesync,
    "ADSB_VEHICLE": _traffic,
    "STATUSTEXT": _status_text,
    "COMMAND_ACK": _command_ack,
    "PARAM_VALUE": _parameter_value,
}
"""What is folded. Everything else the vehicle says is counted and left alone."""

FOLDS_BY_ID = {
    number: FOLDS[m.msgname] for number, m in dialect.mavlink_map.items() if m.msgname in FOLDS
}


def fold(heard: Heard, message: Any, now: float) -> bool:
    """Take in one decoded message of the table, and count it; False (and nothing changed) if it was
    refused."""
    number: int = message.get_msgId()  # not `.id`: some messages have a field of that name
    if not FOLDS_BY_ID[number](heard, message, now):
        return False
    heard.counts[number] = heard.counts.get(number, 0) + 1
    return True


def message_id(name: str) -> int:
    """The number of a message of the table above (KeyError for others)."""
    return _IDS[name]


_IDS: dict[str, int] = {
    m.msgname: number for number, m in dialect.mavlink_map.items() if m.msgname in FOLDS
}
