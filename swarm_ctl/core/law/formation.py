"""How well a formation stands. Points and slots are (..., n, 2) arrays of (north, east) in one
length unit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.model.arrays import Floats


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
