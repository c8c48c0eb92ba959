"""The contract of a law: what it is given and gives, and the paper's law (`core/kernel/law.py`) in
that form.

Leading axes `...` may be (missions, agents); an agent calls a law with `(1,)`. All lengths are the
paper's units, and `u` is a displacement per iteration: `p <- p + u` is (9).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.kernel.law import Law, Pair, terms
from swarm_ctl.core.model.arrays import Bools, Floats, complex_of, plane_of
from swarm_ctl.core.model.plan import LawParameters
from swarm_ctl.core.model.rows import row


@row
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
    """NaN where the status leaves D undefined (`inactive`, `overspeed`)."""
    alpha: Floats
    status: NDArray[np.uint8]


@row
class LawResult:
    """`u = consensus + avoidance`, each (..., 2), displacement per iteration [units]."""

    u: Floats
    consensus: Floats
    avoidance: Floats
    pairs: PairsInside | None
    """None where no two agents are within `r_out`."""


OwnLaw: TypeAlias = Callable[..., LawResult]
"""A user's law, with the arguments of `evaluate`, by position. For agents the leading axes are (1,)
and `law.h` is a number; for studies (missions, agents) and (missions, 1)."""


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
    """One iteration of (26) for every agent on the leading axes.

    Args:
        own: p_i (..., 2).
        own_slot: z_i (..., 2).
        others: p_j (..., m, 2); rows where `present` is false are ignored, but must be finite.
        other_slots: z_j (..., m, 2); read only where `neighbour`.
        neighbour: j in N_i (..., m).
        present: j is there (..., m).
        lower_id: i has the lower id of the two (..., m); decides which way two agents on one spot
            part.
        law: r, r_in, r_out, h, delta_l, delta_a.
    """
    shape = neighbour.shape[:-1]
    h = np.broadcast_to(law.h, shape)
    sums, pairs, found = np.zeros((2, *shape), dtype=np.complex128), list[Pair](), list[Any]()
    for place in np.ndindex(shape):
        numbers = Law(law.r, law.r_out, law.r_in, float(h[place]), law.delta_l, law.delta_a)
        along, away, near = terms(
            complex(*own[place].tolist()),
            complex(*own_slot[place].tolist()),
            complex_of(others[place]).tolist(),
            complex_of(other_slots[place]).tolist(),
            (neighbour & present)[place].tolist(),
            present[place].tolist(),
            lower_id[place].tolist(),
            numbers,
            pairs,
        )
        sums[0][place], sums[1][place] = along, away
        found += [(place, pair) for pair in pairs[:near]]
    consensus, avoidance = plane_of(sums[0]), plane_of(sums[1])
    told = None
    if found:
        index = np.array([(*place, pair.place) for place, pair in found]).T
        each = {name: [getattr(pair, name) for _, pair in found] for name in Pair._fields}
        told = PairsInside(
            index=tuple(index),
            distance=np.array(each["distance"]),
            neighbour=np.array(each["neighbour"]),
            sigma=np.array(each["sigma"]),
            sigma_lb=np.array(each["sigma_lb"]),
            d_lb=np.array(each["d_lb"]),
            d_ub=np.array(each["d_ub"]),
            d=np.array(each["d"]),
            alpha=np.array(each["alpha"]),
            status=np.array(each["status"], dtype=np.uint8),
        )
    return LawResult(consensus + avoidance, consensus, avoidance, told)
