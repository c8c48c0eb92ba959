"""The paper's law on arrays: many receivers at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.kernel.law import Law, Pair, terms
from swarm_ctl.core.kernel.receiver import Known, Me
from swarm_ctl.core.model.arrays import Bools, Floats, complex_of, plane_of
from swarm_ctl.core.model.plan import LawParameters


@dataclass(frozen=True, slots=True)
class PairsInside:
    """Every pair (i, j) with `x < r_out` and all its numbers, flat: each array has shape (K,)."""

    index: tuple[NDArray[np.intp], ...]
    """Indices into the (..., m) axes of the others, as from `nonzero`; the last one is j."""
    distance: Floats
    neighbour: Bools
    sigma: Floats
    sigma_lb: Floats
    d_lb: Floats
    d_ub: Floats
    d: Floats
    alpha: Floats
    status: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class LawResult:
    """`u = consensus + avoidance`, each (..., 2), displacement per iteration [units]."""

    u: Floats
    consensus: Floats
    avoidance: Floats
    pairs: PairsInside | None
    """None where no two agents are within `r_out`."""


def receiver(at: complex, slot: complex) -> Me:
    """An agent of which a law needs no more than where it is."""
    return Me(1, at, slot, 0j, 1.0, 0.05, 1.0, 4.5, 1.5, 0.5)


def evaluate(
    own: Floats,
    own_slot: Floats,
    others: Floats,
    other_slots: Floats,
    neighbour: Bools,
    present: Bools,
    lower_id: Bools,
    law: LawParameters,
) -> LawResult:
    """One iteration of (26) for every agent on the leading axes: p_i (..., 2), z_i, p_j (..., m,
    2), z_j, and flags (..., m)."""
    shape = neighbour.shape[:-1]
    numbers = Law(law.r, law.r_out, law.r_in, law.h, law.delta_l, law.delta_a)
    sums, found = np.zeros((2, *shape), dtype=np.complex128), list[Any]()
    for place in np.ndindex(shape):
        there = np.flatnonzero(present[place]).tolist()
        points, slots = complex_of(others[place]).tolist(), complex_of(other_slots[place]).tolist()
        rows = [
            Known(
                j + 2,
                points[j],
                slots[j],
                0j,
                0.0,
                bool(neighbour[place][j]),
                bool(lower_id[place][j]),
            )
            for j in there
        ]
        me = receiver(complex(*own[place].tolist()), complex(*own_slot[place].tolist()))
        pairs = list[Pair]()
        sums[0][place], sums[1][place], near = terms(me, rows, numbers, [], pairs)
        found += [(place, pair._replace(place=there[pair.place])) for pair in pairs[:near]]
    consensus, avoidance = plane_of(sums[0]), plane_of(sums[1])
    told = None
    if found:
        index = np.array([(*place, pair.place) for place, pair in found]).T
        names = [name for name in PairsInside.__slots__ if name != "index"]
        each: dict[str, Any] = {n: np.array([getattr(pair, n) for _, pair in found]) for n in names}
        told = PairsInside(index=tuple(index), **each)
    return LawResult(consensus + avoidance, consensus, avoidance, told)
