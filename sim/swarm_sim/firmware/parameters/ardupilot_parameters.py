"""ArduCopter's parameters, with the values of a new vehicle unless said otherwise."""

from __future__ import annotations

from swarm_sim.firmware.parameters.parameter_set import int8, int16, typed

_GAINS = {"P": 0.135, "I": 0.135, "D": 0.0036}
_INERT = typed(
    {f"FLTMODE{i}": int8(mode) for i, mode in enumerate((7, 9, 6, 3, 5, 0), start=1)}
    | {
        f"RC{i}_{end}": int16(value)
        for i in range(1, 9)
        for end, value in (("MIN", 1100), ("TRIM", 1500), ("MAX", 1900))
    }
    | {f"SERVO{i}_FUNCTION": int16(32 + i) for i in range(1, 5)}
    | {
        f"RCMAP_{name}": int8(i)
        for i, name in enumerate(("ROLL", "PITCH", "THROTTLE", "YAW"), start=1)
    }
    | {f"ATC_RAT_{axis}_{gain}": value for axis in ("PIT", "RLL") for gain, value in _GAINS.items()}
    | {
        "ANGLE_MAX": int16(3000),
        "BATT_FS_CRT_ACT": int8(0),
        "COMPASS_USE": int8(1),
        "FENCE_ACTION": int8(1),
        "FENCE_ALT_MAX": 100.0,
        "FENCE_RADIUS": 150.0,
        "FENCE_TYPE": int8(7),
        "FS_EKF_ACTION": int8(1),
        "FS_THR_ENABLE": int8(0),
        "INS_GYRO_FILTER": int16(20),
        "LOG_BITMASK": 176126,
        "LOIT_SPEED": 1250.0,
        "MIS_RESTART": int8(0),
        "MOT_SPIN_ARM": 0.1,
        "MOT_SPIN_MIN": 0.15,
        "PILOT_SPEED_UP": int16(250),
        "PSC_ANGLE_MAX": 0.0,
        "PSC_POSXY_P": 1.0,
        "PSC_VELXY_I": 1.0,
        "PSC_VELXY_P": 2.0,
        "RALLY_LIMIT_KM": 0.3,
        "RALLY_TOTAL": int8(0),
        "SR0_EXTRA1": int16(0),
        "SR0_POSITION": int16(0),
        "STAT_BOOTCNT": int16(1),
        "SYSID_ENFORCE": int8(0),
        "WP_YAW_BEHAVIOR": int8(2),
    }
)
"""Clients ask for them and show them; nothing flies by them here."""

ARDUPILOT_DEFAULTS = _INERT | typed(
    {
        "ARMING_CHECK": 1,
        "BATT_CAPACITY": 3300,
        "BATT_FS_LOW_ACT": int8(0),
        "BATT_LOW_MAH": 0.0,
        "BATT_LOW_VOLT": 10.5,
        "BATT_MONITOR": int8(4),
        "DISARM_DELAY": int8(10),
        "EK3_DRAG_BCOEF_X": 0.0,  # no estimate of the wind
        "EK3_DRAG_BCOEF_Y": 0.0,
        "FENCE_ENABLE": int8(0),
        "FRAME_CLASS": int8(1),
        "FRAME_TYPE": int8(1),
        "FS_GCS_ENABLE": int8(0),
        "FS_GCS_TIMEOUT": 5.0,
        "FS_OPTIONS": 16,
        "GUID_OPTIONS": 0,
        "GUID_TIMEOUT": 3.0,
        "LAND_ALT_LOW": int16(1000),
        "LAND_SPEED": int16(50),
        "LAND_SPEED_HIGH": int16(0),
        "MAV_GCS_SYSID": int16(255),
        "MAV_GCS_SYSID_HI": int16(0),
        "MAV_SYSID": int16(1),
        "PSC_JERK_XY": 5.0,
        "RTL_ALT": 1500,
        "RTL_ALT_FINAL": int16(0),
        "RTL_LOIT_TIME": 5000,
        "RTL_SPEED": int16(0),
        "WPNAV_ACCEL": 250.0,
        "WPNAV_ACCEL_Z": 100.0,
        "WPNAV_RADIUS": 200.0,
        "WPNAV_SPEED": 1000.0,
        "WPNAV_SPEED_DN": 150.0,
        "WPNAV_SPEED_UP": 250.0,
    }
)
