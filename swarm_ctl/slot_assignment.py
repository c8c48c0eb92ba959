"""Which agent takes which slot: from plan data alone, so that every process gets the same."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.law.formation import centred
from swarm_ctl.core.model.geometry import Point

Array: TypeAlias = npt.NDArray[np.float64]


def rounded(slots: npt.NDArray[np.float64]) -> tuple[Point, ...]:
    """Slots (n, 2) as they stand in plans and commands: no hash hangs on a machine's last bits, and
    -0.0 is 0.0."""
    return tuple((north, east) for north, east in (np.round(slots, 9) + 0.0).tolist())


def nearest(points: npt.ArrayLike, slots: npt.ArrayLike) -> Array:
    """The slots (n, 2) in the order of the points (n, 2) with the least total squared distance;
    with a third column, of heights, both (n, 3).

    The centroids are aligned first: the law forms the shape anywhere, so only the place within it
    counts. A point that is nan takes any slot.
    """
    targets = np.asarray(slots, dtype=np.float64)
    places = np.asarray(points, dtype=np.float64)
    known = np.isfinite(places[:, 0])
    cost = np.zeros((len(places), len(targets)))
    if known.any():
        between = centred(places[known])[:, None, :] - centred(targets)[None, :, :]
        # Rounded, so that machines whose last bits differ choose alike between slots equally far.
        cost[known] = np.round(np.sum(between**2, axis=-1), 9)
    return targets[_assigned(cost)]


def nearest_with_heights(
    points: npt.ArrayLike, slots: npt.ArrayLike, before: npt.ArrayLike, heights: npt.ArrayLike
) -> tuple[Array, list[float]]:
    """`nearest`, the points at heights `before` (n,) and the slots at `heights`, in units, too: the
    slots (n, 2), and their heights."""
    rows = nearest(np.column_stack([points, before]), np.column_stack([slots, heights]))
    return rows[:, :2], rows[:, 2].tolist()


def _assigned(cost: Array) -> npt.NDArray[np.intp]:
    """The column of each row, each column once, with the least sum of costs."""
    least: npt.NDArray[np.intp] = cost.argmin(axis=1)
    if len(set(least.tolist())) == len(least):  # each row has a least one of its own
        return least
    from scipy.optimize import linear_sum_assignment  # here, because it takes 0.4 s

    chosen: npt.NDArray[np.intp] = linear_sum_assignment(cost)[1]
    return chosen
