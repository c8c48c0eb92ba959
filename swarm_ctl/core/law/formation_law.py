"""The formation law of Mondal et al. 2017: consensus plus an adaptive potential whose sigma is
tuned online.

Numbers in parentheses are the paper's equations; `docs/pages/law.md` has the law as it is built.
Leading axes `...` may be (missions, agents); an agent calls `evaluate` with `(1,)`. All lengths are
the paper's units. The paper's symbols are kept: `e = p - z`, `n` the consensus sum, `q = p_i -
p_j`, `x = |q|`, `S = q . n`, `C = q x n`, `beta = h / N^2`, `D_lb`/`D_ub` the bounds (32), (59),
(65), `g` the cut-off (18)-(21). `u` is a displacement per iteration: `p <- p + u` is (9).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.model.arrays import Bools, Floats
from swarm_ctl.core.model.plan import LawParameters
from swarm_ctl.core.model.rows import row

STATUSES: Final = ("paper", "narrow", "inactive", "overspeed")
"""Names of the pair statuses; `Pairs.status` holds indices into this."""
PAPER, NARROW, INACTIVE, OVERSPEED = range(4)

_SAME_SPOT = 1e-9
"""Closer than this [units] two agents count as on one spot."""
_NO_ROOM = 1e-12
"""`D_ub - D_lb` at or under this share of `D_ub` is zero in exact arithmetic."""


@row
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


@row
class LawResult:
    """`u = consensus + avoidance`, each (..., 2), displacement per iteration [units]."""

    u: Floats
    consensus: Floats
    avoidance: Floats
    pairs: Pairs | None
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
    linked = neighbour & present
    count = linked.sum(axis=-1)
    gain, beta = gains(law.h, count)
    error = own - own_slot
    # n, the paper's (n2, n4): the sum of the neighbours' e_j - e_i
    n = ((others - other_slots - error[..., None, :]) * linked[..., None]).sum(axis=-2)
    consensus = n * gain[..., None]

    # the pairs inside r_out, flat: (K,)
    q = own[..., None, :] - others
    near = ((q * q).sum(axis=-1) < law.r_out * law.r_out) & present
    if not near.any():
        return LawResult(consensus, consensus, np.zeros_like(consensus), None)

    index = near.nonzero()
    agent = index[:-1]
    together = linked[index]
    strangers = np.count_nonzero(near & ~linked, axis=-1)
    q_x, q_y, x = separate(q[..., 0][index], q[..., 1][index], lower_id[index], law)
    members = np.where(together, count[agent], strangers[agent])
    pull = n[agent] * (together * beta[agent])[:, None]
    tuned = adapt_sigma(q_x, q_y, x, pull[:, 0], pull[:, 1], members, law)
    pairs = Pairs(index, x, together, *tuned)
    # alpha q of each pair, summed over the others
    push = np.zeros_like(q)
    push[..., 0][index] = pairs.alpha * q_x
    push[..., 1][index] = pairs.alpha * q_y
    avoidance = push.sum(axis=-2)
    return LawResult(consensus + avoidance, consensus, avoidance, pairs)


def gains(h: Any, count: Any) -> tuple[Any, Any]:
    """The factors of n: h / d_i in (26), and beta = h / N^2; `count` neighbours, (...)."""
    some = np.maximum(count, 1)
    return h / some, h / (some * some)


def cut_off(x: Floats, law: LawParameters) -> Floats:
    """g(x), (18)-(21): 1 inside `r_in`, a cosine down to 0 at `r_out`; same shape as `x`."""
    share = np.minimum(
        np.maximum((x - law.r_in) * (math.pi / (law.r_out - law.r_in)), 0.0), math.pi
    )
    g: Floats = 0.5 + 0.5 * np.cos(share)
    return g


def separate(
    q_x: Floats, q_y: Floats, lower: Bools, law: LawParameters
) -> tuple[Floats, Floats, Floats]:
    """`q` and its length; two agents on one spot count as sqrt(delta_a) apart, the lower id
    north of the other."""
    x = np.sqrt(q_x * q_x + q_y * q_y)
    if x.min(initial=1.0) < _SAME_SPOT:
        same = x < _SAME_SPOT
        apart = math.sqrt(law.delta_a)
        q_x = np.where(same, np.where(lower, apart, -apart), q_x)
        q_y = np.where(same, 0.0, q_y)
        x = np.where(same, apart, x)
    return q_x, q_y, x


class AdaptedSigma(NamedTuple):
    """What `adapt_sigma` finds for pairs; `d` is NaN where the status leaves it undefined."""

    sigma: Floats
    sigma_lb: Floats
    d_lb: Floats
    d_ub: Floats
    d: Floats
    alpha: Floats
    status: NDArray[np.uint8]


def adapt_sigma(
    q_x: Floats,
    q_y: Floats,
    x: Floats,
    pull_x: Floats,
    pull_y: Floats,
    members: NDArray[np.intp],
    law: LawParameters,
) -> AdaptedSigma:
    """Adapt sigma, (31)-(69): the bounds on D, D itself with its status, then sigma.

    A stranger (j not in N_i) is the neighbour's case with beta = 0 and M in place of N: (32), (59),
    (65) turn into (69)'s bounds, and (50), (52) into sigma_lb = g x / R - x^2.

    Args:
        q_x: p_i - p_j, north, never zero; arrays of any shapes that broadcast, as all that follow.
        q_y: east.
        x: |q|.
        pull_x: beta n, the pull of the neighbours' errors on i; zero for a stranger.
        pull_y: likewise.
        members: N for a neighbour, M for a stranger.
        law: r, r_in, r_out, delta_l, delta_a; `h` is in the pull.
    """
    g = cut_off(x, law)
    d_ic = 0.5 * x  # from i to the middle of the pair
    twice = 2.0 * members
    S = q_x * pull_x + q_y * pull_y
    C = q_x * pull_y - q_y * pull_x
    C *= C
    pull = np.sqrt(pull_x * pull_x + pull_y * pull_y)
    # (32) with (59), and (65)
    push = g + S
    push *= push
    push += C
    d_lb = law.r / (np.sqrt(push) * twice / x + d_ic)
    d_ub = law.r / (twice * pull + d_ic)
    d, status = _choose_d(d_lb, d_ub, law)

    with np.errstate(divide="ignore", invalid="ignore"):
        R = (law.r / d - d_ic) / twice
        xx = x * x
        # (50), the larger root, written so that a large S does not cancel: (R^2 - pull^2) / (S +
        # sqrt(x^2 R^2 - C^2))
        root = np.sqrt(np.maximum(R * R * xx - C, 0.0))
        root += np.abs(S)
        alpha_ub = np.where(S > 0.0, (R - pull) * (R + pull) / root, root / xx)
        # R == pull to the last bit leaves no room for any repulsion: the largest finite sigma
        sigma_lb = np.minimum(g / alpha_ub - xx, 1e300)
    sigma_lb[np.isnan(sigma_lb)] = 0.0  # where D is undefined
    sigma = np.maximum(sigma_lb, 0.0)
    sigma += law.delta_a
    return AdaptedSigma(
        sigma=sigma,
        sigma_lb=sigma_lb,
        d_lb=d_lb,
        d_ub=d_ub,
        d=d,
        alpha=g / (sigma + xx),
        status=status,
    )


def _choose_d(d_lb: Floats, d_ub: Floats, law: LawParameters) -> tuple[Floats, NDArray[np.uint8]]:
    """D by (66) and its status; `narrow`, `inactive` and `overspeed` are this program's rules where
    (66) has no room (`docs/pages/law.md`)."""
    middle = 0.5 * (d_lb + d_ub)
    d = np.where(d_lb < 2.0, d_lb + law.delta_l, middle)
    inactive = d_ub - d_lb <= _NO_ROOM * d_ub
    narrow = d >= d_ub
    status = narrow.view(np.uint8)  # PAPER is 0, NARROW 1
    if narrow.any() or inactive.any():
        d = np.where(narrow, np.maximum(2.0, middle), d)
        undefined = d >= d_ub
        status[undefined] = OVERSPEED
        status[inactive] = INACTIVE
        d[undefined | inactive] = np.nan
    return d, status
