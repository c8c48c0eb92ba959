"""The program of `core/kernel/program.py` for arrays of agents: a test holds the two together."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_EXACT: Final = 1e-9
_PARALLEL: Final = 1e-12
_HALVINGS: Final = 18
"""Of the slack: 1 / 260,000 of the largest violation."""
UNBOUND: Final = -1e6
"""The b of a plane that forbids nothing: it fills rows of the arrays up."""


def nearest_many(
    wish: Floats, normals: Floats, bounds: Floats, cap: Floats
) -> tuple[Floats, Bools]:
    """`program.nearest` for A agents.

    Args:
        wish: (2, A).
        normals: (K, 2, A), unit vectors.
        bounds: (K, A), `UNBOUND` for a plane that is not there.
        cap: (A,).

    Returns:
        v (2, A), and where it exists (A,); elsewhere v means nothing.
    """
    size = np.sqrt(wish[0] ** 2 + wish[1] ** 2)
    v = wish * (cap / np.maximum(size, np.maximum(cap, 1e-300)))
    exists = np.ones(wish.shape[1], dtype=np.bool_)
    for k in range(len(bounds)):
        here = np.flatnonzero(
            (normals[k, 0] * v[0] + normals[k, 1] * v[1] < bounds[k] - _EXACT) & exists
        )
        if not len(here):
            continue
        n, b, top = normals[k][:, here], bounds[k][here], cap[here]
        room = top * top - b * b
        high = np.sqrt(np.maximum(room, 0.0))
        low, possible = -high, room >= 0.0
        if k:
            m, c = normals[:k, :, here], bounds[:k, here]
            slope = m[:, 1] * n[0] - m[:, 0] * n[1]
            missing = c - b * (m[:, 0] * n[0] + m[:, 1] * n[1])
            parallel = np.abs(slope) < _PARALLEL
            possible &= ~(parallel & (missing > _EXACT)).any(axis=0)
            at = missing / np.where(parallel, 1.0, slope)
            low = np.maximum(low, np.where(~parallel & (slope > 0), at, -np.inf).max(axis=0))
            high = np.minimum(high, np.where(~parallel & (slope < 0), at, np.inf).min(axis=0))
        possible &= low <= high
        along = np.minimum(np.maximum(n[0] * wish[1, here] - n[1] * wish[0, here], low), high)
        v[0, here], v[1, here] = b * n[0] - along * n[1], b * n[1] + along * n[0]
        exists[here[~possible]] = False
    return v, exists


def relaxed_many(
    wish: Floats, normals: Floats, bounds: Floats, soft: Bools, cap: Floats
) -> tuple[Floats, Floats]:
    """`program.relaxed` for A agents; `soft` (K, A). v (2, A), and the hard planes' slack (A,)."""
    v, exists = nearest_many(wish, normals, bounds, cap)
    slack = np.zeros(wish.shape[1])
    none = np.flatnonzero(~exists)
    if not len(none):
        return v, slack
    wish, normals, bounds, soft, cap = (
        wish[:, none],
        normals[..., none],
        bounds[:, none],
        soft[:, none],
        cap[none],
    )
    hard = np.where(soft, UNBOUND, bounds)
    best, exists = nearest_many(wish, normals, hard, cap)
    stuck = np.flatnonzero(~exists)
    if len(stuck):
        start = np.zeros((2, len(stuck)))
        firm = np.full((len(bounds), len(stuck)), UNBOUND)
        most = hard[:, stuck].max(axis=0)
        best[:, stuck], slack[none[stuck]] = _least_many(
            wish[:, stuck], normals[..., stuck], firm, hard[:, stuck], cap[stuck], start, most
        )
    hard = hard - slack[none]
    giving = np.where(soft, bounds, UNBOUND)
    most = (giving - normals[:, 0] * best[0] - normals[:, 1] * best[1]).max(axis=0)
    pulled = np.flatnonzero(most > 0.0)
    if len(pulled):
        best[:, pulled], _ = _least_many(
            wish[:, pulled],
            normals[..., pulled],
            hard[:, pulled],
            giving[:, pulled],
            cap[pulled],
            best[:, pulled],
            most[pulled],
        )
    v[:, none] = best
    return v, slack


def _least_many(
    wish: Floats,
    normals: Floats,
    firm: Floats,
    giving: Floats,
    cap: Floats,
    best: Floats,
    high: Floats,
) -> tuple[Floats, Floats]:
    """The least slack for A agents; each plane is in one of `firm` and `giving`, `UNBOUND` in the
    other."""
    low = np.zeros(wish.shape[1])
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        found, exists = nearest_many(wish, normals, np.maximum(firm, giving - middle), cap)
        best = np.where(exists, found, best)
        low, high = np.where(exists, low, middle), np.where(exists, middle, high)
    return best, high
