"""What each streamed message says: one builder a message, from the firmware's state to MAVLink
fields. Pure.

A builder gives the fields of each message to send: usually one, none while its source isn't there
yet.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from sim.firmware.message import (
    MAV_MODE_FLAG_CUSTOM,
    MAV_MODE_FLAG_SAFETY_ARMED,
    MAV_STATE_ACTIVE,
    MAV_STATE_CRITICAL,
    MAV_STATE_STANDBY,
    MAV_TYPE_QUADROTOR,
)
from sim.physics.vehicle import GRAVITY_MPS2

if TYPE_CHECKING:
    from sim.firmware.base import Firmware

Fields = dict[str, Any]

_SENSORS = 0x20 | 0x01 | 0x02 | 0x04 | 0x08  # GPS, gyro, accelerometer, magnetometer, pressure
_AHRS, _BATTERY, _PREARM = 0x200000, 0x2000000, 0x10000000
_EKF_READY, _EKF_STARTING = 831, 1 | 128 | 1024
_ESTIMATOR_READY, _ESTIMATOR_STARTING = 831, 1
_UNIX_EPOCH_S = 1_700_000_000
"""Wall-clock time of mission time 0 as told to clients: fixed, so that runs repeat."""


def heartbeat(f: Firmware) -> list[Fields]:
    """HEARTBEAT."""
    state = (
        MAV_STATE_STANDBY if not f.armed else MAV_STATE_CRITICAL if f.failsafe else MAV_STATE_ACTIVE
    )
    armed = MAV_MODE_FLAG_SAFETY_ARMED if f.armed else 0
    return [
        {
            "type": MAV_TYPE_QUADROTOR,
            "autopilot": f.autopilot,
            "base_mode": MAV_MODE_FLAG_CUSTOM | f.mode_flags() | armed,
            "custom_mode": f.custom_mode(),
            "system_status": state,
            "mavlink_version": 3,
        }
    ]


def sys_status(f: Firmware) -> list[Fields]:
    """SYS_STATUS; the pre-arm bit is healthy when arming would succeed."""
    present = _SENSORS | _AHRS | _BATTERY | _PREARM
    health = _SENSORS | _BATTERY if f.fix() else _SENSORS & ~0x20 | _BATTERY
    if f.ready():
        health |= _AHRS
    if f.armable():
        health |= _PREARM
    return [
        {
            "onboard_control_sensors_present": present,
            "onboard_control_sensors_enabled": present,
            "onboard_control_sensors_health": health,
            "load": 150,
            "voltage_battery": round(f.battery.voltage_v * 1000),
            "current_battery": round(f.battery.current_a * 100),
            "battery_remaining": f.battery.percent(),
            "drop_rate_comm": 0,
            "errors_comm": 0,
            "errors_count1": 0,
            "errors_count2": 0,
            "errors_count3": 0,
            "errors_count4": 0,
        }
    ]


def system_time(f: Firmware) -> list[Fields]:
    """SYSTEM_TIME."""
    return [{"time_unix_usec": round((_UNIX_EPOCH_S + f.now) * 1e6), "time_boot_ms": f.boot_ms()}]


def gps_raw_int(f: Firmware) -> list[Fields]:
    """GPS_RAW_INT."""
    if not f.fix():
        return [_gps(f, fix=1, place=(0, 0, 0), satellites=0)]
    at = f.plane.geodetic_from_ned(f.sensed.position_ned_m)
    return [
        _gps(
            f,
            fix=3,
            place=(round(at.lat_deg * 1e7), round(at.lon_deg * 1e7), round(at.alt_m * 1e3)),
            satellites=12,
        )
    ]


def _gps(f: Firmware, fix: int, place: tuple[int, int, int], satellites: int) -> Fields:
    north, east, _ = f.sensed.velocity_ned_mps
    return {
        "time_usec": f.boot_ms() * 1000,
        "fix_type": fix,
        "lat": place[0],
        "lon": place[1],
        "alt": place[2],
        "eph": 121 if fix >= 3 else 9999,
        "epv": 200 if fix >= 3 else 9999,
        "vel": round(math.hypot(north, east) * 100),
        "cog": round(math.degrees(math.atan2(east, north)) % 360 * 100) % 36000,
        "satellites_visible": satellites,
    }


def attitude(f: Firmware) -> list[Fields]:
    """ATTITUDE: leaning to where the rotors pull."""
    north, east, down = f.sensed.thrust_ned_mps2
    heading = f.sensed.heading_rad
    c, s = math.cos(heading), math.sin(heading)
    up = GRAVITY_MPS2 - down
    forward, right = c * north + s * east, c * east - s * north
    return [
        {
            "time_boot_ms": f.boot_ms(),
            "roll": math.atan2(right, math.hypot(up, forward)),
            "pitch": -math.atan2(forward, up),
            "yaw": math.remainder(heading, 2 * math.pi),
            "rollspeed": 0.0,
            "pitchspeed": 0.0,
            "yawspeed": 0.0,
        }
    ]


def local_position_ned(f: Firmware) -> list[Fields]:
    """LOCAL_POSITION_NED, from this vehicle's own origin."""
    if not f.ready():
        return []
    x, y, z = f.local_position()
    vx, vy, vz = f.sensed.velocity_ned_mps
    return [{"time_boot_ms": f.boot_ms(), "x": x, "y": y, "z": z, "vx": vx, "vy": vy, "vz": vz}]


def global_position_int(f: Firmware) -> list[Fields]:
    """GLOBAL_POSITION_INT."""
    if not f.ready():
        return []
    at = f.plane.geodetic_from_ned(f.sensed.position_ned_m)
    vx, vy, vz = f.sensed.velocity_ned_mps
    return [
        {
            "time_boot_ms": f.boot_ms(),
            "lat": round(at.lat_deg * 1e7),
            "lon": round(at.lon_deg * 1e7),
            "alt": round(at.alt_m * 1e3),
            "relative_alt": round((f.home_ned[2] - f.sensed.position_ned_m[2]) * 1e3),
            "vx": _centi(vx),
            "vy": _centi(vy),
            "vz": _centi(vz),
            "hdg": _centidegrees(f.sensed.heading_rad),
        }
    ]


def gps_global_origin(f: Firmware) -> list[Fields]:
    """GPS_GLOBAL_ORIGIN: where LOCAL_POSITION_NED counts from."""
    if not f.ready():
        return []
    at = f.plane.geodetic_from_ned(f.local_origin_ned)
    place = {"latitude": round(at.lat_deg * 1e7), "longitude": round(at.lon_deg * 1e7)}
    return [place | {"altitude": round(at.alt_m * 1e3), "time_usec": f.boot_ms() * 1000}]


def home_position(f: Firmware) -> list[Fields]:
    """HOME_POSITION."""
    if not f.ready():
        return []
    at = f.plane.geodetic_from_ned(f.home_ned)
    x, y, z = (h - o for h, o in zip(f.home_ned, f.local_origin_ned, strict=True))
    place = {
        "latitude": round(at.lat_deg * 1e7),
        "longitude": round(at.lon_deg * 1e7),
        "altitude": round(at.alt_m * 1e3),
    }
    approach = {"approach_x": 0.0, "approach_y": 0.0, "approach_z": 0.0}
    return [
        place
        | {"x": x, "y": y, "z": z, "q": [1.0, 0.0, 0.0, 0.0], "time_usec": f.boot_ms() * 1000}
        | approach
    ]


def vfr_hud(f: Firmware) -> list[Fields]:
    """VFR_HUD."""
    north, east, down = f.sensed.velocity_ned_mps
    speed = math.hypot(north, east)
    return [
        {
            "airspeed": speed,
            "groundspeed": speed,
            "heading": _centidegrees(f.sensed.heading_rad) // 100,
            "throttle": 0 if f.sensed.landed else 35,
            "alt": f.plane.origin.alt_m - f.sensed.position_ned_m[2],
            "climb": -down,
        }
    ]


def position_target_local_ned(f: Firmware) -> list[Fields]:
    """POSITION_TARGET_LOCAL_NED: the velocity, and where held the position, that the vehicle
    follows now."""
    demand = f.demand
    held = [p is not None for p in demand.position_ned_m]
    axes = zip(demand.position_ned_m, f.local_origin_ned, strict=True)
    x, y, z = (0.0 if p is None else p - o for p, o in axes)
    vx, vy, vz = demand.velocity_ned_mps
    mask = sum(1 << i for i in range(3) if not held[i]) | 0b111 << 6 | 1 << 11
    target = {
        "x": x,
        "y": y,
        "z": z,
        "vx": vx,
        "vy": vy,
        "vz": vz,
        "afx": 0.0,
        "afy": 0.0,
        "afz": 0.0,
    }
    yaw = {"yaw": demand.heading_rad, "yaw_rate": 0.0}
    return [{"time_boot_ms": f.boot_ms(), "coordinate_frame": 1, "type_mask": mask} | target | yaw]


def battery_status(f: Firmware) -> list[Fields]:
    """BATTERY_STATUS."""
    return [
        {
            "id": 0,
            "battery_function": 0,
            "type": 1,
            "temperature": 32767,
            "voltages": [round(f.battery.voltage_v * 1000)] + [65535] * 9,
            "current_battery": round(f.battery.current_a * 100),
            "current_consumed": round(f.battery.used_mah),
            "energy_consumed": -1,
            "battery_remaining": f.battery.percent(),
        }
    ]


def autopilot_version(f: Firmware) -> list[Fields]:
    """AUTOPILOT_VERSION."""
    blank = {
        "middleware_sw_version": 0,
        "os_sw_version": 0,
        "board_version": 0,
        "vendor_id": 0,
        "product_id": 0,
    }
    customs = {f"{kind}_custom_version": [0] * 8 for kind in ("flight", "middleware", "os")}
    who = {"capabilities": f.capabilities, "flight_sw_version": f.version, "uid": f.sysid}
    return [who | blank | customs]


def ekf_status_report(f: Firmware) -> list[Fields]:
    """EKF_STATUS_REPORT."""
    variances = ("velocity", "pos_horiz", "pos_vert", "compass", "terrain_alt")
    flags = {"flags": _EKF_READY if f.ready() else _EKF_STARTING}
    return [flags | {f"{name}_variance": 0.01 for name in variances}]


def estimator_status(f: Firmware) -> list[Fields]:
    """ESTIMATOR_STATUS."""
    ratios = (
        "vel_ratio",
        "pos_horiz_ratio",
        "pos_vert_ratio",
        "mag_ratio",
        "hagl_ratio",
        "tas_ratio",
    )
    flags = {
        "time_usec": f.boot_ms() * 1000,
        "flags": _ESTIMATOR_READY if f.ready() else _ESTIMATOR_STARTING,
    }
    return [
        flags | dict.fromkeys(ratios, 0.01) | {"pos_horiz_accuracy": 0.3, "pos_vert_accuracy": 0.4}
    ]


def extended_sys_state(f: Firmware) -> list[Fields]:
    """EXTENDED_SYS_STATE."""
    return [{"vtol_state": 0, "landed_state": int(f.landed_state())}]


def adsb_vehicle(f: Firmware) -> list[Fields]:
    """ADSB_VEHICLE: one a vehicle in sensing range; the address is its system id."""
    return [_contact(f, *contact) for contact in f.traffic()]


def _contact(
    f: Firmware,
    sysid: int,
    position: tuple[float, float, float],
    velocity: tuple[float, float, float],
) -> Fields:
    at = f.plane.geodetic_from_ned(position)
    north, east, down = velocity
    return {
        "ICAO_address": sysid,
        "lat": round(at.lat_deg * 1e7),
        "lon": round(at.lon_deg * 1e7),
        "altitude_type": 1,
        "altitude": round(at.alt_m * 1e3),
        "heading": round(math.degrees(math.atan2(east, north)) % 360 * 100) % 36000,
        "hor_velocity": round(math.hypot(north, east) * 100),
        "ver_velocity": _centi(-down),
        "callsign": f"SIM{sysid:04d}".encode(),
        "emitter_type": 14,
        "tslc": 0,
        "flags": 0x1 | 0x2 | 0x4 | 0x8 | 0x10,
        "squawk": 0,
    }


def _centi(value: float) -> int:
    return max(-32767, min(32767, round(value * 100)))


def _centidegrees(angle_rad: float) -> int:
    return round(math.degrees(angle_rad) % 360 * 100) % 36000


def mission_current(f: Firmware) -> list[Fields]:
    """MISSION_CURRENT."""
    return [f.mission_current()]


def wind(f: Firmware) -> list[Fields]:
    """WIND: while EKF3 estimates it, which takes a tuned drag model and flight. Gusts are averaged
    out."""
    if not _tells_wind(f, "EK3_DRAG_BCOEF_X", "EK3_DRAG_BCOEF_Y"):
        return []
    from_deg = math.remainder(f.parameters["SIM_WIND_DIR"], 360.0)
    return [{"direction": from_deg, "speed": f.parameters["SIM_WIND_SPD"], "speed_z": 0.0}]


def wind_cov(f: Firmware) -> list[Fields]:
    """WIND_COV: while EKF2 estimates it, which takes EKF2_DRAG_CTRL and flight. Gusts are averaged
    out."""
    if not _tells_wind(f, "EKF2_DRAG_CTRL"):
        return []
    speed, from_rad = f.parameters["SIM_WIND_SPD"], math.radians(f.parameters["SIM_WIND_DIR"])
    blows = {
        "wind_x": -speed * math.cos(from_rad),
        "wind_y": -speed * math.sin(from_rad),
        "wind_z": 0.0,
    }
    certainty = {"var_horiz": 0.2, "var_vert": 0.0, "horiz_accuracy": 0.0, "vert_accuracy": 0.0}
    height = f.plane.origin.alt_m - f.sensed.position_ned_m[2]
    return [{"time_usec": f.boot_ms() * 1000, "wind_alt": height} | blows | certainty]


def _tells_wind(f: Firmware, *switches: str) -> bool:
    return not f.sensed.landed and all(
        name in f.parameters and f.parameters[name] > 0 for name in switches
    )


BUILDERS: dict[str, Callable[[Firmware], list[Fields]]] = {
    "HEARTBEAT": heartbeat,
    "SYS_STATUS": sys_status,
    "SYSTEM_TIME": system_time,
    "GPS_RAW_INT": gps_raw_int,
    "ATTITUDE": attitude,
    "LOCAL_POSITION_NED": local_position_ned,
    "GLOBAL_POSITION_INT": global_position_int,
    "GPS_GLOBAL_ORIGIN": gps_global_origin,
    "VFR_HUD": vfr_hud,
    "POSITION_TARGET_LOCAL_NED": position_target_local_ned,
    "BATTERY_STATUS": battery_status,
    "AUTOPILOT_VERSION": autopilot_version,
    "EKF_STATUS_REPORT": ekf_status_report,
    "ESTIMATOR_STATUS": estimator_status,
    "HOME_POSITION": home_position,
    "EXTENDED_SYS_STATE": extended_sys_state,
    "ADSB_VEHICLE": adsb_vehicle,
    "MISSION_CURRENT": mission_current,
    "WIND": wind,
    "WIND_COV": wind_cov,
}
