"""Which agent takes which slot: from plan data alone, so that every process gets the same."""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.law.formation import centred
from swarm_ctl.core.model.geometry import Point

Array: TypeAlias = npt.NDArray[np.float64]
_NONE: Final = -1


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


def _assigned(cost: Array) -> list[int]:
    """The column of each row, each column once, with the least sum of costs.

    Shortest augmenting paths (Crouse, IEEE T-AES 52(4), 2016), step by step as SciPy's
    `linear_sum_assignment` takes them: between equal sums it chooses the same, and plans keep their
    hashes. SciPy itself takes 0.4 s to import, for each process that reads a mission.
    """
    least: list[int] = cost.argmin(axis=1).tolist()
    if len(set(least)) == len(least):  # each row has a least one of its own
        return least
    costs: list[list[float]] = cost.tolist()
    count = len(costs)
    by_row, by_column = [0.0] * count, [0.0] * count  # the dual variables
    row_of, column_of = [_NONE] * count, [_NONE] * count
    for row in range(count):
        reached, before, total = [math.inf] * count, [_NONE] * count, 0.0
        left = list(range(count - 1, -1, -1))
        rows, columns, here = list[int](), list[int](), row
        while here != _NONE:
            rows.append(here)
            lowest, at = math.inf, _NONE
            for k, column in enumerate(left):
                length = total + costs[here][column] - by_row[here] - by_column[column]
                if length < reached[column]:
                    reached[column], before[column] = length, here
                length = reached[column]
                if length < lowest or (length == lowest and row_of[column] == _NONE):
                    lowest, at = length, k
            total, column = lowest, left[at]
            columns.append(column)
            left[at] = left[-1]
            left.pop()
            here = row_of[column]
        by_row[row] += total
        for other in rows[1:]:
            by_row[other] += total - reached[column_of[other]]
        for other in columns:
            by_column[other] -= total - reached[other]
        while here != row:  # the path back from the free column
            here = before[column]
            row_of[column] = here
            column_of[here], column = column, column_of[here]
    return column_of
