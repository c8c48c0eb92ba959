"""The smallest true distance of each pair so far, and collisions. Pure."""

from __future__ import annotations

import numpy as np

from swarm_sim.physics.kinematics import Array, Mask, some

COLLISION_M = 0.5
"""Airframes half a metre across touch when their centres are closer than this."""
_NEAR_M = 3.0
"""Pairs nearer than this are looked at between steps, too. Farther ones pass each other at 40 m/s
with an error of 3 cm at most."""


_OVER_M = 3.0
"""A vehicle so much higher than one that stands on the ground flies over it: no approach."""


class PairMinima:
    """Running smallest horizontal distance of all pairs of n vehicles, and which pairs touch."""

    def __init__(self, n: int) -> None:
        self._below = np.tri(n, k=0, dtype=np.bool_)
        self._least = np.where(self._below, -1.0, np.inf)
        self._told = self._least.copy()
        self.square = np.full((n, n), np.inf)
        """Of the horizontal distances [m2] at the newest step; inf: one flies over the other."""
        self._touching: set[tuple[int, int]] = set()
        self._before: Array | None = None

    def update(self, position: Array, landed: Mask | None = None) -> list[tuple[int, int]]:
        """Takes positions (n, 3), and which vehicles have landed (n,); returns the pairs (i < j)
        that have just begun to touch (in three dimensions), at this step or on the way to it."""
        if len(position) == 1:
            return []
        before, self._before = self._before, position.copy()
        # all pairs at once, by squares; the diagonal is each vehicle with itself
        north, east = position[:, 0], position[:, 1]
        square = np.subtract.outer(north, north) ** 2 + np.subtract.outer(east, east) ** 2
        self.square = square
        if landed is not None and some(landed):
            down = position[:, 2]
            higher = np.abs(np.subtract.outer(down, down)) > _OVER_M
            square[higher & (landed != landed[:, None])] = np.inf
        np.minimum(self._least, square, out=self._least)
        close = square < _NEAR_M**2
        alone = np.count_nonzero(close) == len(position)
        if alone and not self._touching:
            return []
        i, j = np.nonzero(close & ~self._below)
        before = position if before is None else before
        start, end = before[i] - before[j], position[i] - position[j]
        flat = _closest(start[:, :2], end[:, :2])
        self._least[i, j] = np.minimum(self._least[i, j], (flat**2).sum(axis=1))
        apart = np.abs(_closest(start, end))
        touch = (np.hypot(apart[:, 0], apart[:, 1]) < COLLISION_M) & (apart[:, 2] < COLLISION_M)
        now = set(zip(i[touch].tolist(), j[touch].tolist(), strict=True))
        begun = sorted(now - self._touching)
        self._touching = now
        return begun

    def shrunk(self) -> list[tuple[int, int, float]]:
        """Pairs (i, j, metres) whose smallest distance shrank since the last call."""
        rows, columns = np.nonzero(self._least < self._told)
        self._told[rows, columns] = self._least[rows, columns]
        distances = np.sqrt(self._least[rows, columns])
        return list(zip(rows.tolist(), columns.tolist(), distances.tolist(), strict=True))


def _closest(start: Array, end: Array) -> Array:
    """The shortest vector (pairs, axes) on each straight way from `start` to `end`."""
    way = end - start
    share = -(start * way).sum(axis=1) / np.maximum((way * way).sum(axis=1), 1e-12)
    return np.asarray(start + np.clip(share, 0.0, 1.0)[:, None] * way)
