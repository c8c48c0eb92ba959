"""When two vehicles are apart by height, so that no plane between them need act; and how far a
rotor's wake reaches.

A vehicle is somewhere between its height and the height that it flies to: a *span*. Two are apart
where their spans lie so far from each other that neither can come within a layer of the other until
its next word, whatever is doubted of both. What follows: `docs/understand/safety-evidence.md`.

Heights in m above the common frame's origin, times in s.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

_ENTERS: Final = 0.1
"""Of the room from r_in to D: so much may lack where one flies through the height of another. At
D itself two that push towards one place stand; with no room for noise they never pass."""
_LEVEL_M: Final = 0.3
"""A height so near to the own one is passed already."""
_DECAY: Final = 6.0
"""Of a round turbulent jet: speed on its axis, in nozzle speeds, times depth in nozzle diameters
(Pope, Turbulent Flows, 5.1: 5.8 to 6.1)."""
_ROTOR: Final = 0.8
"""A rotor's diameter, in the distance between two rotors next to each other."""
_ROTORS: Final = 4
_AIR_KGPM3: Final = 1.225
_G_MPS2: Final = 9.81
_WIDENS: Final = 0.2
"""Half of a jet's width, per depth: twice the half-value radius of 0.094 (Pope)."""


class Span(NamedTuple):
    """Where a vehicle may be, by its word."""

    low_m: float
    high_m: float
    doubt_m: float
    """Of both: what the estimate may be off by."""


NO_SPAN: Final = Span(-math.inf, math.inf, 0.0)
"""Nothing is known of its height: it is in every layer."""


def span(height_m: float, goal_m: float, doubt_m: float) -> Span:
    """Of a vehicle at this height that flies to that one; `NO_SPAN` where one of them is NaN."""
    if math.isnan(height_m) or math.isnan(goal_m):
        return NO_SPAN
    return Span(min(height_m, goal_m), max(height_m, goal_m), doubt_m)


def needed_m(one: Span, other: Span, layer_m: float, closing_mps: float, age_s: float) -> float:
    """How far two spans must lie from each other.

    Args:
        one: of a vehicle.
        other: of another one, as it was told.
        layer_m: the least difference of heights.
        closing_mps: how fast two may come nearer in height: climb and descent together.
        age_s: of the other's word, at most.
    """
    return layer_m + one.doubt_m + other.doubt_m + closing_mps * max(0.0, age_s)


def apart_by_height(
    one: Span, other: Span, layer_m: float, closing_mps: float, age_s: float
) -> bool:
    """Whether no plane between the two need act; arguments as of `needed_m`. False for each number
    that is none."""
    gap = max(one.low_m - other.high_m, other.low_m - one.high_m)
    return gap > needed_m(one, other, layer_m, closing_mps, age_s)


def is_ahead(height_m: float, climbs_m: float, other_m: float, near_m: float) -> bool:
    """Whether another vehicle lies on the way in height, or hardly beyond it.

    Args:
        height_m: own.
        climbs_m: how far the own vehicle is to climb; under 0: to sink.
        other_m: height of the other one.
        near_m: so far beyond the end of the way (`needed_m`).
    """
    if climbs_m == 0.0:
        return False
    ahead_m = math.copysign(1.0, climbs_m) * (other_m - height_m)
    return _LEVEL_M < ahead_m < abs(climbs_m) + near_m


def may_pass(room: float, keep_out: float, r_in: float) -> bool:
    """Whether a vehicle may fly on through the height of another one.

    Args:
        room: from its stop point to the other's, less the keep-out D (`constraints.keep_out`).
        keep_out: D.
        r_in: the least distance, in the same unit.
    """
    return room >= -_ENTERS * (keep_out - r_in)


# --- wakes ---


def wake_reach_m(rotor_distance_m: float) -> float:
    """So far below a hovering quadrotor its wake has slowed down to the speed that the air has in
    the rotors of an equal one. That one hovers there with 1.6 times its power, by momentum theory.

    A jet with the momentum of the vehicle's weight: w(z) = 6 sqrt(4 m g / (pi rho)) / z. Rotors
    of area A that carry m g move air at sqrt(m g / (2 rho A)). Where both are equal the mass is in
    neither: z = 6 sqrt(8 A / pi).
    """
    area_m2 = _ROTORS * math.pi * (0.5 * _ROTOR * rotor_distance_m) ** 2
    return _DECAY * math.sqrt(8.0 * area_m2 / math.pi)


def wake_mps(mass_kg: float, below_m: float) -> float:
    """Mean speed on the axis of the wake of a hovering multirotor, so far below it."""
    nozzle = math.sqrt(4.0 * mass_kg * _G_MPS2 / (math.pi * _AIR_KGPM3))
    return _DECAY * nozzle / max(below_m, 1e-3)


def in_wake(beside_m: float, below_m: float, rotor_distance_m: float) -> bool:
    """Whether a vehicle so far beside and below another one hovers in the cone of its wake."""
    return below_m > 0.0 and beside_m < rotor_distance_m + _WIDENS * below_m
