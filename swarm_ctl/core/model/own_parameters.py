"""A vehicle's own values of the parameters that agents change, and what is remembered of them.

An agent that dies leaves its own values on the vehicle. So the vehicle's are remembered outside
the agent before any is changed, and forgotten only when the vehicle has confirmed them again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum


@dataclass(frozen=True, slots=True)
class VehicleIdentity:
    """Which vehicle this is. A simulated autopilot's `uid` may be that of its computer, so the
    system id belongs to it."""

    autopilot: str
    sysid: int
    uid: str = ""
    """AUTOPILOT_VERSION: uid2, else uid, in hexadecimal; '' where the vehicle has none."""


@dataclass(frozen=True, slots=True)
class OwnValue:
    """One parameter."""

    own: float
    """What the vehicle gets back."""
    ours: tuple[float, ...]
    """What agents have set, or were about to set, since the vehicle had its own value."""


@dataclass(frozen=True, slots=True)
class OwnParameters:
    """What an agent says of its vehicle's parameters, for those who remember it."""

    vehicle: VehicleIdentity
    values: dict[str, OwnValue]
    given_back: bool = False
    """The vehicle has confirmed its own values, all of them, after the flight."""


@dataclass(frozen=True, slots=True)
class Remembered:
    """What an earlier flight left behind."""

    values: Mapping[str, OwnValue]
    flight: str
    """Which one, e.g. `20261122-0512-hexagon of 2026-11-22 05:12`."""


class Found(StrEnum):
    """What the first reading of a parameter tells."""

    OWN = "own"
    """The vehicle's own value."""
    OURS = "ours"
    """An agent's value that an earlier flight left; the own one is remembered."""
    CHANGED = "changed"
    """Neither: the value was changed since, and counts."""
    UNKNOWN = "unknown"
    """An agent's value, and nothing is remembered: the vehicle's own, or a leftover."""


@dataclass(frozen=True, slots=True)
class ParameterNote:
    """What the operator should know of parameters that were found so."""

    found: Found
    text: str


def own_value(found: float, ours: float, remembered: OwnValue | None) -> tuple[OwnValue, Found]:
    """Whose value was found, and which one the vehicle gets back.

    Args:
        found: as first read in this flight.
        ours: what this flight sets.
        remembered: by an earlier flight that has not given it back; None: nothing.
    """
    if remembered is None:
        return OwnValue(found, (ours,)), Found.UNKNOWN if found == ours else Found.OWN
    if found not in (remembered.own, *remembered.ours):
        return OwnValue(found, (ours,)), Found.CHANGED
    # Earlier values stay: this flight may end before it has set its own.
    values = tuple(dict.fromkeys((*remembered.ours, ours)))
    left = found != remembered.own
    return OwnValue(remembered.own, values), Found.OURS if left else Found.OWN
