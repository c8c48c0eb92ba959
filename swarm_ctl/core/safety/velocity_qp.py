"""The velocity nearest to a wish that a disc and half-planes allow: an exact quadratic program in
two dimensions.

A half-plane is `n . v >= b` with a unit normal n. Solved incrementally, as linear programs of few
dimensions are (de Berg et al., Computational Geometry, ch. 4; ORCA does the same): the best so far
stays best while nothing forbids it; otherwise the best lies on the line that does. Where nothing is
allowed, all planes are relaxed by the same least slack: none is dropped. Written twice: for one
agent in plain Python (a tick has a handful of planes, numpy would cost ten times as much), and for
arrays of agents. A test holds them together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Plane: TypeAlias = tuple[float, float, float]
"""(n_north, n_east, b)."""

_EXACT: Final = 1e-9
_PARALLEL: Final = 1e-12
_HALVINGS: Final = 18
"""Of the slack: 1 / 260,000 of the largest violation."""
UNBOUND: Final = -1e6
"""The b of a plane that forbids nothing: it fills rows of the arrays up."""


def nearest(
    wish: tuple[float, float], planes: Sequence[Plane], cap: float
) -> tuple[float, float] | None:
    """The v with |v| <= cap inside all planes that is nearest to `wish`; None where there is
    none."""
    x, y = wish
    size = math.hypot(x, y)
    if size > cap:
        x, y = x / size * cap, y / size * cap
    for k, (nx, ny, b) in enumerate(planes):
        if nx * x + ny * y >= b - _EXACT:
            continue
        room = cap * cap - b * b
        if room < 0.0:
            return None
        high = math.sqrt(room)
        low = -high
        for mx, my, c in planes[:k]:
            slope, missing = my * nx - mx * ny, c - b * (mx * nx + my * ny)
            if abs(slope) < _PARALLEL:
                if missing > _EXACT:
                    return None
            elif slope > 0.0:
                low = max(low, missing / slope)
            else:
                high = min(high, missing / slope)
        if low > high:
            return None
        along = min(max(ny * -wish[0] + nx * wish[1], low), high)
        x, y = b * nx - along * ny, b * ny + along * nx
    return x, y


def relaxed(
    wish: tuple[float, float], hard: Sequence[Plane], soft: Sequence[Plane], cap: float
) -> tuple[tuple[float, float], float]:
    """As `nearest`, giving way where not all planes are possible together: the soft ones first, by
    the least common slack, then the hard ones. Returns v and the slack of the hard ones (0 where
    they hold).
    """
    found = nearest(wish, [*hard, *soft], cap)
    if found is not None:
        return found, 0.0
    found, slack = nearest(wish, hard, cap), 0.0
    if found is None:
        # with that much slack standing still is allowed
        found, slack = _least(wish, (), hard, cap, (0.0, 0.0), max(b for _, _, b in hard))
        hard = [(nx, ny, b - slack) for nx, ny, b in hard]
    if soft:
        most = max(b - nx * found[0] - ny * found[1] for nx, ny, b in soft)
        if most > 0.0:
            found, _ = _least(wish, hard, soft, cap, found, most)
    return found, slack


def _least(
    wish: tuple[float, float],
    firm: Sequence[Plane],
    giving: Sequence[Plane],
    cap: float,
    best: tuple[float, float],
    high: float,
) -> tuple[tuple[float, float], float]:
    """The least slack of `giving` that allows something; `best` is allowed with slack `high`."""
    low = 0.0
    for _ in range(_HALVINGS):
        slack = 0.5 * (low + high)
        found = nearest(wish, [*firm, *((nx, ny, b - slack) for nx, ny, b in giving)], cap)
        if found is None:
            low = slack
        else:
            high, best = slack, found
    return best, high


def nearest_many(
    wish: Floats, normals: Floats, bounds: Floats, cap: Floats
) -> tuple[Floats, Bools]:
    """`nearest` for A agents.

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
    """`relaxed` for A agents; `soft` (K, A). v (2, A) and the slack of the hard planes (A,)."""
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
    """`_least` for A agents; each plane is in one of `firm` and `giving`, `UNBOUND` in the
    other."""
    low = np.zeros(wish.shape[1])
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        found, exists = nearest_many(wish, normals, np.maximum(firm, giving - middle), cap)
        best = np.where(exists, found, best)
        low, high = np.where(exists, low, middle), np.where(exists, middle, high)
    return best, high
