"""Folds a vehicle's messages into its telemetry: one table, message name -> function.

A function gets the telemetry, a decoded pymavlink message and the time. It returns False, and has
changed nothing, where nothing of the message can be used: a field that all others need can't be
true (NaN, infinite, out of range). Any other odd field costs itself alone. No bytes may make it
raise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.core.model.vehicle import Contact, GlobalFix, LocalFix
from swarm_ctl.mavlink.outgoing import AGENT_COMPONENT
from swarm_ctl.mavlink.telemetry.heartbeats import FlightState, OtherMessages
from swarm_ctl.mavlink.telemetry.vehicle_telemetry import ParameterValue, Telemetry

MAX_POSITION_M = 1e5
"""A local position is at most this far from its origin: EKFs work in a tangent plane."""
MAX_SPEED_MPS = 300.0
MAX_ALTITUDE_M = 2e4
MAX_CONTACTS = 256
MAX_ROUND_TRIP_S = 10.0
"""An older TIMESYNC answer, or one from the future, belongs to another ground station's request."""
MAX_WIND_MPS = 100.0
IDENTITY_KEPT_S = 3.0
"""A heartbeat of another firmware or type is not this vehicle's, unless this vehicle has been
silent for so long."""


def _heartbeat(heard: Telemetry, message: Any, now: float) -> bool:
    identity = (message.autopilot, message.type)
    other = identity != (heard.autopilot, heard.vehicle_type)
    if other and now - heard.heartbeat_s < IDENTITY_KEPT_S:
        return False
    armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
    custom = message.base_mode & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    told = FlightState(armed, message.custom_mode if custom else None)
    believed = FlightState(heard.armed, heard.custom_mode)
    others = OtherMessages(heard.boot_s, heard.on_ground, heard.falls(now))
    if heard.evidence.proves(told, believed, now, others):
        heard.armed, heard.custom_mode = told
    heard.heartbeat_s = now
    heard.first_heartbeat_s = min(heard.first_heartbeat_s, now)
    heard.autopilot, heard.vehicle_type = identity
    return True


def _local_position(heard: Telemetry, message: Any, now: float) -> bool:
    position = (message.x, message.y, message.z)
    velocity = (message.vx, message.vy, message.vz)
    if not (_within(position, MAX_POSITION_M) and _within(velocity, MAX_SPEED_MPS)):
        return False
    heard.clocked(message.time_boot_ms, now)
    heard.local = LocalFix(now, position, velocity, message.time_boot_ms * 1e-3)
    return True


def _global_position(heard: Telemetry, message: Any, now: float) -> bool:
    position = _geodetic(message.lat, message.lon, message.alt)
    relative_m = message.relative_alt * 1e-3
    if position is None or abs(relative_m) > MAX_ALTITUDE_M:
        return False
    heard.clocked(message.time_boot_ms, now)
    velocity = (message.vx * 0.01, message.vy * 0.01, message.vz * 0.01)
    heard.global_ = GlobalFix(now, position, relative_m, velocity)
    return True


def _global_origin(heard: Telemetry, message: Any, now: float) -> bool:  # noqa: ARG001
    origin = _geodetic(message.latitude, message.longitude, message.altitude)
    if origin is None:
        return False
    heard.origin = origin
    return True


def _system_status(heard: Telemetry, message: Any, now: float) -> bool:
    _charge(heard, "SYS_STATUS", message.battery_remaining, now)
    heard.system_status_s = now
    heard.sensors_present = message.onboard_control_sensors_present
    heard.sensors_enabled = message.onboard_control_sensors_enabled
    heard.sensors_health = message.onboard_control_sensors_health
    return True


def _battery_status(heard: Telemetry, message: Any, now: float) -> bool:
    if message.id == 0:
        _charge(heard, "BATTERY_STATUS", message.battery_remaining, now)
    return True


def _charge(heard: Telemetry, message: str, percent: int, now: float) -> None:
    """-1 is "not known"; so is what can't be a charge."""
    if 0 <= percent <= 100:
        heard.charges[message] = float(percent), now
    else:
        heard.charges.pop(message, None)


def _timesync(heard: Telemetry, message: Any, now: float) -> bool:
    """An answer (tc1 set) to our request: `ts1` is our own time [ns]."""
    trip = now - message.ts1 * 1e-9
    if message.tc1 != 0 and 0.0 <= trip <= MAX_ROUND_TRIP_S:
        heard.round_trip_s, heard.answered_s = trip, now
    return True


def _attitude(heard: Telemetry, message: Any, now: float) -> bool:
    if not _within((message.roll, message.pitch, 0.0), 2 * math.pi):
        return False
    # The angle between the vehicle's up axis and the world's.
    cosine = math.cos(message.roll) * math.cos(message.pitch)
    heard.tilt_deg = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
    heard.tilt_s = now
    return True


def _wind(heard: Telemetry, message: Any, now: float) -> bool:
    """ArduPilot: speed [m/s] and the direction it comes from. As delivered it sends exactly 0, in
    any wind: its estimator has not begun to estimate it."""
    return message.speed == 0.0 or _wind_speed(heard, message.speed, now)


def _wind_cov(heard: Telemetry, message: Any, now: float) -> bool:
    """PX4: the wind's velocity vector [m/s]."""
    return _wind_speed(heard, math.hypot(message.wind_x, message.wind_y), now)


def _wind_speed(heard: Telemetry, speed_mps: float, now: float) -> bool:
    if not 0.0 <= speed_mps <= MAX_WIND_MPS:  # true for NaN, too
        return False
    heard.wind_mps, heard.wind_s = speed_mps, now
    return True


def _estimate(heard: Telemetry, message: Any, now: float) -> bool:
    return heard.estimate.report(message, now)


def _gps(heard: Telemetry, message: Any, now: float) -> bool:
    return heard.estimate.gps(message, now)


def _extended_state(heard: Telemetry, message: Any, now: float) -> bool:
    if message.landed_state == dialect.MAV_LANDED_STATE_UNDEFINED:
        return True
    if message.landed_state > dialect.MAV_LANDED_STATE_LANDING:
        return False
    heard.on_ground = message.landed_state == dialect.MAV_LANDED_STATE_ON_GROUND
    heard.landed_s = now
    return True


_ADSB_NEEDED = dialect.ADSB_FLAGS_VALID_COORDS | dialect.ADSB_FLAGS_VALID_ALTITUDE
_ADSB_MOVING = dialect.ADSB_FLAGS_VALID_HEADING | dialect.ADSB_FLAGS_VALID_VELOCITY


def _traffic(heard: Telemetry, message: Any, now: float) -> bool:
    position = _geodetic(message.lat, message.lon, message.altitude)
    if position is None or message.flags & _ADSB_NEEDED != _ADSB_NEEDED:
        return False
    contacts = heard.contacts
    if message.ICAO_address not in contacts and len(contacts) >= MAX_CONTACTS:
        del contacts[min(contacts, key=lambda address: contacts[address].time_s)]
    velocity = (0.0, 0.0, 0.0)
    if message.flags & _ADSB_MOVING == _ADSB_MOVING and message.heading <= 36000:
        heading, speed = math.radians(message.heading * 0.01), message.hor_velocity * 0.01
        down = -message.ver_velocity * 0.01
        velocity = (speed * math.cos(heading), speed * math.sin(heading), down)
    contacts[message.ICAO_address] = Contact(now, message.ICAO_address, position, velocity)
    return True


def _status_text(heard: Telemetry, message: Any, now: float) -> bool:
    if dialect.MAV_SEVERITY_WARNING < message.severity <= dialect.MAV_SEVERITY_DEBUG:
        return True
    if message.id:
        heard.texts.add_chunk(message.text, message.id, now)
    elif message.text:
        heard.texts.add(message.text)
    return True


_RELEASES = {0: "-dev", 64: "-alpha", 128: "-beta", 192: "-rc", 255: ""}
"""FIRMWARE_VERSION_TYPE, the last byte of a version: from so much on."""


def _version(heard: Telemetry, message: Any, now: float) -> bool:  # noqa: ARG001
    number = message.flight_sw_version
    numbers = ".".join(str(number >> shift & 0xFF) for shift in (24, 16, 8))
    kind = max(least for least in _RELEASES if least <= number & 0xFF)
    heard.firmware = numbers + _RELEASES[kind]
    uid = bytes(message.uid2)
    heard.uid = uid.hex() if any(uid) else f"{message.uid:016x}" if message.uid else ""
    return True


def _command_ack(heard: Telemetry, message: Any, now: float) -> bool:  # noqa: ARG001
    if not _for_us(heard, message):
        return True
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
"""Commands whose refusal is reported to the operator; nothing else depends on an answer."""
_RESULTS = {
    number: entry.name.removeprefix("MAV_RESULT_")
    for number, entry in dialect.enums["MAV_RESULT"].items()
}


def _parameter_value(heard: Telemetry, message: Any, now: float) -> bool:  # noqa: ARG001
    name, real = message.param_id, message.param_type == dialect.MAV_PARAM_TYPE_REAL32
    if real and not math.isfinite(message.param_value):
        return False
    if name in heard.watched:
        heard.parameters[name] = ParameterValue(message.param_value, message.param_type)
        heard.parameter_news = object()
    return True


def _for_us(heard: Telemetry, message: Any) -> bool:
    """Not an answer to another ground station or agent."""
    return message.target_system in (0, heard.agent_sysid) and message.target_component in (
        0,
        AGENT_COMPONENT,
    )


def _within(vector: tuple[float, float, float], limit: float) -> bool:
    x, y, z = vector
    return -limit <= x <= limit and -limit <= y <= limit and -limit <= z <= limit


def _geodetic(lat: int, lon: int, alt_mm: int) -> Geodetic | None:
    """From 1e-7 degrees and millimetres; None out of range, and for 0/0, which autopilots send
    before they have a fix."""
    altitude_m = alt_mm * 1e-3
    nowhere = lat == 0 and lon == 0
    if nowhere or abs(lat) > 900_000_000 or abs(lon) > 1_800_000_000:
        return None
    return (
        Geodetic(lat * 1e-7, lon * 1e-7, altitude_m) if abs(altitude_m) <= MAX_ALTITUDE_M else None
    )


FOLDS: dict[str, Callable[[Telemetry, Any, float], bool]] = {
    "HEARTBEAT": _heartbeat,
    "LOCAL_POSITION_NED": _local_position,
    "GLOBAL_POSITION_INT": _global_position,
    "GPS_GLOBAL_ORIGIN": _global_origin,
    "SYS_STATUS": _system_status,
    "BATTERY_STATUS": _battery_status,
    "ATTITUDE": _attitude,
    "EXTENDED_SYS_STATE": _extended_state,
    "EKF_STATUS_REPORT": _estimate,
    "ESTIMATOR_STATUS": _estimate,
    "GPS_RAW_INT": _gps,
    "WIND": _wind,
    "WIND_COV": _wind_cov,
    "TIMESYNC": _timesync,
    "ADSB_VEHICLE": _traffic,
    "STATUSTEXT": _status_text,
    "COMMAND_ACK": _command_ack,
    "PARAM_VALUE": _parameter_value,
    "AUTOPILOT_VERSION": _version,
}
"""All other messages of the vehicle are counted and dropped."""

_IDS: dict[str, int] = {
    m.msgname: number for number, m in dialect.mavlink_map.items() if m.msgname in FOLDS
}
FOLDS_BY_ID = {number: FOLDS[name] for name, number in _IDS.items()}


def fold(heard: Telemetry, message: Any, now: float) -> bool:
    """Fold and count one decoded message of the table; False (nothing has changed) if refused."""
    number: int = message.get_msgId()  # not `.id`: some messages have a field of that name
    if not FOLDS_BY_ID[number](heard, message, now):
        return False
    heard.count(number)
    return True


def message_id(name: str) -> int:
    """The number of a message of the table (KeyError for another name)."""
    return _IDS[name]
