"""The formation law of Mondal et al. 2017 for one agent: consensus plus an adaptive potential whose
sigma is tuned online.

Numbers in parentheses are the paper's equations; `docs/understand/law.md` has the law as built.
All lengths are the paper's units. The paper's symbols are kept: `e = p - z`, `n` the consensus sum,
`q = p_i - p_j`, `x = |q|`, `S = q . n`, `C = q x n`, `beta = h / N^2`, `D_lb`/`D_ub` the bounds
(32), (59), (65), `g` the cut-off (18)-(21). The terms are displacements per iteration: `p <- p + u`
is (9).
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence, Sequence
from typing import Final, NamedTuple, TypeVar

from swarm_ctl.core.kernel.receiver import Known, Me

STATUSES: Final = ("paper", "narrow", "inactive", "overspeed")
"""Names of the pair statuses; `Pair.status` is an index into this."""
PAPER: Final = 0
NARROW: Final = 1
INACTIVE: Final = 2
OVERSPEED: Final = 3

_SAME_SPOT: Final = 1e-9
"""Closer than this [units] two agents count as on one spot."""
_NO_ROOM: Final = 1e-12
"""`D_ub - D_lb` at or under this share of `D_ub` is zero in exact arithmetic."""
_LARGEST: Final = 1e300


class Law(NamedTuple):
    """The law's numbers, of `LawParameters`."""

    r: float
    r_out: float
    r_in: float
    h: float
    delta_l: float
    delta_a: float


class Pair(NamedTuple):
    """One other agent inside `r_out`, and all that the law makes of it."""

    place: int
    """Of the other, in the rows that the law was given."""
    q: complex
    distance: float
    neighbour: bool
    sigma: float
    sigma_lb: float
    d_lb: float
    d_ub: float
    d: float
    """NaN where the status leaves D undefined (`inactive`, `overspeed`)."""
    alpha: float
    status: int


NO_PAIR: Final = Pair(
    place=0,
    q=0j,
    distance=0.0,
    neighbour=False,
    sigma=0.0,
    sigma_lb=0.0,
    d_lb=0.0,
    d_ub=0.0,
    d=0.0,
    alpha=0.0,
    status=0,
)


def terms(
    me: Me, others: Sequence[Known], law: Law, _memory: MutableSequence[float], pairs: list[Pair]
) -> tuple[complex, complex, int]:
    """One iteration of (26): consensus, avoidance, and how many `pairs` are inside `r_out`.

    Args:
        me: agent i.
        others: each j that is a neighbour or within `r_out`; others count for nothing.
        law: its numbers.
        _memory: this law needs none.
        pairs: filled anew.
    """
    own = me.at
    error, n = own - me.slot, 0j
    count = strangers = found = 0
    reach = law.r_out * law.r_out
    for j in range(len(others)):
        _, point, slot, _, _, neighbour, _ = others[j]
        q = own - point
        x, y = q.real, q.imag
        near = x * x + y * y < reach
        if neighbour:
            n += point - slot - error
            count += 1
        elif near:
            strangers += 1
        if near:
            seen = Pair(j, q, 0.0, neighbour, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
            found = put(pairs, found, seen)
    some = max(count, 1)
    gain, beta = law.h / some, law.h / (some * some)
    avoidance = 0j
    for k in range(found):
        j, q, neighbour = pairs[k].place, pairs[k].q, pairs[k].neighbour
        x = math.sqrt(q.real * q.real + q.imag * q.imag)
        if x < _SAME_SPOT:
            # they count as sqrt(delta_a) apart, the lower id north of the other
            x = math.sqrt(law.delta_a)
            q = complex(x if others[j].lower else -x, 0.0)
        pull = complex(n.real * beta, n.imag * beta) if neighbour else 0j
        pair = adapted(j, q, x, neighbour, pull, count if neighbour else strangers, law)
        pairs[k] = pair
        avoidance += complex(pair.alpha * q.real, pair.alpha * q.imag)
    return complex(n.real * gain, n.imag * gain), avoidance, found


def cut_off(x: float, law: Law) -> float:
    """g(x), (18)-(21): 1 inside `r_in`, a cosine down to 0 at `r_out`."""
    share = min(max((x - law.r_in) * (math.pi / (law.r_out - law.r_in)), 0.0), math.pi)
    return 0.5 + 0.5 * math.cos(share)


def adapted(
    place: int, q: complex, x: float, neighbour: bool, pull: complex, members: int, law: Law
) -> Pair:
    """Adapt sigma, (31)-(69): the bounds on D, D itself with its status, then sigma.

    A stranger (j not in N_i) is the neighbour's case with beta = 0 and M in place of N: (32), (59),
    (65) turn into (69)'s bounds, and (50), (52) into sigma_lb = g x / R - x^2.

    Args:
        place: of the other.
        q: p_i - p_j, never zero.
        x: |q|.
        neighbour: j in N_i.
        pull: beta n, the pull of the neighbours' errors on i; zero for a stranger.
        members: N for a neighbour, M for a stranger.
        law: its numbers; `h` is in the pull.
    """
    g = cut_off(x, law)
    d_ic = 0.5 * x  # from i to the middle of the pair
    twice = 2.0 * members
    S = q.real * pull.real + q.imag * pull.imag
    C = q.real * pull.imag - q.imag * pull.real
    C *= C
    size = math.sqrt(pull.real * pull.real + pull.imag * pull.imag)
    # (32) with (59), and (65)
    push = g + S
    push *= push
    push += C
    d_lb = law.r / (math.sqrt(push) * twice / x + d_ic)
    d_ub = law.r / (twice * size + d_ic)
    d, status = _chosen(d_lb, d_ub, law)
    xx, sigma_lb = x * x, 0.0  # where D is undefined
    if status <= NARROW:
        R = (law.r / d - d_ic) / twice
        # (50), the larger root, written so that a large S does not cancel: (R^2 - pull^2) / (S +
        # sqrt(x^2 R^2 - C^2))
        root = math.sqrt(max(R * R * xx - C, 0.0)) + abs(S)
        alpha_ub = (R - size) * (R + size) / root if S > 0.0 else root / xx
        # R == pull to the last bit leaves no room for any repulsion: the largest finite sigma
        sigma_lb = min(g / alpha_ub - xx, _LARGEST) if alpha_ub != 0.0 else _LARGEST
    sigma = max(sigma_lb, 0.0) + law.delta_a
    alpha = g / (sigma + xx)
    return Pair(
        place=place,
        q=q,
        distance=x,
        neighbour=neighbour,
        sigma=sigma,
        sigma_lb=sigma_lb,
        d_lb=d_lb,
        d_ub=d_ub,
        d=d,
        alpha=alpha,
        status=status,
    )


def _chosen(d_lb: float, d_ub: float, law: Law) -> tuple[float, int]:
    """D by (66) and its status; `narrow`, `inactive` and `overspeed` are this program's rules where
    (66) has no room (`docs/understand/law.md`)."""
    middle = 0.5 * (d_lb + d_ub)
    d = d_lb + law.delta_l if d_lb < 2.0 else middle
    status = PAPER
    if d >= d_ub:
        status, d = NARROW, max(2.0, middle)
        if d >= d_ub:
            status, d = OVERSPEED, math.nan
    if d_ub - d_lb <= _NO_ROOM * d_ub:
        status, d = INACTIVE, math.nan
    return d, status


T = TypeVar("T")


def put(items: list[T], used: int, item: T) -> int:
    """For lists that are filled anew every tick, and keep their memory: `item` behind the first
    `used` of `items`; how many are used then."""
    if used < len(items):
        items[used] = item
    else:
        items.append(item)
    return used + 1
