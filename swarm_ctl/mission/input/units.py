"""The one place where lengths of a mission file become units of the law, and are said in the file's
own unit.

The law depends on its unit: its repulsion is tuned for radii of the paper's size (r_out 1.5 units).
So a mission in metres that names no `unit_m` gets `r_out` / 1.5.
"""

from __future__ import annotations

import math
from typing import Any, Final

from swarm_ctl.mission.sections.mission_file import MissionFile
from swarm_ctl.mission.sections.section import Section

R_OUT_UNITS: Final = 1.5
_LENGTHS: Final = frozenset(
    {"r", "r_out", "r_in", "start", "side", "radius", "inner_radius", "spacing", "height"}
    | {"offsets", "to", "along", "by", "polygon"}
)
"""Fields of the schema that are lengths in the file's unit; those in metres end in `_m`."""


def in_units(mission: MissionFile) -> MissionFile:
    """The mission with every length in units of its `unit_m`."""
    if mission.lengths == "units":
        return mission
    given = "unit_m" in mission.model_fields_set
    unit_m = mission.unit_m if given else mission.law.r_out / R_OUT_UNITS
    converted: MissionFile = _converted(mission, unit_m)
    return converted.model_copy(update={"unit_m": unit_m, "lengths": "units"})


def metres(mission: MissionFile) -> float:
    """Metres in one of the file's lengths."""
    return 1.0 if mission.lengths == "metres" else mission.unit_m


def said(length_m: float, mission: MissionFile, *, least: bool = False) -> str:
    """A length as the file would say it: `7 m`, or `1.4 units (7 m)`; `least`: rounded up, so that
    what is said to be enough is."""
    length = length_m / metres(mission)
    number = enough(length) if least else _short(length)
    if mission.lengths == "metres":
        return f"{number} m"
    return f"{number} units ({_short(float(number) * mission.unit_m)} m)"


def enough(value: float) -> str:
    """Rounded up to four digits, or to a whole number."""
    if value <= 0 or value >= 1000:
        return _short(math.ceil(value))
    digit = 10.0 ** (math.floor(math.log10(value)) - 3)
    return _short(math.ceil(value / digit * (1 - 1e-8)) * digit)


def _short(value: float) -> str:
    return f"{value:.4g}" if abs(value) < 1000 else f"{value:.0f}"


def _converted(value: Any, unit_m: float, is_length: bool = False) -> Any:
    if isinstance(value, Section):
        fields = {
            name: _converted(inner, unit_m, name in _LENGTHS)
            for name, inner in value
            if name in value.model_fields_set
        }
        return value.model_copy(update=fields)
    if isinstance(value, tuple):
        return tuple(_converted(inner, unit_m, is_length) for inner in value)
    if isinstance(value, dict):
        return {name: _converted(inner, unit_m) for name, inner in value.items()}
    return value / unit_m if is_length and isinstance(value, int | float) else value
