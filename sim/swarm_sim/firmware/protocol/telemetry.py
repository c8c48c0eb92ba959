"""What each streamed message says: one builder a message, from the autopilot's state to MAVLink
fields. Pure.

A builder gives None while its source isn't there yet, and a list where several messages are due at
once; fields that it leaves out are zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from swarm_sim.firmware.autopilot import SimAutopilot
from swarm_sim.firmware.message import MAV_MODE_FLAG_CUSTOM
from swarm_sim.firmware.protocol.uploaded_mission import mission_current
from swarm_sim.physics.geodesy import TangentPlane, Vector3
from swarm_sim.physics.kinematics import GRAVITY_MPS2

Fields = dict[str, Any]

_QUADROTOR = 2
"""MAV_TYPE."""
_ARMED, _STABILIZE, _GUIDED = 128, 16, 8
"""MAV_MODE_FLAG."""
_STANDBY, _ACTIVE, _CRITICAL = 3, 4, 5
"""MAV_STATE."""
_GPS, _SENSORS = 0x20, 0x20 | 0x01 | 0x02 | 0x04 | 0x08  # gyro, accelerometer, compass, pressure
_AHRS, _BATTERY, _PREARM = 0x200000, 0x2000000, 0x10000000
_READY, _EKF_STARTING, _ESTIMATOR_STARTING = 831, 1 | 128 | 1024, 1
_EKF_GLITCH = 32768
_UNIX_EPOCH_S = 1_700_000_000
"""Wall-clock time of mission time 0 as told to clients: fixed, so that runs repeat."""


def heartbeat(a: SimAutopilot) -> Fields:
    flags = MAV_MODE_FLAG_CUSTOM | _STABILIZE | (_GUIDED if a.mode.guided else 0)
    state = _STANDBY
    if a.armed:
        flags |= _ARMED
        state = _CRITICAL if a.failsafe else _ACTIVE
    return {
        "type": _QUADROTOR,
        "autopilot": a.autopilot,
        "base_mode": flags,
        "custom_mode": a.mode.custom,
        "system_status": state,
        "mavlink_version": 3,
    }


def sys_status(a: SimAutopilot) -> Fields:
    """The pre-arm bit is healthy when arming would succeed."""
    enabled = _SENSORS | _AHRS | _BATTERY | _PREARM
    health = _SENSORS | _BATTERY if a.fix() else _SENSORS & ~_GPS | _BATTERY
    health |= a.fence_bit
    if a.ready():
        health |= _AHRS
    if a.armable():
        health |= _PREARM
    return {
        "onboard_control_sensors_present": enabled | a.fence_bit,
        "onboard_control_sensors_enabled": enabled,
        "onboard_control_sensors_health": health,
        "load": 150,
        "voltage_battery": round(a.battery.voltage_v * 1000),
        "current_battery": round(a.battery.current_a * 100),
        "battery_remaining": a.battery.percent(),
    }


def system_time(a: SimAutopilot) -> Fields:
    return {"time_unix_usec": round((_UNIX_EPOCH_S + a.now) * 1e6), "time_boot_ms": a.boot_ms()}


def gps_raw_int(a: SimAutopilot) -> Fields:
    north, east, _ = a.sensed.velocity_ned_mps
    course = {
        "time_usec": a.boot_ms() * 1000,
        "vel": round(math.hypot(north, east) * 100),
        "cog": _centidegrees(math.atan2(east, north)),
    }
    if not a.fix():
        return course | {"fix_type": 1, "eph": 9999, "epv": 9999}
    accuracy_mm, satellites = a.parameters["SIM_GPS_ACC"] * 1e3, a.parameters["SIM_GPS_SATS"]
    fix = {"fix_type": 3, "eph": 121, "epv": 200}
    fix |= {"h_acc": _natural(accuracy_mm, 2**32), "satellites_visible": _natural(satellites, 255)}
    return course | fix | _place(a, a.sensed.position_ned_m)


def attitude(a: SimAutopilot) -> Fields:
    """Leaning to where the rotors pull."""
    north, east, down = a.sensed.thrust_ned_mps2
    heading = a.sensed.heading_rad
    c, s = math.cos(heading), math.sin(heading)
    up = GRAVITY_MPS2 - down
    forward, right = c * north + s * east, c * east - s * north
    return {
        "time_boot_ms": a.boot_ms(),
        "roll": math.atan2(right, math.hypot(up, forward)),
        "pitch": -math.atan2(forward, up),
        "yaw": math.remainder(heading, 2 * math.pi),
    }


def local_position_ned(a: SimAutopilot) -> Fields | None:
    """From this vehicle's own origin."""
    if not a.ready():
        return None
    x, y, z = a.local_position()
    vx, vy, vz = a.sensed.velocity_ned_mps
    return {"time_boot_ms": a.boot_ms(), "x": x, "y": y, "z": z, "vx": vx, "vy": vy, "vz": vz}


def global_position_int(a: SimAutopilot) -> Fields | None:
    if not a.ready():
        return None
    vx, vy, vz = a.sensed.velocity_ned_mps
    return _place(a, a.sensed.position_ned_m) | {
        "time_boot_ms": a.boot_ms(),
        "relative_alt": round((a.home_ned[2] - a.sensed.position_ned_m[2]) * 1e3),
        "vx": _centi(vx),
        "vy": _centi(vy),
        "vz": _centi(vz),
        "hdg": _centidegrees(a.sensed.heading_rad),
    }


def gps_global_origin(a: SimAutopilot) -> Fields | None:
    """Where LOCAL_POSITION_NED counts from."""
    if not a.ready():
        return None
    place = _place(a, a.local_origin_ned, ("latitude", "longitude", "altitude"))
    return place | {"time_usec": a.boot_ms() * 1000}


def home_position(a: SimAutopilot) -> Fields | None:
    if not a.ready():
        return None
    place = _place(a, a.home_ned, ("latitude", "longitude", "altitude"))
    x, y, z = (h - o for h, o in zip(a.home_ned, a.local_origin_ned, strict=True))
    upright = [1.0, 0.0, 0.0, 0.0]
    return place | {"x": x, "y": y, "z": z, "q": upright, "time_usec": a.boot_ms() * 1000}


def vfr_hud(a: SimAutopilot) -> Fields:
    north, east, down = a.sensed.velocity_ned_mps
    speed = math.hypot(north, east)
    return {
        "airspeed": speed,
        "groundspeed": speed,
        "heading": _centidegrees(a.sensed.heading_rad) // 100,
        "throttle": 0 if a.sensed.landed else 35,
        "alt": _height(a),
        "climb": -down,
    }


def position_target_local_ned(a: SimAutopilot) -> Fields:
    """The velocity, and where held the position, that the vehicle follows now."""
    demand = a.demand
    axes = zip(demand.position_ned_m, a.local_origin_ned, strict=True)
    x, y, z = (0.0 if p is None else p - o for p, o in axes)
    vx, vy, vz = demand.velocity_ned_mps
    free = sum(1 << i for i, p in enumerate(demand.position_ned_m) if p is None)
    return {
        "time_boot_ms": a.boot_ms(),
        "coordinate_frame": 1,
        "type_mask": free | 0b111 << 6 | 1 << 11,
        "x": x,
        "y": y,
        "z": z,
        "vx": vx,
        "vy": vy,
        "vz": vz,
        "yaw": demand.heading_rad,
    }


def battery_status(a: SimAutopilot) -> Fields:
    return {
        "type": 1,
        "temperature": 32767,
        "voltages": [round(a.battery.voltage_v * 1000)] + [65535] * 9,
        "current_battery": round(a.battery.current_a * 100),
        "current_consumed": round(a.battery.used_mah),
        "energy_consumed": -1,
        "battery_remaining": a.battery.percent(),
    }


def autopilot_version(a: SimAutopilot) -> Fields:
    return {"capabilities": a.capabilities, "flight_sw_version": a.version, "uid": a.sysid}


def ekf_status_report(a: SimAutopilot) -> Fields:
    variances = ("velocity", "pos_horiz", "pos_vert", "compass", "terrain_alt")
    found = {f"{name}_variance": 0.01 for name in variances}
    found["pos_horiz_variance"] = a.gps_jump.ratio(a.now)
    glitch = _EKF_GLITCH if a.gps_jump.flagged(a.now) else 0
    return found | {"flags": (_READY if a.ready() else _EKF_STARTING) | glitch}


def estimator_status(a: SimAutopilot) -> Fields:
    ratios = {f"{name}_ratio": 0.01 for name in ("vel", "pos_horiz", "pos_vert", "mag", "hagl")}
    flags = _READY if a.ready() else _ESTIMATOR_STARTING
    ratios["pos_horiz_ratio"] = a.gps_jump.ratio(a.now)
    accuracy = {"tas_ratio": 0.01, "pos_vert_accuracy": 0.4}
    accuracy["pos_horiz_accuracy"] = max(0.0, a.parameters["SIM_GPS_ACC"])
    return ratios | accuracy | {"time_usec": a.boot_ms() * 1000, "flags": flags}


def extended_sys_state(a: SimAutopilot) -> Fields:
    return {"landed_state": int(a.landed_state())}


def wind(a: SimAutopilot) -> Fields:
    """While EKF3 estimates it, for which it needs a drag model and flight. Gusts average out.
    Before, it sends its estimator's zero, in any wind."""
    if not _estimates_wind(a, "EK3_DRAG_BCOEF_X", "EK3_DRAG_BCOEF_Y"):
        return {"direction": -180.0, "speed": 0.0}
    from_deg = math.remainder(a.parameters["SIM_WIND_DIR"], 360.0)
    return {"direction": from_deg, "speed": a.parameters["SIM_WIND_SPD"]}


def wind_cov(a: SimAutopilot) -> Fields | None:
    """While EKF2 estimates it, which takes EKF2_DRAG_CTRL and flight. Gusts are averaged out."""
    if not _estimates_wind(a, "EKF2_DRAG_CTRL"):
        return None
    speed, from_rad = a.parameters["SIM_WIND_SPD"], math.radians(a.parameters["SIM_WIND_DIR"])
    return {
        "time_usec": a.boot_ms() * 1000,
        "wind_x": -speed * math.cos(from_rad),
        "wind_y": -speed * math.sin(from_rad),
        "wind_alt": _height(a),
        "var_horiz": 0.2,
    }


def _estimates_wind(a: SimAutopilot, *switches: str) -> bool:
    on = (name in a.parameters and a.parameters[name] > 0 for name in switches)
    return not a.sensed.landed and all(on)


def adsb_vehicle(a: SimAutopilot) -> list[Fields]:
    """One for each vehicle in sensing range; the address is its system id."""
    return [_contact(a.plane, *contact) for contact in a.traffic()]


@lru_cache(512)
def _contact(plane: TangentPlane, sysid: int, position: Vector3, velocity: Vector3) -> Fields:
    """The same for all vehicles that see it, so it is worked out once; not to be changed."""
    north, east, down = velocity
    return _on_ellipsoid(plane, position, ("lat", "lon", "altitude")) | {
        "ICAO_address": sysid,
        "altitude_type": 1,
        "heading": _centidegrees(math.atan2(east, north)),
        "hor_velocity": round(math.hypot(north, east) * 100),
        "ver_velocity": _centi(-down),
        "callsign": f"SIM{sysid:04d}".encode(),
        "emitter_type": 14,
        "tslc": 0,
        "flags": 0x1 | 0x2 | 0x4 | 0x8 | 0x10,
        "squawk": 0,
    }


def _place(
    a: SimAutopilot, ned_m: Vector3, names: tuple[str, str, str] = ("lat", "lon", "alt")
) -> Fields:
    return _on_ellipsoid(a.plane, ned_m, names)


def _on_ellipsoid(plane: TangentPlane, ned_m: Vector3, names: tuple[str, str, str]) -> Fields:
    """A point on the ellipsoid: 1e-7 degrees, millimetres."""
    at = plane.geodetic_from_ned(ned_m)
    numbers = round(at.lat_deg * 1e7), round(at.lon_deg * 1e7), round(at.alt_m * 1e3)
    return dict(zip(names, numbers, strict=True))


def _height(a: SimAutopilot) -> float:
    return a.plane.origin.alt_m - a.sensed.position_ned_m[2]


def _natural(value: float, end: int) -> int:
    """Rounded and within 0 .. end - 1."""
    return max(0, min(end - 1, round(value)))


def _centi(value: float) -> int:
    return max(-32767, min(32767, round(value * 100)))


def _centidegrees(angle_rad: float) -> int:
    return round(math.degrees(angle_rad) % 360 * 100) % 36000


Builder = Callable[[SimAutopilot], Fields | list[Fields] | None]
MESSAGES: dict[str, tuple[int, Builder]] = {
    "HEARTBEAT": (0, heartbeat),
    "SYS_STATUS": (1, sys_status),
    "SYSTEM_TIME": (2, system_time),
    "GPS_RAW_INT": (24, gps_raw_int),
    "ATTITUDE": (30, attitude),
    "LOCAL_POSITION_NED": (32, local_position_ned),
    "MISSION_CURRENT": (42, mission_current),
    "GLOBAL_POSITION_INT": (33, global_position_int),
    "GPS_GLOBAL_ORIGIN": (49, gps_global_origin),
    "VFR_HUD": (74, vfr_hud),
    "POSITION_TARGET_LOCAL_NED": (85, position_target_local_ned),
    "BATTERY_STATUS": (147, battery_status),
    "AUTOPILOT_VERSION": (148, autopilot_version),
    "EKF_STATUS_REPORT": (193, ekf_status_report),
    "ESTIMATOR_STATUS": (230, estimator_status),
    "HOME_POSITION": (242, home_position),
    "EXTENDED_SYS_STATE": (245, extended_sys_state),
    "ADSB_VEHICLE": (246, adsb_vehicle),
    "WIND": (168, wind),
    "WIND_COV": (231, wind_cov),
}
"""Every message that can be streamed or requested: its number and builder."""


def readings(a: SimAutopilot, name: str) -> list[Fields]:
    """The fields of each message of this name to send now."""
    found = MESSAGES[name][1](a)
    if isinstance(found, list):
        return found
    return [] if found is None else [found]
