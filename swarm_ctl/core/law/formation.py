"""How well a formation stands, and how one closes its gaps. Points and slots are (..., n, 2) arrays
of (north, east) in one length unit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.model import geometry
from swarm_ctl.core.model.arrays import Floats
from swarm_ctl.core.model.geometry import Point


def errors(points: npt.ArrayLike, slots: npt.ArrayLike) -> Floats:
    """`e_i = p_i - z_i`, (..., n, 2)."""
    return np.asarray(points, dtype=np.float64) - np.asarray(slots, dtype=np.float64)


def centred(points: npt.ArrayLike) -> Floats:
    """The same points with their centroid at zero, (..., n, 2)."""
    array = np.asarray(points, dtype=np.float64)
    return np.asarray(array - array.mean(axis=-2, keepdims=True))


def formation_error(points: npt.ArrayLike, slots: npt.ArrayLike) -> Floats:
    """Largest `|e_i - mean e|`, (...): zero when the shape stands, wherever it stands. Pass live
    agents only."""
    return np.asarray(np.linalg.norm(centred(errors(points, slots)), axis=-1).max(axis=-1))


def error_of_one(points: Sequence[complex], slots: Sequence[complex]) -> float:
    """`formation_error` of one formation to the last bit, at a fifth of its time. Vectors are north
    + 1j * east; not empty."""
    found = [point - slot for point, slot in zip(points, slots, strict=True)]
    mean = sum(found, start=0j) / len(found)
    off = [e - mean for e in found]
    return math.sqrt(max(e.real * e.real + e.imag * e.imag for e in off))


def distances(points: npt.ArrayLike) -> Floats:
    """`|p_i - p_j|` of every pair, (..., n, n); zero on the diagonal."""
    array = np.asarray(points, dtype=np.float64)
    return np.asarray(np.linalg.norm(array[..., :, None, :] - array[..., None, :, :], axis=-1))


def closest_pair(points: npt.ArrayLike) -> tuple[float, tuple[int, int]] | None:
    """The smallest distance in one (n, 2) array and its pair of indices, lower first; None for
    fewer than two."""
    between = distances(points)
    if between.shape[-1] < 2:
        return None
    np.fill_diagonal(between, np.inf)
    i, j = np.unravel_index(int(np.argmin(between)), between.shape)
    return float(between[i, j]), (int(min(i, j)), int(max(i, j)))


def smallest_distance(
    points: npt.ArrayLike, ups_m: Sequence[float] = (), layer_m: float = math.inf
) -> float:
    """The smallest distance between two of the points, an (n, 2) array, whose heights `ups_m` (():
    all alike) differ by less than `layer_m`; infinite where there are no two."""
    between = distances(points)
    np.fill_diagonal(between, np.inf)
    if ups_m:
        between[apart_in_height(ups_m, layer_m)] = np.inf
    return float(between.min(initial=np.inf))


def apart_in_height(ups_m: Sequence[float], layer_m: float) -> npt.NDArray[np.bool_]:
    """Of each two of n heights, whether they differ by `layer_m`, but for rounding: (n, n)."""
    ups = np.asarray(ups_m, dtype=np.float64)
    return np.asarray(np.abs(ups[:, None] - ups[None, :]) >= layer_m - 1e-9)


def dealt(slots: Sequence[Point], places: Sequence[Point]) -> list[int]:
    """Who of those that are left flies to which place of the smaller shape: for each slot, the
    index of the place that its agent takes. Near ones first, then exchanged in pairs while the sum
    of the squared ways falls: each agent finds the same by itself.

    Args:
        slots: of the agents that are left, in the whole shape [units].
        places: of the smaller shape, as many.
    """
    ways = [complex(*slot) for slot in geometry.centred(slots)]
    ends = [complex(*place) for place in geometry.centred(places)]
    cost = [[round(abs(end - at) ** 2, 9) for end in ends] for at in ways]
    count = range(len(ways))
    found, taken = [-1] * len(ways), set[int]()
    for _, k, place in sorted((cost[k][place], k, place) for k in count for place in count):
        if found[k] < 0 and place not in taken:
            found[k] = place
            taken.add(place)
    better = True
    while better:
        better = False
        for a in count:
            for b in range(a + 1, len(ways)):
                now = cost[a][found[a]] + cost[b][found[b]]
                if cost[a][found[b]] + cost[b][found[a]] < now - 1e-6:
                    found[a], found[b] = found[b], found[a]
                    better = True
    return found
