"""The safety filter of `core/safety/safety_filter.py` for all n agents of m missions at once.

Any one unit of length; a horizontal vector is the complex number north + 1j * east. The formulas
are shared (`constraints`, `deadlock`); what is written twice is the way through peers, one by one
there and by arrays here. `tests/unit/core/safety/test_batch_safety_filter.py` holds the two
together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swarm_ctl.core.model.arrays import MANY, Bools, Complex, Floats, Indices, Ints
from swarm_ctl.core.model.plan import LawParameters, Safety
from swarm_ctl.core.model.timeouts import NEIGHBOUR_S, PREDICT_S, SILENT_FLIES_S
from swarm_ctl.core.safety import constraints
from swarm_ctl.core.safety.constraints import Margins
from swarm_ctl.core.safety.deadlock import SWIRL_OFF, DeadlockRelease, swirled
from swarm_ctl.core.safety.velocity_qp import UNBOUND, relaxed_many


@dataclass(frozen=True, slots=True, eq=False)
class BatchPeers:
    """What each receiver (n, or 1 where all hear the same) knows of each sender (n), by mission."""

    apart: Complex
    """The receiver's stop point minus the sender's as told (n, n, m)."""
    commanded: Complex
    """As told, like all that follows (n or 1, n, m)."""
    age_s: Floats
    heard: Bools
    """Its news is fresh."""
    yields: Bools
    """It does its half of keeping apart."""


@dataclass(frozen=True, slots=True, eq=False)
class BatchLinks:
    """The neighbour links that the guard may mind; the same object for as long as they last."""

    links: Bools
    """j in N_i (n, n, m)."""
    slots: Complex
    """Each agent's own slot (n, m)."""
    told_slots: Complex
    """The senders' slots as each receiver hears them (n or 1, n, m)."""


class BatchSafetyFilter:
    """Between the law's wish and the vehicles.

    Args:
        safety: which parts are on.
        law: r_out, in the unit of `margins`.
        margins: lengths and speeds of the filter.
        tick_s: between two calls of `velocity`.
        agents: ids (n, m), for the dice of the dead-lock release.
    """

    def __init__(
        self, safety: Safety, law: LawParameters, margins: Margins, tick_s: float, agents: Ints
    ) -> None:
        self._safety, self._margins = safety, margins
        self._swirl_off = law.r_out + SWIRL_OFF
        self.release = DeadlockRelease(agents, margins.speed, tick_s, MANY)
        self._links: BatchLinks | None = None
        self._guarded = self._tight = np.zeros((0, 0, 0), dtype=np.bool_)
        self.touched = self.yielded = np.zeros(agents.shape, dtype=np.bool_)
        """Agents whose wish was changed, or whose keep-outs excluded each other, in the last tick
        (n, m)."""

    def only(self, missions: Bools) -> None:
        """Go on with some of the missions."""
        self.release.only(missions)
        self._links = None

    def velocity(
        self, consensus: Complex, avoidance: Complex, peers: BatchPeers, links: BatchLinks
    ) -> Complex:
        """What is commanded for the law's two terms, all (n, m)."""
        distance = np.abs(peers.apart)
        itself = np.arange(len(distance))
        distance[itself, itself] = np.inf
        if not self._safety.release:
            return self._keep(consensus + avoidance, peers, distance, links)
        # an unheard agent close by does not swirl along: the avoidance stays as it is
        unheard = (~peers.heard & (distance < self._swirl_off)).any(axis=1)
        avoidance = np.where(unheard, avoidance, swirled(consensus, avoidance))
        wish = self.release.turn(consensus + avoidance, consensus)
        flown = self._keep(wish, peers, distance, links)
        self.release.note(consensus, flown)
        return flown

    def _keep(
        self, wish: Complex, peers: BatchPeers, distance: Floats, links: BatchLinks
    ) -> Complex:
        """The velocities nearest to the wishes that keep apart and, for the links, together."""
        margins, missions = self._margins, wish.shape[1]
        speed = margins.speed
        wish = wish * (speed / np.maximum(np.abs(wish), speed))
        reach = margins.keep_out + margins.reach
        lost = ~peers.heard
        near = distance < np.where(
            lost, reach + 3 * margins.growth + speed * (SILENT_FLIES_S + 1), reach + 0.5
        )
        # one plane for each near pair: agent i keeps out of j
        i, j, mission = np.nonzero(near)
        agent = i * missions + mission
        apart, commanded, age_s = _of_pairs(peers, i, j, mission)
        gone = np.broadcast_to(lost, distance.shape)[i, j, mission]
        normal, bound, room = constraints.half_plane(
            apart,
            commanded,
            np.where(gone, SILENT_FLIES_S, age_s),
            margins.out(age_s, np.minimum),
            np.where(gone, 1.0, 0.5),
            speed,
            np.minimum,
            np.maximum,
        )
        least_room = np.full(wish.size, np.inf)
        np.minimum.at(least_room, agent, room)
        cap = constraints.cap(least_room, margins, np.maximum, np.minimum)
        soft = np.zeros(len(agent), dtype=np.bool_)
        if self._safety.guard:
            # and one, soft, for each guarded link that is long
            guarding, normals, bounds = self._guards(peers, distance, links)
            agent, normal = np.concatenate((agent, guarding)), np.concatenate((normal, normals))
            bound = np.concatenate((bound, bounds))
            soft = np.concatenate((soft, np.ones(len(guarding), dtype=np.bool_)))
        flown, touched, yielded = _solved(wish.ravel(), agent, normal, bound, soft, cap)
        self.touched, self.yielded = touched.reshape(wish.shape), yielded.reshape(wish.shape)
        return flown.reshape(wish.shape)

    def _guards(
        self, peers: BatchPeers, distance: Floats, links: BatchLinks
    ) -> tuple[Indices, Complex, Floats]:
        """(agent, normal, bound) of each link that is guarded and so long that it forbids
        something."""
        if links is not self._links:
            self._links = links
            gap = np.abs(links.slots[:, None] - links.told_slots)
            self._guarded = links.links & constraints.guarded(gap, 0.0, self._margins)
            self._tight = constraints.tight(gap, self._margins)
        far = distance > constraints.guards_from(self._margins) - self._margins.speed * PREDICT_S
        minded = self._guarded & far & (peers.age_s <= NEIGHBOUR_S)
        if self._safety.release:
            minded &= ~(self.release.releasing[:, None] & self._tight)
        i, j, mission = np.nonzero(minded)
        apart, commanded, age_s = _of_pairs(peers, i, j, mission)
        now = apart - commanded * np.minimum(age_s, PREDICT_S)
        # links that are lost already are left alone
        kept = np.flatnonzero(constraints.guarded(0.0, np.abs(now), self._margins))
        normal, bound = constraints.guard_plane(
            now[kept], commanded[kept], self._margins, np.minimum, np.maximum
        )
        return (i * distance.shape[-1] + mission)[kept], normal, bound


def _of_pairs(
    peers: BatchPeers, i: Indices, j: Indices, mission: Indices
) -> tuple[Complex, Complex, Floats]:
    """(apart, commanded, age_s) of single pairs, (K,) each."""
    receiver = i if peers.commanded.shape[0] > 1 else np.zeros_like(i)
    age_s = peers.age_s[i if peers.age_s.shape[0] > 1 else np.zeros_like(i), j, mission]
    return peers.apart[i, j, mission], peers.commanded[receiver, j, mission], age_s


def _solved(
    wish: Complex, agent: Indices, normal: Complex, bound: Floats, soft: Bools, cap: Floats
) -> tuple[Complex, Bools, Bools]:
    """The quadratic program of each agent that has something to obey.

    Args:
        wish: (A,), as is cap.
        agent: whose plane this is (K,), as are normal, bound and soft.

    Returns:
        the velocities, which of them differ, and where hard planes gave way, (A,) each.
    """
    # most agents wish for something that is allowed: only the others are solved
    violated = (normal.real * wish.real[agent] + normal.imag * wish.imag[agent]) < bound - 1e-9
    busy = np.zeros(len(wish), dtype=np.bool_)
    busy[agent[violated]] = True
    busy |= np.abs(wish) > cap + 1e-9
    flown, yielded = wish.copy(), np.zeros(len(wish), dtype=np.bool_)
    if not busy.any():
        return flown, busy, yielded
    # their planes, sorted by agent, and the place of each in its agent's list
    chosen = np.flatnonzero(busy[agent])
    chosen = chosen[np.argsort(agent[chosen], kind="stable")]
    agent, normal, bound, soft = agent[chosen], normal[chosen], bound[chosen], soft[chosen]
    solved = np.flatnonzero(busy)
    column = np.searchsorted(solved, agent)
    rank = np.arange(len(agent)) - np.searchsorted(agent, solved)[column]
    # a table (place, solved agent), filled up with planes that forbid nothing
    size = int(rank.max(initial=-1)) + 1
    normals, bounds = np.zeros((size, 2, len(solved))), np.full((size, len(solved)), UNBOUND)
    normals[:, 0] = 1.0
    is_soft = np.zeros((size, len(solved)), dtype=np.bool_)
    normals[rank, 0, column], normals[rank, 1, column] = normal.real, normal.imag
    bounds[rank, column], is_soft[rank, column] = bound, soft
    wishes = np.stack((wish[solved].real, wish[solved].imag))
    v, slack = relaxed_many(wishes, normals, bounds, is_soft, cap[solved])
    flown[solved] = v[0] + 1j * v[1]
    yielded[solved] = slack > 0
    return flown, busy, yielded
