"""The safety filter of `core/safety/safety_filter.py` for all n agents of m missions at once.

Any one unit of length; a horizontal vector is the complex number north + 1j * east. The formulas
are shared (`constraints`, `deadlock`); what is written twice is the way through peers, one by one
there and by arrays here. `tests/unit/core/safety/test_batch_safety_filter.py` holds the two
together.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.model.arrays import MANY, Bools, Complex, Floats, Indices, Ints, T, complex_of
from swarm_ctl.core.model.plan import LawParameters, Safety
from swarm_ctl.core.model.timeouts import NEIGHBOUR_S, PREDICT_S
from swarm_ctl.core.safety import constraints
from swarm_ctl.core.safety.constraints import Margins
from swarm_ctl.core.safety.deadlock import SWIRL_OFF, DeadlockRelease, swirled
from swarm_ctl.core.safety.velocity_qp import UNBOUND, relaxed_many

_ROUNDING: Final = 1e-6
"""Of lengths: no pair is left out that forbids a trifle."""


class Pairs(NamedTuple):
    """Single pairs of a receiver and a sender, (K,) each, by their places in flat arrays."""

    link: Indices
    """In (receivers, senders, missions)."""
    receiver: Indices
    """In (agents, missions), as is the next."""
    sender: Indices

    @classmethod
    def of(cls, mask: Bools) -> Self:
        """Those (n, n, m) for which the mask is true."""
        _, n, m = mask.shape
        link = np.flatnonzero(mask)
        row, sender = np.divmod(link, n * m)
        return cls(link, row * m + sender % m, sender)

    def only(self, some: Bools) -> Self:
        """Some of them."""
        return type(self)(*(places[some] for places in self))

    def of_receiver(self, known: NDArray[T]) -> NDArray[T]:
        """What the receivers know of themselves, (..., n, m): (..., K)."""
        return _flat(known, 2).take(self.receiver, axis=-1)

    def of_sender(self, known: NDArray[T]) -> NDArray[T]:
        """What the receivers (n, or 1 where all know the same) know of the senders (..., n or 1, n,
        m): (..., K)."""
        place = self.sender if known.shape[-3] == 1 else self.link
        return _flat(known, 3).take(place, axis=-1)


def _flat(array: NDArray[T], axes: int) -> NDArray[T]:
    """With the last axes made one."""
    return array.reshape(*array.shape[:-axes], -1)


@dataclass(frozen=True, slots=True, eq=False)
class BatchHeard:
    """What is known of other aircraft, of pairs (K,) or by receiver, sender and mission."""

    setpoint: Complex
    """The velocity it was told to fly."""
    age_at_most_s: Floats
    fresh: Bools
    """The news is at most `FRESH_S` old."""
    yields: Bools
    """It does its half of keeping apart."""
    response_s: Floats
    """From a setpoint to its flown velocity, as it tells."""

    def of_pairs(self, pairs: Pairs) -> BatchHeard:
        """What single pairs know, (K,)."""
        return BatchHeard(*(pairs.of_sender(getattr(self, f.name)) for f in fields(self)))

    def only(self, some: Bools) -> BatchHeard:
        """Of some of the pairs."""
        return BatchHeard(*(getattr(self, f.name)[some] for f in fields(self)))


@dataclass(frozen=True, slots=True, eq=False)
class BatchPeers:
    """What each receiver (n, or 1 where all hear the same) knows of each sender (n), by mission."""

    points: Floats
    """The receivers' stop points (2, n, m)."""
    told: Floats
    """The senders', as they were told (2, n or 1, n, m)."""
    heard: BatchHeard
    """(n or 1, n, m); what is alike for all receivers may be (1, n, m)."""
    doubt_s: Floats
    """Each receiver's of its own response (n, m)."""
    response_s: Floats
    """Each receiver's own (n, m)."""

    def apart(self, pairs: Pairs) -> Complex:
        """The receiver's stop point minus the sender's, of single pairs (K,)."""
        return complex_of(pairs.of_receiver(self.points) - pairs.of_sender(self.told))

    def unsure_s(self) -> Floats:
        """No sender makes a receiver more unsure of its own vehicle than this (n, m)."""
        told, own = self.heard.response_s, self.response_s
        differs = np.maximum(told.max(axis=(0, 1)) - own, own - told.min(axis=(0, 1)))
        return np.asarray(self.doubt_s + differs)

    def squared(self) -> Floats:
        """The squared distances (n, n, m), infinite from an agent to itself."""
        found: Floats = self.points[0][:, None] - self.told[0]
        found *= found
        east = self.points[1][:, None] - self.told[1]
        east *= east
        found += east
        itself = np.arange(len(found))
        found[itself, itself] = np.inf
        return found


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
    """Chooses the velocities that the agents fly.

    Args:
        safety: which parts are on.
        law: r_out, in the unit of `margins`.
        margins: lengths and speeds of the filter.
        tick_s: between two calls of `velocity`.
        agents: ids (n, m); a lower row has a lower id.
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
        squared = peers.squared()
        if not self._safety.release:
            return self._filtered(consensus + avoidance, peers, squared, links)
        # an agent close by that is not heard does not swirl along: the avoidance stays as it is
        unheard = (~peers.heard.fresh & (squared < self._swirl_off**2)).any(axis=1)
        avoidance = np.where(unheard, avoidance, swirled(consensus, avoidance))
        wish = self.release.turn(consensus + avoidance, consensus)
        flown = self._filtered(wish, peers, squared, links)
        self.release.note(consensus, flown)
        return flown

    def _filtered(
        self, wish: Complex, peers: BatchPeers, squared: Floats, links: BatchLinks
    ) -> Complex:
        """The velocities nearest to the wishes that keep apart and, for the links, together."""
        margins = self._margins
        wish = wish * (margins.speed / np.maximum(np.abs(wish), margins.speed))
        if not self._safety.filter:
            return np.asarray(wish)
        pairs, heard, apart = self._near(peers, squared)
        # one plane for each near pair: the receiver keeps out of the sender
        agent = pairs.receiver
        normal, bound, room = constraints.keep_out_plane(
            apart, agent < pairs.sender, heard, margins, MANY
        )
        own = (pairs.of_receiver(peers.doubt_s), pairs.of_receiver(peers.response_s))
        unsure_s = constraints.unsure(*own, heard, MANY)
        cap = np.full(wish.size, margins.speed)
        np.minimum.at(cap, agent, constraints.cap(room, unsure_s, margins, MANY))
        soft = np.zeros(len(agent), dtype=np.bool_)
        if self._safety.guard:
            # and one, soft, for each guarded link that is long
            guarding, normals, bounds = self._guards(peers, squared, links)
            agent, normal = np.concatenate((agent, guarding)), np.concatenate((normal, normals))
            bound = np.concatenate((bound, bounds))
            soft = np.concatenate((soft, np.ones(len(guarding), dtype=np.bool_)))
        flown, yielded = _solved(wish.ravel(), agent, normal, bound, soft, cap)
        flown = flown.reshape(wish.shape)
        self.touched = np.abs(flown - wish) > constraints.UNTOUCHED
        self.yielded = yielded.reshape(wish.shape) & self.touched
        return flown

    def _near(self, peers: BatchPeers, squared: Floats) -> tuple[Pairs, BatchHeard, Complex]:
        """The pairs in which the sender may constrain the receiver, what the receiver knows, and
        its stop point minus the sender's."""
        margins, heard = self._margins, peers.heard
        # few are unsure for as long as `margins.reach` allows for
        minded = margins.minded(peers.unsure_s(), MANY) + _ROUNDING
        reach = np.minimum(margins.reach, minded)
        # most pairs are far apart: a coarse look at all, an exact one at those that are left
        age_s = heard.age_at_most_s
        oldest_s = np.where(heard.fresh, age_s, 0.0).max(axis=(0, 1))
        half = margins.keep_out + reach + (margins.speed + margins.growth) * oldest_s
        coarse = squared < (half[:, None] + _ROUNDING) ** 2
        shy = heard.fresh & heard.yields
        if not shy.all():
            far = np.maximum(half, margins.farthest)
            coarse |= (squared < (far[:, None] + _ROUNDING) ** 2) & ~shy
        pairs = Pairs.of(coarse)
        known, apart = heard.of_pairs(pairs), peers.apart(pairs)
        exact = constraints.constrains(known, abs(apart), margins, MANY, pairs.of_receiver(reach))
        return pairs.only(exact), known.only(exact), apart[exact]

    def _guards(
        self, peers: BatchPeers, squared: Floats, links: BatchLinks
    ) -> tuple[Indices, Complex, Floats]:
        """(agent, normal, bound), (K,) each, of the guarded links that forbid something."""
        margins = self._margins
        if links is not self._links:
            self._links = links
            gap = np.abs(links.slots[:, None] - links.told_slots)
            self._guarded = links.links & constraints.fits(gap, margins)
            self._tight = constraints.tight(gap, margins)
        # a link that was told up to `PREDICT_S` ago may be so much longer by now
        least = max(margins.guards_from - margins.speed * PREDICT_S - 1e-6, 0.0)
        minded = self._guarded & (squared > least * least)
        minded &= peers.heard.age_at_most_s <= NEIGHBOUR_S
        if self._safety.release and self.release.releasing.any():
            minded &= ~(self.release.releasing[:, None] & self._tight)
        pairs = Pairs.of(minded)
        heard = peers.heard.of_pairs(pairs)
        now = constraints.carried(peers.apart(pairs), heard, MANY)
        normal, bound = constraints.guard_plane(now, heard.setpoint, margins, MANY)
        binds = constraints.kept(np.abs(now), margins) & (bound > -margins.speed)
        return pairs.receiver[binds], normal[binds], bound[binds]


def _solved(
    wish: Complex, agent: Indices, normal: Complex, bound: Floats, soft: Bools, cap: Floats
) -> tuple[Complex, Bools]:
    """The quadratic program of each agent that has something to obey.

    Args:
        wish: (A,), as is cap.
        agent: whose plane this is (K,), as are normal, bound and soft.

    Returns:
        the velocities, and where hard planes gave way, (A,) each.
    """
    # most agents wish for something that is allowed: only the others are solved
    violated = (normal.real * wish.real[agent] + normal.imag * wish.imag[agent]) < bound - 1e-9
    busy = np.zeros(len(wish), dtype=np.bool_)
    busy[agent[violated]] = True
    busy |= np.abs(wish) > cap * (1.0 + 1e-12)
    flown, yielded = wish.copy(), np.zeros(len(wish), dtype=np.bool_)
    if not busy.any():
        return flown, yielded
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
    return flown, yielded
