"""Parameters: a fixed, ordered set of names with types, defaults and values; those of an ArduCopter
and of a PX4 have the values of a new vehicle unless said otherwise. Pure.

On the wire every value is a float: ArduPilot casts (`CAST`), PX4 puts an integer's bytes there
(`BYTEWISE`).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from enum import IntEnum
from typing import Any, NamedTuple


class ParamType(IntEnum):
    """MAV_PARAM_TYPE, as far as used."""

    INT8 = 2
    INT16 = 4
    INT32 = 6
    REAL32 = 9


class TypedValue(NamedTuple):
    """A parameter's value and its type."""

    type: ParamType
    value: float


def int8(value: int) -> TypedValue:
    return TypedValue(ParamType.INT8, float(value))


def int16(value: int) -> TypedValue:
    return TypedValue(ParamType.INT16, float(value))


def typed(values: Mapping[str, int | float | TypedValue]) -> dict[str, TypedValue]:
    """A table of parameters; a plain int is an INT32, a float a REAL32."""
    return {
        name: value
        if isinstance(value, TypedValue)
        else TypedValue(
            ParamType.INT32 if isinstance(value, int) else ParamType.REAL32, float(value)
        )
        for name, value in values.items()
    }


class Encoding(NamedTuple):
    """How values of a persona go over the wire."""

    encode: Callable[[ParamType, float], float]
    decode: Callable[[ParamType, float], float]


def _cast(kind: ParamType, value: float) -> float:
    return value if kind is ParamType.REAL32 or not math.isfinite(value) else float(round(value))


def _to_bytes(kind: ParamType, value: float) -> float:
    if kind is ParamType.REAL32:
        return value
    return float(struct.unpack("<f", struct.pack("<i", round(value)))[0])


def _from_bytes(kind: ParamType, wire: float) -> float:
    if kind is ParamType.REAL32:
        return wire
    return float(struct.unpack("<i", struct.pack("<f", wire))[0])


CAST = Encoding(_cast, _cast)
"""The number itself."""
BYTEWISE = Encoding(_to_bytes, _from_bytes)
"""A float that has the integer's bytes."""


class Parameters:
    """A persona's parameter set. Index and count never change while it runs."""

    def __init__(self, defaults: Mapping[str, TypedValue], encoding: Encoding) -> None:
        self._items = dict(defaults)
        self.names = tuple(defaults)
        self._index = {name: i for i, name in enumerate(self.names)}
        self._encoding = encoding
        self.version = 0
        """Counts changes."""

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, name: str) -> float:
        return self._items[name].value

    def __contains__(self, name: str) -> bool:
        return name in self._items

    def name_at(self, index: int) -> str | None:
        """The name with this index; None where there is none."""
        return self.names[index] if 0 <= index < len(self.names) else None

    def set(self, name: str, value: float) -> None:
        """Sets a known parameter."""
        self._items[name] = TypedValue(self._items[name].type, value)
        self.version += 1

    def takes(self, name: str, kind: int) -> bool:
        """Whether a PARAM_SET with this MAV_PARAM_TYPE may set it: bytes tell nothing of another
        type; a number is one of any."""
        return self._encoding is not BYTEWISE or kind == self._items[name].type

    def set_from_wire(self, name: str, wire: float) -> bool:
        """Sets a known parameter from PARAM_SET's float; False, and nothing changed, where that
        isn't a number."""
        value = self._encoding.decode(self._items[name].type, wire)
        if not math.isfinite(value):
            return False
        self.set(name, value)
        return True

    def value_message(self, name: str) -> dict[str, Any]:
        """The fields of this parameter's PARAM_VALUE."""
        item = self._items[name]
        return {
            "param_id": name.encode(),
            "param_value": self._encoding.encode(item.type, item.value),
            "param_type": int(item.type),
            "param_count": len(self.names),
            "param_index": self._index[name],
        }


# Faults and weather, the same for both personas, all off by default: real parameters of the
# vehicle, which a client sets live over MAVLink, a configuration at start or at a given time.
# Switches are INT32: PX4's clients know no shorter integers.
SIM_DEFAULTS: dict[str, TypedValue] = typed(
    {
        "SIM_ARM_REFUSE": 0,  # 1: pre-arm checks fail
        "SIM_BATT_DRAIN": 1.0,  # factor on the consumption
        "SIM_BATT_FAIL": 0,  # 1: as good as empty at once
        "SIM_COLL_FALL": 0,  # 1: falls after touching another vehicle
        "SIM_DELAY": 0.0,  # s, of every frame, both ways
        "SIM_GPS_ACC": 0.3,  # m, the accuracy that receiver and estimator tell
        "SIM_GPS_DRIFT": 0.0,  # m, standard deviation of the slow error (a minute)
        "SIM_GPS_FREEZE": 0,  # 1: position and velocity stay as they are
        "SIM_GPS_JUMP_D": 0.0,  # m, added to the position
        "SIM_GPS_JUMP_E": 0.0,
        "SIM_GPS_JUMP_N": 0.0,
        "SIM_GPS_NOISE": 0.0,  # m, standard deviation of the quick error (a second)
        "SIM_GPS_OFF": 0,  # 1: no fix, no position estimate
        "SIM_GPS_SATS": 12,  # satellites that the receiver tells
        "SIM_HB_MUTE": 0,  # 1: no HEARTBEAT
        "SIM_LOSS": 0.0,  # percent of frames lost, both ways
        "SIM_MOTOR_STOP": 0,  # 1: falls
        "SIM_REBOOT": 0,  # 1: restarts at once, in flight too; goes back to 0
        "SIM_VEL_NOISE": 0.0,  # m/s, standard deviation of the velocity estimate's error in flight
        "SIM_WIND_DIR": 0.0,  # deg, where the wind comes from
        "SIM_WIND_GUST": 0.0,  # m/s, standard deviation of gusts
        "SIM_WIND_SPD": 0.0,  # m/s
    }
)


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


_PX4_GAINS = {"P": 0.15, "I": 0.2, "D": 0.003}
_PX4_INERT = typed(
    {
        f"RC{i}_{end}": value
        for i in range(1, 9)
        for end, value in (("MIN", 1100.0), ("TRIM", 1500.0), ("MAX", 1900.0))
    }
    | {f"COM_FLTMODE{i}": -1 for i in range(1, 7)}
    | {
        f"MC_{axis}RATE_{gain}": value
        for axis in ("PITCH", "ROLL")
        for gain, value in _PX4_GAINS.items()
    }
    | {
        "BAT_LOW_THR": 0.15,
        "BAT_EMERGEN_THR": 0.05,
        "CBRK_SUPPLY_CHK": 894281,
        "COM_ARM_WO_GPS": 1,
        "COM_RC_IN_MODE": 1,
        "EKF2_AID_MASK": 1,
        "GF_ACTION": 2,
        "GF_MAX_HOR_DIST": 0.0,
        "GF_MAX_VER_DIST": 0.0,
        "MAV_TYPE": 2,
        "MIS_YAWMODE": 0,
        "MPC_TILTMAX_AIR": 45.0,
        "MPC_XY_P": 0.95,
        "MPC_XY_VEL_I_ACC": 0.4,
        "MPC_XY_VEL_P_ACC": 1.8,
        "MPC_Z_P": 1.0,
        "MPC_Z_VEL_I_ACC": 2.0,
        "MPC_Z_VEL_MAX_DN": 1.5,
        "MPC_Z_VEL_MAX_UP": 3.0,
        "MPC_Z_VEL_P_ACC": 4.0,
        "NAV_RCL_ACT": 2,
        "SDLOG_MODE": 0,
        "SENS_BOARD_ROT": 0,
        "SYS_HAS_BARO": 1,
        "SYS_HAS_GPS": 1,
        "SYS_HAS_MAG": 1,
        "SYS_HITL": 0,
    }
)
"""Clients ask for them and show them; nothing flies by them here."""

PX4_DEFAULTS = _PX4_INERT | typed(
    {
        "BAT1_CAPACITY": 3300.0,
        "BAT_CRIT_THR": 0.07,
        "COM_DISARM_LAND": 2.0,
        "COM_DISARM_PRFLT": 10.0,
        "COM_DL_LOSS_T": 10,
        "COM_LOW_BAT_ACT": 0,
        "COM_OBL_RC_ACT": 0,
        "COM_OF_LOSS_T": 1.0,
        "COM_SPOOLUP_TIME": 1.0,
        "EKF2_DRAG_CTRL": 0,  # no estimate of the wind
        "MAV_SYS_ID": 1,
        "MIS_TAKEOFF_ALT": 2.5,
        "MPC_LAND_ALT1": 10.0,
        "MPC_LAND_ALT2": 5.0,
        "MPC_LAND_SPEED": 0.7,
        "MPC_TKO_RAMP_T": 3.0,
        "MPC_TKO_SPEED": 1.5,
        "MPC_XY_CRUISE": 5.0,
        "MPC_XY_VEL_MAX": 12.0,
        "MPC_Z_V_AUTO_DN": 1.5,
        "MPC_Z_V_AUTO_UP": 3.0,
        "NAV_ACC_RAD": 2.0,
        "NAV_DLL_ACT": 0,
        "RTL_DESCEND_ALT": 10.0,
        "RTL_LAND_DELAY": 0.0,
        "RTL_RETURN_ALT": 30.0,
        "SYS_AUTOSTART": 10040,
    }
)
