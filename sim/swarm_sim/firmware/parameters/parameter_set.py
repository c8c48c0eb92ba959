"""Parameters: a fixed, ordered set of names with types, defaults and values. Pure.

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
