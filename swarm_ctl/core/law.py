"""The formation law of Mondal et al. 2017: consensus plus an adaptive potential whose sigma is tuned online.

Written once, batched: leading axes `...` may be (missions, agents); an agent calls it with `(1,)`. All lengths are the
paper's units. The paper's symbols are kept: `e = p - z`, `n` the consensus sum, `q = p_i - p_j`, `x = |q|`,
`S = q . n`, `C = q x n`, `beta = h / N^2`, `D_lb`/`D_ub` the bounds (32), (59), (65), `g` the cut-off (18)-(21).
`u` is a displacement per iteration: `p <- p + u` is (9).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.plan import LawParameters

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

STATUSES: Final = ("paper", "narrow", "inactive", "overspeed")
"""Names of the pair statuses; `Pairs.status` holds indices into this."""
PAPER, NARROW, INACTIVE, OVERSPEED = range(4)

_SAME_SPOT = 1e-9
"""Closer than this [units] two agents count as on one spot."""
_NO_ROOM = 1e-12
"""`D_ub - D_lb` at or under this share of `D_ub` is zero in exact arithmetic."""


@dataclass(frozen=True, slots=True)
class Pairs:
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


@dataclass(frozen=True, slots=True)
class LawResult:
    """`u = consensus + avoidance`, each (..., 2), displacement per iteration [units]."""

    u: Floats
    consensus: Floats
    avoidance: Floats
    pairs: Pairs | None
    """None when nobody is in anybody's avoidance region."""


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
        lower_id: i has the lower id of the two (..., m); decides who goes where when two stand on one spot.
        law: r, r_in, r_out, h, delta_l, delta_a.
    """
    linked = neighbour & present
    count = np.count_nonzero(linked, axis=-1)
    weight = linked.astype(np.float64)
    error = own - own_slot
    # n, the paper's (n2, n4): the sum of the neighbours' e_j - e_i
    n_x = ((others[..., 0] - other_slots[..., 0] - error[..., 0, None]) * weight).sum(axis=-1)
    n_y = ((others[..., 1] - other_slots[..., 1] - error[..., 1, None]) * weight).sum(axis=-1)
    consensus = np.stack((n_x, n_y), axis=-1)
    consensus *= (law.h / np.maximum(count, 1))[..., None]

    q_x = own[..., 0, None] - others[..., 0]
    q_y = own[..., 1, None] - others[..., 1]
    near = (q_x * q_x + q_y * q_y < law.r_out * law.r_out) & present
    if not near.any():
        avoidance = np.zeros_like(consensus)
        return LawResult(consensus, consensus, avoidance, None)

    index = near.nonzero()
    agent = index[:-1]
    strangers = np.count_nonzero(near & ~linked, axis=-1)
    q_x, q_y, x = _separate(q_x[index], q_y[index], lower_id[index], law)
    pairs = _tune(index, q_x, q_y, x, n_x[agent], n_y[agent], count[agent], strangers[agent], linked[index], law)
    avoidance = np.stack((_sum_per_agent(near, pairs.alpha * q_x), _sum_per_agent(near, pairs.alpha * q_y)), axis=-1)
    return LawResult(consensus + avoidance, consensus, avoidance, pairs)


def cut_off(x: Floats, law: LawParameters) -> Floats:
    """g(x), (18)-(21): 1 inside `r_in`, a cosine down to 0 at `r_out`; same shape as `x`."""
    share = np.clip((x - law.r_in) / (law.r_out - law.r_in), 0.0, 1.0)
    g: Floats = 0.5 * (1.0 + np.cos(math.pi * share))
    return g


def _separate(q_x: Floats, q_y: Floats, lower: Bools, law: LawParameters) -> tuple[Floats, Floats, Floats]:
    """Distances of the pairs; two agents on one spot are taken sqrt(delta_a) apart, the lower id to the north."""
    x = np.hypot(q_x, q_y)
    same = x < _SAME_SPOT
    if same.any():
        apart = math.sqrt(law.delta_a)
        q_x = np.where(same, np.where(lower, apart, -apart), q_x)
        q_y = np.where(same, 0.0, q_y)
        x = np.where(same, apart, x)
    return q_x, q_y, x


def _tune(
    index: tuple[NDArray[np.intp], ...],
    q_x: Floats,
    q_y: Floats,
    x: Floats,
    n_x: Floats,
    n_y: Floats,
    count: NDArray[np.intp],
    strangers: NDArray[np.intp],
    linked: Bools,
    law: LawParameters,
) -> Pairs:
    """Section 3 of LAW.md: the bounds on D, D itself with its status, then sigma; all arrays (K,)."""
    g = cut_off(x, law)
    d_ic = 0.5 * x
    # A stranger (j not in N_i) is the neighbour's case with beta = 0 and M in place of N: (32), (59), (65) turn
    # into (69)'s bounds, and (50), (52) into sigma_lb = g x / R - x^2.
    members = np.where(linked, count, strangers)
    beta = np.where(linked, law.h / np.maximum(count, 1) ** 2, 0.0)
    S = beta * (q_x * n_x + q_y * n_y)
    C = beta * (q_x * n_y - q_y * n_x)
    pull = beta * np.hypot(n_x, n_y)
    d_lb = law.r / (d_ic + 2.0 * members * np.hypot(g + S, C) / x)
    d_ub = law.r / (d_ic + 2.0 * members * pull)
    d, status = _choose_d(d_lb, d_ub, law)

    tuned = status <= NARROW
    R = (law.r / np.where(tuned, d, 1.0) - d_ic) / (2.0 * members)
    # (50), the larger root, written so that a large S does not cancel: (R^2 - pull^2) / (S + sqrt(x^2 R^2 - C^2))
    root = np.sqrt(np.maximum(x * x * R * R - C * C, 0.0))
    alpha_ub = np.where(
        S > 0.0,
        (R - pull) * (R + pull) / np.where(S > 0.0, S + root, 1.0),
        (root - S) / (x * x),
    )
    with np.errstate(divide="ignore"):
        sigma_lb = np.where(tuned, g / alpha_ub - x * x, 0.0)
    # R == pull to the last bit leaves no room for any repulsion: the largest finite sigma
    sigma_lb = np.nan_to_num(sigma_lb, nan=0.0, posinf=1e300)
    sigma = np.maximum(sigma_lb, 0.0) + law.delta_a
    alpha = g / (sigma + x * x)
    return Pairs(index, x, linked, sigma, sigma_lb, d_lb, d_ub, d, alpha, status)


def _choose_d(d_lb: Floats, d_ub: Floats, law: LawParameters) -> tuple[Floats, NDArray[np.uint8]]:
    """D by (66) and its status; `narrow`, `inactive` and `overspeed` are LAW.md's rules where (66) has no room."""
    middle = 0.5 * (d_lb + d_ub)
    d = np.where(d_lb < 2.0, d_lb + law.delta_l, middle)
    narrow = d >= d_ub
    d = np.where(narrow, np.maximum(2.0, middle), d)
    inactive = d_ub - d_lb <= _NO_ROOM * d_ub
    overspeed = ~inactive & (d >= d_ub)
    status = np.where(narrow, NARROW, PAPER)
    status[overspeed] = OVERSPEED
    status[inactive] = INACTIVE
    d[overspeed | inactive] = np.nan
    return d, status.astype(np.uint8)


def _sum_per_agent(near: Bools, values: Floats) -> Floats:
    """Sum `values`, one per true entry of `near` (..., m), over j: (...)."""
    spread = np.zeros(near.shape)
    spread[near] = values
    total: Floats = spread.sum(axis=-1)
    return total
