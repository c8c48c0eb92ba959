"""Parameters: a fixed, ordered set of names with types, defaults and values. Pure.

On the wire every value is a float: ArduPilot casts (`as_cast`), PX4 puts an integer's bytes there
(`as_bytes`).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum


class Kind(IntEnum):
    """MAV_PARAM_TYPE, as far as used."""

    INT8 = 2
    INT16 = 4
    INT32 = 6
    REAL32 = 9


@dataclass(frozen=True, slots=True)
class Parameter:
    """One value and its type."""

    kind: Kind
    value: float


def as_cast(kind: Kind, value: float) -> float:
    """ArduPilot's wire form, both ways: the number itself."""
    return value if kind is Kind.REAL32 or not math.isfinite(value) else float(round(value))


def to_bytes(kind: Kind, value: float) -> float:
    """PX4's wire form: a float whose bytes are the integer's."""
    if kind is Kind.REAL32:
        return value
    (wire,) = struct.unpack("<f", struct.pack("<i", round(value)))
    return float(wire)


def from_bytes(kind: Kind, wire: float) -> float:
    """The value of PX4's wire form."""
    if kind is Kind.REAL32:
        return wire
    (value,) = struct.unpack("<i", struct.pack("<f", wire))
    return float(value)


@dataclass(frozen=True, slots=True)
class Encoding:
    """How values of a persona go over the wire."""

    encode: Callable[[Kind, float], float]
    decode: Callable[[Kind, float], float]


CAST = Encoding(as_cast, as_cast)
BYTEWISE = Encoding(to_bytes, from_bytes)


class Parameters:
    """A persona's parameter set. Index and count never change while it runs."""

    def __init__(self, defaults: Mapping[str, Parameter], encoding: Encoding) -> None:
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
        self._items[name] = Parameter(self._items[name].kind, value)
        self.version += 1

    def set_from_wire(self, name: str, wire: float) -> bool:
        """Sets a known parameter from PARAM_SET's float; False, and nothing changed, where that
        isn't a number."""
        value = self._encoding.decode(self._items[name].kind, wire)
        if not math.isfinite(value):
            return False
        self.set(name, value)
        return True

    def value_message(self, name: str) -> dict[str, object]:
        """The fields of this parameter's PARAM_VALUE."""
        item = self._items[name]
        return {
            "param_id": name.encode(),
            "param_value": self._encoding.encode(item.kind, item.value),
            "param_type": int(item.kind),
            "param_count": len(self.names),
            "param_index": self._index[name],
        }


def _int8(value: int) -> Parameter:
    return Parameter(Kind.INT8, float(value))


def _int16(value: int) -> Parameter:
    return Parameter(Kind.INT16, float(value))


def _int32(value: int) -> Parameter:
    return Parameter(Kind.INT32, float(value))


def _real(value: float) -> Parameter:
    return Parameter(Kind.REAL32, value)


_CHANNELS = range(1, 9)
_ENDS = (("MIN", 1100), ("TRIM", 1500), ("MAX", 1900))
_RATE_GAINS = (("P", 0.135), ("I", 0.135), ("D", 0.0036))
_PX4_GAINS = (("P", 0.15), ("I", 0.2), ("D", 0.003))
ARDUPILOT_INERT: dict[str, Parameter] = (
    {f"FLTMODE{i}": _int8(mode) for i, mode in enumerate((7, 9, 6, 3, 5, 0), start=1)}
    | {f"RC{i}_{end}": _int16(value) for i in _CHANNELS for end, value in _ENDS}
    | {f"SERVO{i}_FUNCTION": _int16(32 + i) for i in range(1, 5)}
    | {
        f"RCMAP_{name}": _int8(i)
        for i, name in enumerate(("ROLL", "PITCH", "THROTTLE", "YAW"), start=1)
    }
    | {
        f"ATC_RAT_{axis}_{gain}": _real(value)
        for axis in ("PIT", "RLL")
        for gain, value in _RATE_GAINS
    }
    | {
        "ANGLE_MAX": _int16(3000),
        "BATT_FS_CRT_ACT": _int8(0),
        "COMPASS_USE": _int8(1),
        "FENCE_ACTION": _int8(1),
        "FENCE_ALT_MAX": _real(100.0),
        "FENCE_RADIUS": _real(150.0),
        "FENCE_TYPE": _int8(7),
        "FS_EKF_ACTION": _int8(1),
        "FS_THR_ENABLE": _int8(0),
        "INS_GYRO_FILTER": _int16(20),
        "LOG_BITMASK": _int32(176126),
        "LOIT_SPEED": _real(1250.0),
        "MIS_RESTART": _int8(0),
        "MOT_SPIN_ARM": _real(0.1),
        "MOT_SPIN_MIN": _real(0.15),
        "PILOT_SPEED_UP": _int16(250),
        "PSC_POSXY_P": _real(1.0),
        "PSC_VELXY_I": _real(1.0),
        "PSC_VELXY_P": _real(2.0),
        "RALLY_LIMIT_KM": _real(0.3),
        "RALLY_TOTAL": _int8(0),
        "SR0_EXTRA1": _int16(0),
        "SR0_POSITION": _int16(0),
        "STAT_BOOTCNT": _int16(1),
        "SYSID_ENFORCE": _int8(0),
        "WP_YAW_BEHAVIOR": _int8(2),
    }
)
"""Known by every ArduCopter, asked for and shown by clients; kept and told here, but nothing flies
by them."""
PX4_INERT: dict[str, Parameter] = (
    {f"RC{i}_{end}": _real(value) for i in _CHANNELS for end, value in _ENDS}
    | {f"COM_FLTMODE{i}": _int32(-1) for i in range(1, 7)}
    | {
        f"MC_{axis}RATE_{gain}": _real(value)
        for axis in ("PITCH", "ROLL")
        for gain, value in _PX4_GAINS
    }
    | {
        "BAT_LOW_THR": _real(0.15),
        "BAT_EMERGEN_THR": _real(0.05),
        "CBRK_SUPPLY_CHK": _int32(894281),
        "COM_ARM_WO_GPS": _int32(1),
        "COM_RC_IN_MODE": _int32(1),
        "EKF2_AID_MASK": _int32(1),
        "GF_ACTION": _int32(2),
        "GF_MAX_HOR_DIST": _real(0.0),
        "GF_MAX_VER_DIST": _real(0.0),
        "MAV_TYPE": _int32(2),
        "MIS_YAWMODE": _int32(0),
        "MPC_TILTMAX_AIR": _real(45.0),
        "MPC_XY_P": _real(0.95),
        "MPC_XY_VEL_I_ACC": _real(0.4),
        "MPC_XY_VEL_P_ACC": _real(1.8),
        "MPC_Z_P": _real(1.0),
        "MPC_Z_VEL_I_ACC": _real(2.0),
        "MPC_Z_VEL_MAX_DN": _real(1.5),
        "MPC_Z_VEL_MAX_UP": _real(3.0),
        "MPC_Z_VEL_P_ACC": _real(4.0),
        "NAV_RCL_ACT": _int32(2),
        "SDLOG_MODE": _int32(0),
        "SENS_BOARD_ROT": _int32(0),
        "SYS_HAS_BARO": _int32(1),
        "SYS_HAS_GPS": _int32(1),
        "SYS_HAS_MAG": _int32(1),
        "SYS_HITL": _int32(0),
    }
)
"""The same for PX4."""

ARDUPILOT_DEFAULTS: dict[str, Parameter] = ARDUPILOT_INERT | {
    "ARMING_CHECK": _int32(1),
    "BATT_CAPACITY": _int32(3300),
    "BATT_FS_LOW_ACT": _int8(0),
    "BATT_LOW_MAH": _real(0.0),
    "BATT_LOW_VOLT": _real(10.5),
    "BATT_MONITOR": _int8(4),
    "DISARM_DELAY": _int8(10),
    "EK3_DRAG_BCOEF_X": _real(
        12.0
    ),  # the real default is 0: no wind estimate; these vehicles are tuned
    "EK3_DRAG_BCOEF_Y": _real(12.0),
    "FENCE_ENABLE": _int8(0),
    "FRAME_CLASS": _int8(1),
    "FRAME_TYPE": _int8(1),
    "FS_GCS_ENABLE": _int8(0),
    "FS_GCS_TIMEOUT": _real(5.0),
    "FS_OPTIONS": _int32(16),
    "GUID_OPTIONS": _int32(0),
    "GUID_TIMEOUT": _real(3.0),
    "LAND_ALT_LOW": _int16(1000),
    "LAND_SPEED": _int16(50),
    "LAND_SPEED_HIGH": _int16(0),
    "MAV_GCS_SYSID": _int16(255),
    "MAV_SYSID": _int16(1),
    "PSC_JERK_XY": _real(5.0),
    "RTL_ALT": _int32(1500),
    "RTL_ALT_FINAL": _int16(0),
    "RTL_LOIT_TIME": _int32(5000),
    "RTL_SPEED": _int16(0),
    "WPNAV_ACCEL": _real(250.0),
    "WPNAV_ACCEL_Z": _real(100.0),
    "WPNAV_RADIUS": _real(200.0),
    "WPNAV_SPEED": _real(1000.0),
    "WPNAV_SPEED_DN": _real(150.0),
    "WPNAV_SPEED_UP": _real(250.0),
}
PX4_DEFAULTS: dict[str, Parameter] = PX4_INERT | {
    "BAT1_CAPACITY": _real(3300.0),
    "BAT_CRIT_THR": _real(0.07),
    "COM_DISARM_LAND": _real(2.0),
    "COM_DISARM_PRFLT": _real(10.0),
    "COM_DL_LOSS_T": _int32(10),
    "COM_LOW_BAT_ACT": _int32(0),
    "COM_OBL_RC_ACT": _int32(0),
    "COM_OF_LOSS_T": _real(1.0),
    "EKF2_DRAG_CTRL": _int32(
        1
    ),  # the real default is 0: no wind estimate; these vehicles are tuned
    "MAV_SYS_ID": _int32(1),
    "MIS_TAKEOFF_ALT": _real(2.5),
    "MPC_LAND_ALT1": _real(10.0),
    "MPC_LAND_ALT2": _real(5.0),
    "MPC_LAND_SPEED": _real(0.7),
    "MPC_TKO_SPEED": _real(1.5),
    "MPC_XY_CRUISE": _real(5.0),
    "MPC_XY_VEL_MAX": _real(12.0),
    "MPC_Z_V_AUTO_DN": _real(1.5),
    "MPC_Z_V_AUTO_UP": _real(3.0),
    "NAV_ACC_RAD": _real(2.0),
    "NAV_DLL_ACT": _int32(0),
    "RTL_DESCEND_ALT": _real(10.0),
    "RTL_LAND_DELAY": _real(0.0),
    "RTL_RETURN_ALT": _real(30.0),
    "SYS_AUTOSTART": _int32(10040),
}
