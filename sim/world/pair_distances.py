"""The smallest true distance of each pair so far, and collisions. Pure."""

from __future__ import annotations

import numpy as np

from sim.physics.kinematics import Array, Mask

COLLISION_M = 0.5
"""Airframes half a metre across touch when their centres are closer than this."""


class PairMinima:
    """Running smallest horizontal distance of all pairs of n vehicles, and which pairs touch."""

    def __init__(self, n: int) -> None:
        self._below = np.tri(n, k=0, dtype=np.bool_)
        self._least = np.where(self._below, -1.0, np.inf)
        self._told = self._least.copy()
        self._touching: set[tuple[int, int]] = set()

    def update(self, position: Array) -> list[tuple[int, int]]:
        """Takes positions (n, 3); returns the pairs (i < j) that have just begun to touch (in three
        dimensions)."""
        if len(position) == 1:
            return []
        # all pairs at once, by squares; the diagonal is each vehicle with itself
        north, east = position[:, 0], position[:, 1]
        square = np.subtract.outer(north, north) ** 2 + np.subtract.outer(east, east) ** 2
        np.minimum(self._least, square, out=self._least)
        close = square < COLLISION_M**2
        alone = np.count_nonzero(close) == len(position)
        if alone and not self._touching:
            return []
        return self._collisions(position, close & ~self._below)

    def shrunk(self) -> list[tuple[int, int, float]]:
        """Pairs (i, j, metres) whose smallest distance shrank since the last call."""
        rows, columns = np.nonzero(self._least < self._told)
        self._told[rows, columns] = self._least[rows, columns]
        distances = np.sqrt(self._least[rows, columns])
        return list(zip(rows.tolist(), columns.tolist(), distances.tolist(), strict=True))

    def _collisions(self, position: Array, close: Mask) -> list[tuple[int, int]]:
        pairs = zip(*(axis.tolist() for axis in np.nonzero(close)), strict=True)
        now = {(i, j) for i, j in pairs if abs(position[i, 2] - position[j, 2]) < COLLISION_M}
        begun = sorted(now - self._touching)
        self._touching = now
        return begun
