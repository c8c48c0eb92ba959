"""Woods that missions fly through in file: trunks, drawn by a mission's own number, and the way
through them as a flight plans it (`core/safety/among_zones.py`).

Agents stand in their shape south of the wood and go to the same shape north of it. Lengths in
units, a point is north + 1j * east, unless a name says metres.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from swarm_ctl.core.control.in_file import GAP, queue_of
from swarm_ctl.core.model.arrays import Complex, Floats, Ints
from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.safety.among_zones import AmongZones
from swarm_ctl.errors import InputError
from swarm_ctl.study.parameter_space import Cell

_CLEAR: Final = 1.5
"""Between the shape, at the start and at the end, and the wood: r_out, and a trunk's clearance."""
_TRIES: Final = 40
"""Woods without a way through or round them are drawn again."""
_PLACES: Final = 300
"""Tries for the place of one trunk."""
_UNLIKE: Final = 0.6
"""Trunks of one wood are so much thicker or thinner than their mean."""
_HEDGE: Final = 1.6
"""From one trunk of a hedge to the next, in radii: they overlap."""
_HEIGHT_M: Final = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Wood:
    """One mission's."""

    at: Complex
    """The trunks' middles (t,)."""
    radius: Floats
    """(t,)."""
    goal: complex
    """The middle of the shape at the end."""
    way_m: Complex
    """On which all follow one another (k,)."""
    ends_m: Floats
    """How far along the way each corner is (k,)."""
    opens_m: float
    """From here on, each flies to its own place."""
    ranks: Ints
    """The front agent first (n,)."""
    along_m: Floats
    """Where each agent is on the way at the start (n,)."""
    shortest_s: float
    """No file arrives earlier at the top speed: the one that needs longest."""


def clearance_m(cell: Cell) -> float:
    """Positions stay so far from a trunk: the default of missions."""
    return 0.5 * cell.law.r_in * cell.unit_m


def grow(cell: Cell, row: int, slots: Complex, trunks: float, trunk: float, gap: float) -> Wood:
    """The wood of one mission, the same however many are flown.

    Args:
        cell: has the kind of wood and its side.
        row: the mission's number.
        slots: of its agents (n,).
        trunks: how many; of hedges the length says it.
        trunk: mean radius.
        gap: between two trunks at least; of a gate, its width.

    Raises:
        InputError: there is no room for the trunks, or no way.
    """
    random = np.random.default_rng([cell.seed, row, 1])
    south = float(np.abs(slots).max()) + _CLEAR + 2.0 * trunk
    for _ in range(_TRIES):
        if cell.wood == "trunks":
            at, radius = _trunks(cell, round(trunks), trunk, gap, random)
        else:
            at = _gate(cell, trunk, gap, random) if cell.wood == "gate" else _trap(cell, trunk)
            radius = np.full(len(at), trunk)
        at = at + south
        found = _planned(cell, at, radius, 2.0 * south + cell.wood_side, slots)
        if found is not None:
            return found
    raise InputError(
        f"wood {cell.wood}: {_TRIES} drawn woods had no way; allowed: fewer or thinner trunks, a"
        " wider gap or a larger wood_side"
    )


def _trunks(
    cell: Cell, count: int, mean: float, gap: float, random: np.random.Generator
) -> tuple[Complex, Floats]:
    side, at, radius = cell.wood_side, list[complex](), list[float]()
    for _ in range(count):
        thick = mean * float(random.uniform(1.0 - _UNLIKE, 1.0 + _UNLIKE))
        for _ in range(_PLACES):
            north, east = random.uniform(0.0, side), random.uniform(-0.5 * side, 0.5 * side)
            place = complex(north, east)
            apart = (abs(place - p) - r - thick for p, r in zip(at, radius, strict=True))
            if all(free >= gap for free in apart):
                at.append(place)
                radius.append(thick)
                break
        else:
            raise InputError(
                f"wood_side {side:g}: no room for {count} trunks of {mean:.2g} with gaps of"
                f" {gap:.2g}; allowed: fewer or thinner trunks, a narrower gap or a larger"
                " wood_side"
            )
    return np.array(at, dtype=np.complex128), np.array(radius)


def _hedge(a: complex, b: complex, trunk: float) -> list[complex]:
    steps = max(1, math.ceil(abs(b - a) / (_HEDGE * trunk)))
    return [a + (b - a) * k / steps for k in range(steps + 1)]


def _gate(cell: Cell, trunk: float, gap: float, random: np.random.Generator) -> Complex:
    """A hedge across the wood, with one gap."""
    side = cell.wood_side
    north, half = 0.5 * side, 0.5 * gap + trunk
    middle = float(random.uniform(-0.4, 0.4)) * (side - 2.0 * half)
    left = _hedge(complex(north, -0.5 * side), complex(north, middle - half), trunk)
    right = _hedge(complex(north, middle + half), complex(north, 0.5 * side), trunk)
    return np.array(left + right)


def _trap(cell: Cell, trunk: float) -> Complex:
    """A hedge that is open to the south: straight on ends in it."""
    side = cell.wood_side
    deep, wide = 0.5 * side, 0.3 * side
    corners = complex(0, -wide), complex(deep, -wide), complex(deep, wide), complex(0, wide)
    return np.array([at for a, b in itertools.pairwise(corners) for at in _hedge(a, b, trunk)])


def _planned(cell: Cell, at: Complex, radius: Floats, goal: float, slots: Complex) -> Wood | None:
    unit_m, v = cell.unit_m, cell.speed_mps
    zones = [
        Zone(f"trunk-{k}", (_metres(place, unit_m),), float(r) * unit_m, clearance_m(cell))
        for k, (place, r) in enumerate(zip(at.tolist(), radius, strict=True))
    ]
    places = {i: (slot.real, slot.imag) for i, slot in enumerate(slots.tolist())}
    before = PlannedFormation(tuple(places.values()), unit_m, (0.0, 0.0))
    among = AmongZones(zones, (), (_HEIGHT_M, _HEIGHT_M))
    found = among.in_file(before, (goal * unit_m, 0.0))
    if found is None:
        return None
    waypoints_m, left_m = found
    queue = queue_of((0.0, 0.0), waypoints_m, places, unit_m)
    opens_m, front = queue.ends[-1] - left_m, queue.at[queue.ranks[0]]
    gap_m, shortest_s = GAP * cell.law.r_out * unit_m, 0.0
    way = np.array(queue.way)
    out = complex(
        np.interp(opens_m, queue.ends, way.real), np.interp(opens_m, queue.ends, way.imag)
    )
    for rank, i in enumerate(queue.ranks):
        waits = max(opens_m - queue.at[i], opens_m - front + rank * gap_m)
        to_place = abs((goal + complex(slots[i])) * unit_m - out)
        shortest_s = max(shortest_s, (waits + to_place) / v)
    return Wood(
        at=at,
        radius=radius,
        goal=complex(goal),
        way_m=way,
        ends_m=np.array(queue.ends),
        opens_m=opens_m,
        ranks=np.array(queue.ranks, dtype=np.int64),
        along_m=np.array([queue.at[i] for i in range(len(slots))]),
        shortest_s=shortest_s,
    )


def _metres(point: complex, unit_m: float) -> Point:
    return point.real * unit_m, point.imag * unit_m
