"""The one place where lengths of a mission file become units of the law, and are said in the file's
own unit.

The law depends on its unit: its repulsion is tuned for radii of the paper's size (r_out 1.5 units).
So a mission in metres that names no `unit_m` gets `r_out` / 1.5.
"""

from __future__ import annotations

import math
from typing import Any, Final, Protocol

from swarm_ctl.mission.sections.section import Section

_LENGTHS: Final = frozenset(
    {"r", "r_out", "r_in", "start", "side", "radius", "inner_radius", "spacing", "height"}
    | {"offset", "offsets", "to", "along", "by", "until", "polygon", "circle"}
)
"""Fields of the schema that are lengths in the file's unit; those in metres end in `_m`."""


class Lengths(Protocol):
    """A mission file, as far as its lengths go."""

    @property
    def lengths(self) -> str: ...
    @property
    def unit_m(self) -> float: ...


def metres(mission: Lengths) -> float:
    """Metres in one of the file's lengths."""
    return 1.0 if mission.lengths == "metres" else mission.unit_m


def said(length_m: float, mission: Lengths, *, least: bool = False) -> str:
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


def in_units(value: Any, unit_m: float, is_length: bool = False) -> Any:
    """A section, its lengths in units of so many of the file's own."""
    if isinstance(value, Section):
        fields = {
            name: in_units(inner, unit_m, name in _LENGTHS)
            for name, inner in value
            if name in value.model_fields_set
        }
        return value.model_copy(update=fields)
    if isinstance(value, tuple):
        return tuple(in_units(inner, unit_m, is_length) for inner in value)
    if isinstance(value, dict):
        return {name: in_units(inner, unit_m) for name, inner in value.items()}
    return value / unit_m if is_length and isinstance(value, int | float) else value
