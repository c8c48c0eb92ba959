"""The law (26) for many whole swarms at once, laid out for speed: missions on the last axis,
contiguous in memory.

It gives each agent what `formation_law.evaluate` gives it (`gains`, `separate` and `adapt_sigma`
are shared; a test holds the sums together), but the sum over the neighbours is one product with a
matrix of links, and each distance serves both agents of a pair. Points are (2, n, m): component,
agent, mission. Lengths in units.

Pairs stand in rings: row (k, i), of n // 2 rings, is agent i and agent (i + k + 1) mod n. So the
second of a pair is a window that slides over the doubled list of agents, and nothing has to be
gathered. With an even n the last ring holds each pair twice; its second half is not used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import as_strided

from swarm_ctl.core.law.formation_law import AdaptedSigma, adapt_sigma, gains, separate
from swarm_ctl.core.model.arrays import Bools, Floats, Indices, places, taken
from swarm_ctl.core.model.plan import LawParameters

_SMALL: Final = 16
"""Under so many agents a loop along the missions beats a matrix product for each."""


@dataclass(frozen=True, slots=True, eq=False)
class NearPairs:
    """The pairs inside `r_out`. Row 0 is how `first` sees the pair; row 1, if there is one, how
    `second` does."""

    first: Indices
    second: Indices
    mission: Indices
    """Each (K,)."""
    distance: Floats
    neighbour: Bools
    """(K,)."""
    numbers: AdaptedSigma
    """Each (1, K) or (2, K)."""


class SwarmTerms(NamedTuple):
    """The two terms of u (2, n, m), and what is behind them."""

    consensus: Floats
    avoidance: Floats
    near: NearPairs | None
    told: Floats
    """The others' e_j as agent i takes them to be (2, i, j, m)."""


class Rings:
    """Squared distances of all pairs of n agents in m missions. Owns its working memory."""

    def __init__(self, n: int, m: int) -> None:
        rings = n // 2
        k, i = np.indices((rings, n))
        self.first = i
        """(rings, n), as all that follows."""
        self.second = (i + k + 1) % n
        self.once = (k + 1 < n / 2) | (i < self.second)
        """False where a pair stands for the second time."""
        self.squared = np.empty((rings, n, m))
        """(rings, n, m), of the last `measure`."""
        self._other = np.empty((rings, n, m))
        self._inside = np.empty((rings, n, m), dtype=np.bool_)
        self._doubled = np.empty((2, n + rings, m))
        a, b, c = self._doubled.strides
        self._window = as_strided(
            self._doubled[:, 1:], (2, rings, n, m), (a, b, b, c), writeable=False
        )

    def measure(self, points: Floats) -> Floats:
        """Fills `squared` for `points` (2, n, m)."""
        n = points.shape[1]
        self._doubled[:, :n] = points
        self._doubled[:, n:] = points[:, : n // 2]
        np.subtract(self._doubled[0, :n], self._window[0], out=self.squared)
        np.multiply(self.squared, self.squared, out=self.squared)
        np.subtract(self._doubled[1, :n], self._window[1], out=self._other)
        np.multiply(self._other, self._other, out=self._other)
        return np.add(self.squared, self._other, out=self.squared)

    def inside(self, radius: float) -> tuple[Indices, Indices, Indices]:
        """(first, second, mission) of each pair that was measured closer than `radius`."""
        np.less(self.squared, radius * radius, out=self._inside)
        n, m = self.squared.shape[1:]
        if n % 2 == 0:
            self._inside[-1, n // 2 :] = False
        row, mission = np.divmod(np.flatnonzero(self._inside), m)
        return self.first.ravel().take(row), self.second.ravel().take(row), mission


class SwarmLaw:
    """The law of m missions of n >= 2 agents. Owns its working memory.

    A mission's numbers do not depend on the others in its batch, to the last bit, as long as there
    are others: a batch of one is summed in another order.

    Args:
        slots: z (2, n, m).
        links: i follows j (n, n, m), false on the diagonal; symmetric for `step`.
        h: (m,), each mission's consensus gain.
        law: all but `h`.
    """

    def __init__(self, slots: Floats, links: Bools, h: Floats, law: LawParameters) -> None:
        self.law, self.links, self.h = law, np.ascontiguousarray(links), h
        self.slots = np.ascontiguousarray(slots)
        _, n, m = slots.shape
        self._small = n < _SMALL
        self._weights = np.ascontiguousarray(links, dtype=np.float64)
        self._count = np.count_nonzero(links, axis=1)
        order = self._weights if self._small else np.moveaxis(self._weights, -1, 0)
        self._apart = order.copy()
        """The same with minus the number of neighbours on the diagonal: n is one product with the
        errors."""
        diagonal = np.arange(n)
        self._apart[(diagonal, diagonal) if self._small else (slice(None), diagonal, diagonal)] = -(
            self._count if self._small else self._count.T
        )
        self._gain, self._beta = gains(h, self._count)
        self.rings = Rings(n, m)
        """Holds the distances of the last `step`."""

    def only(self, missions: Bools) -> SwarmLaw:
        """The same for some of the missions."""
        return SwarmLaw(
            self.slots[..., missions], self.links[..., missions], self.h[missions], self.law
        )

    def step(self, points: Floats) -> tuple[Floats, NearPairs | None]:
        """One iteration of (26) where all agents know all `points` (2, n, m): u (2, n, m) [units]
        and the near pairs."""
        n = self._sum_apart(points - self.slots)
        u: Floats = n * self._gain
        self.rings.measure(points)
        pair = self.rings.inside(self.law.r_out)
        if not len(pair[0]):
            return u, None
        return u, self._repel(
            u, n, points, _taken(points, pair[1] * points.shape[-1] + pair[2]), pair
        )

    def step_heard(
        self, points: Floats, heard: Floats, slots: Floats, told_slots: Floats
    ) -> SwarmTerms:
        """The same where agent i takes agent j to be elsewhere: late, or foretold.

        Args:
            points: where agents are (2, n, m).
            heard: where agent i takes agent j to be (2, i, j, m), or (2, 1, j, m).
            slots: as they are now (2, n, m).
            told_slots: as agent i has heard of agent j's, shaped as `heard`.
        """
        error = points - slots
        told = np.broadcast_to(heard - told_slots, (2, *self.links.shape))
        # the sum of the neighbours' e_j, for each i, component and mission
        n = np.einsum("ijm,cijm->cim", self._weights, told) - self._count * error
        avoidance, near = np.zeros_like(n), None
        squared = points[0][:, None] - heard[0]
        squared *= squared
        east = points[1][:, None] - heard[1]
        east *= east
        squared += east
        inside = squared < self.law.r_out**2
        inside[np.arange(len(inside)), np.arange(len(inside))] = False
        first, second, mission = places(inside)
        if len(first):
            pair = (first, second, mission)
            near = self._repel(avoidance, n, points, taken(heard, *pair), pair, both=False)
        return SwarmTerms(n * self._gain, avoidance, near, told)

    def _sum_apart(self, error: Floats) -> Floats:
        """Sum of e_j - e_i over the neighbours j, (2, n, m): one matrix product a mission, or a
        loop along the missions of small swarms."""
        if not self._small:
            return np.ascontiguousarray((self._apart @ error.transpose(2, 1, 0)).transpose(2, 1, 0))
        total = np.empty_like(error)
        for component, summed in zip(error, total, strict=True):
            np.einsum("ijm,jm->im", self._apart, component, out=summed)
        return total

    def _repel(
        self,
        u: Floats,
        n: Floats,
        points: Floats,
        seen: Floats,
        pair: tuple[Indices, Indices, Indices],
        both: bool = True,
    ) -> NearPairs:
        """Add the avoidance terms of the pairs (first, second, mission), (K,) each, to u.

        Args:
            u: added to, (2, n, m).
            n: sum of the neighbours' e_j - e_i (2, n, m).
            points: (2, n, m).
            seen: where `first` takes `second` to be (2, K).
            pair: the pairs.
            both: `second` is pushed as well, by the same distance.
        """
        first, second, mission = pair
        count, m = points.shape[1:]
        q = _taken(points, first * m + mission) - seen
        q_x, q_y, x = separate(q[0], q[1], first < second, self.law)
        linked = self.links.ravel().take((first * count + second) * m + mission)
        # flat index into (n, m) of the agents that are pushed, (1 or 2, K)
        agents = (np.stack((first, second)) if both else first[None]) * m + mission
        members = self._members(agents, linked, count * m)
        # seen from the second of a pair q points the other way; turning the pull instead is the
        # same
        side = np.array([[1.0], [-1.0]])[: len(agents)]
        beta = self._beta.ravel().take(agents) * linked * side
        pull_x, pull_y = n[0].ravel().take(agents) * beta, n[1].ravel().take(agents) * beta
        numbers = adapt_sigma(q_x, q_y, x, pull_x, pull_y, members, self.law)
        # alpha q of each pair, summed by agent
        push = numbers.alpha * side
        flat = agents.ravel()
        u[0] += np.bincount(flat, (push * q_x).ravel(), count * m).reshape(count, m)
        u[1] += np.bincount(flat, (push * q_y).ravel(), count * m).reshape(count, m)
        return NearPairs(first, second, mission, x, linked, numbers)

    def _members(self, agents: Indices, linked: Bools, size: int) -> Indices:
        """N for neighbours, M (near strangers) for strangers."""
        count: Indices = self._count.ravel().take(agents)
        if linked.all():
            return count
        strangers = np.bincount(agents[:, ~linked].ravel(), minlength=size)
        return np.where(linked, count, strangers.take(agents))


def _taken(points: Floats, places: Indices) -> Floats:
    """Points (2, n, m) at flat places (K,) in (n, m): (2, K). A flat take is several times quicker
    than an index."""
    return points.reshape(2, -1).take(places, axis=1)
