"""Two agents that are in each other's way exchange their slots: only the shape counts, not which
agent stands where.

An exchange of i and j lowers the sum of all squared distances to the slots iff `(s_i - s_j) . (z_i
- z_j) < 0`, wherever the shape as a whole stands. Each agent plays a *role*: the place in the
plan's list of agents whose slots it takes. An exchange swaps two roles, for this step and all that
follow. It takes one offer and one answer:

1. The lower i offers to j. The offer names j's version (its number of exchanges so far), so it
   cannot be taken twice.
2. j waits until all agents that may be concerned have heard of it, looks again, takes i's role and
   answers. The answer names i's version, and j repeats it until i has moved on.
3. i takes j's old role as soon as it hears the answer, even if it has withdrawn the offer: its
   version still fits.

A lost or repeated message delays, and changes nothing. Between 2 and 3 two agents have one role for
a moment, which costs nothing: they are kept apart as always.

An agent in an exchange shows a lock, the id of the agent that offers. An agent withdraws from its
exchange if a link neighbour shows a lock of lower rank: no two exchanges loosen the same links at
once. A link whose slots fit in r must fit after an exchange as well, or its two ends must have a
common neighbour whose links to both fit: the swarm stays connected. Should two agents be left with
one role (the news of one was lost for seconds), the higher id takes a role that is free.

Arrays throughout, so that an agent (`core/swarm/slot_exchange.py`) and a study of thousands of
missions (`study/batch/batch_slot_exchange.py`) run the same protocol: a is the agents that decide
(one, or all n), m the missions. Agents are named by their place 0..n-1 in the plan; -1 is none.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.model.arrays import Bools, Floats, Ints, keep_missions

T = TypeVar("T", bound=np.generic)

EVERY_S: Final = 0.25
"""Between two rounds of the protocol."""
WORTH: Final = -0.05
"""[units^2]: what an exchange must bring."""
_WAIT_S: Final = 1.0
"""From an offer to its answer: news is at most half a second old each way, or it does not count."""
_OFFER_S: Final = 4.0
"""An offer that is not answered is withdrawn ..."""
_QUIET_S: Final = 1.5
"""... and nothing new is begun before its answer must have been heard."""
_HEARD_S: Final = 0.5
"""Agents whose news is older take no part (`fresh`)."""
GONE_S: Final = 3.0
"""An answer is repeated no longer for an agent that is not heard."""
_TWINS_S: Final = 2.0
"""Two agents that have one role for so long do not come out of it by themselves."""
_WITHIN: Final = 0.98
"""In r: slots so close are a link that fits."""
_NONE: Final = -1
_TRIES: Final = 3
"""Partners looked at, best first."""


@dataclass(slots=True, eq=False)
class ExchangeStates:
    """What agents say of their exchanges; integer arrays (a, m), or (a, n, m): what a has heard of
    each of n."""

    role: Ints
    version: Ints
    lock: Ints
    offer_to: Ints
    offer_version: Ints
    answer_to: Ints
    answer_version: Ints
    answer_role: Ints

    @classmethod
    def none(cls, roles: Ints) -> Self:
        """Nothing said yet."""
        none = {
            f.name: np.full(roles.shape, _NONE)
            for f in fields(cls)
            if f.name not in ("role", "version")
        }
        return cls(role=roles.copy(), version=np.zeros(roles.shape, dtype=np.int64), **none)


class ExchangeProtocol:
    """The exchanges of a agents in m missions.

    Args:
        own: the agents that decide here (a,).
        slots: z by role (2, n, m) [units].
        links: j in N_i (n, n, m).
        r: interaction range [units].
    """

    def __init__(self, own: Ints, slots: Floats, links: Bools, r: float) -> None:
        self._own, self.slots, self.links, self._r = own[:, None], slots, links, r
        n = slots.shape[1]
        self._rank = np.argsort((np.arange(n) * 7919 + 3001) % 10007).argsort()
        """Of locks. Any order will do that does not follow the ids: else whole rows would wait for
        one another."""
        shape = (len(own), slots.shape[-1])
        self.states = ExchangeStates.none(np.broadcast_to(self._own, shape))
        self._since, self._quiet = np.zeros(shape), np.full(shape, -np.inf)
        self._partner = np.full(shape, _NONE)
        """The agent whose offer is considered since `_since`; an own offer stands since then."""
        self._twins = np.full(shape, np.inf)
        self.count = np.zeros(shape, dtype=np.int64)
        """Exchanges so far."""

    def only(self, missions: Bools) -> None:
        """Go on with some of the missions."""
        names = ("slots", "links", "_since", "_quiet", "_partner", "_twins", "count")
        keep_missions(self, missions, *names)
        keep_missions(self.states, missions, *(f.name for f in fields(ExchangeStates)))

    @property
    def at_rest(self) -> bool:
        """No offer is considered, and no other agent has the same role."""
        return bool((self._partner < 0).all() and np.isinf(self._twins).all())

    def step(
        self,
        now: float,
        own: Floats,
        points: Floats,
        told: ExchangeStates,
        age_s: Floats,
        fresh: Bools,
        new: Bools | None = None,
    ) -> Bools:
        """One round: take part in what goes on. Returns which agents changed their role, (a, m).

        Args:
            now: mission time [s].
            own: own stop points (2, a, m) [units].
            points: those of the others as heard (2, a, n, m).
            told: what they said (a, n, m).
            age_s: of it (a, n, m).
            fresh: heard within `_HEARD_S`, and flying the same shape (a, n, m); false for
                oneself.
            new: agents that offer and take offers (a, m), all where not given; the others end what
                they have begun.
        """
        fresh_for_new = fresh if new is None else fresh & new[:, None]
        before = self.states.role.copy()
        self._complete(now, told)
        settled = self._settled(told, age_s) & (now >= self._quiet)
        self._repair(now, told, fresh, settled)
        apart = own[:, :, None] - points
        gain = self._gain(apart, told)
        lowest = self._lowest_lock(told, fresh)
        self._mind_own_offer(now, told, fresh_for_new, gain, lowest)
        free = settled & (self.states.offer_to < 0) & (now >= self._quiet)
        self._consider(now, told, fresh_for_new, gain, free, lowest)
        near = fresh_for_new & ((apart**2).sum(axis=0) <= self._r**2)
        self._propose(now, told, near, gain, free & (self._partner < 0), lowest)
        changed: Bools = self.states.role != before
        self.count += changed
        return changed

    def _complete(self, now: float, told: ExchangeStates) -> None:
        """3: another agent has taken the own role."""
        mine = (told.answer_to == self._own[..., None]) & (
            told.answer_version == self.states.version[:, None]
        )
        answered = mine.any(axis=1)
        if answered.any():
            role = _of(told.answer_role, mine.argmax(axis=1))
            self._take(answered, role)
            self._end(answered)
            self._quiet = np.where(answered, now, self._quiet)

    def _settled(self, told: ExchangeStates, age_s: Floats) -> Bools:
        """No agent needs the own last answer any more."""
        to = self.states.answer_to
        moved_on = _of(told.version, to) != self.states.answer_version
        settled: Bools = (to < 0) | moved_on | (_of(age_s, to) > GONE_S)
        return settled

    def _repair(self, now: float, told: ExchangeStates, fresh: Bools, settled: Bools) -> None:
        """The higher id of two with one role takes a role that is free."""
        lower = np.arange(told.role.shape[1])[:, None] < self._own[:, None]
        twin = ((told.role == self.states.role[:, None]) & fresh & lower).any(axis=1) & settled
        self._twins = np.where(twin, np.minimum(self._twins, now), np.inf)
        stuck = now - self._twins >= _TWINS_S
        if not stuck.any():
            return
        # the roles that are held, the own one included (a, n, m)
        roles = np.arange(told.role.shape[1])
        others = told.role.copy()
        np.put_along_axis(
            others,
            np.broadcast_to(self._own, stuck.shape)[:, None],
            self.states.role[:, None],
            axis=1,
        )
        held = (others[:, :, None] == roles[:, None]).any(axis=1)
        stuck &= ~held.all(axis=1)
        self._take(stuck, held.argmin(axis=1))
        self._end(stuck)

    def _gain(self, apart: Floats, told: ExchangeStates) -> Floats:
        """(s_i - s_j) . (z_i - z_j), (a, n, m)."""
        z = self.slots_of(self.states.role)[:, :, None] - self.slots_of(told.role)
        gain: Floats = (apart * z).sum(axis=0)
        return gain

    def slots_of(self, roles: Ints) -> Floats:
        """The slots (2, ..., m) of roles (..., m)."""
        mission = np.arange(roles.shape[-1])
        return np.stack((self.slots[0, roles, mission], self.slots[1, roles, mission]))

    def _lowest_lock(self, told: ExchangeStates, fresh: Bools) -> Ints:
        """The lowest rank of a lock that a link neighbour shows, the own partner left out; n for
        none."""
        n = told.role.shape[1]
        linked = self.links[self._own[:, 0]] & fresh
        partner = np.where(self.states.offer_to >= 0, self.states.offer_to, self._partner)
        linked &= np.arange(n)[:, None] != partner[:, None]
        # place -1, no lock, picks the appended n
        rank = np.append(self._rank, n)[np.where(linked, told.lock, _NONE)]
        lowest: Ints = rank.min(axis=1)
        return lowest

    def _mind_own_offer(
        self, now: float, told: ExchangeStates, fresh: Bools, gain: Floats, lowest: Ints
    ) -> None:
        """Withdraw the own offer where it no longer holds."""
        to = self.states.offer_to
        offering = to >= 0
        if not offering.any():
            return
        good = (_of(gain, to) < 0.5 * WORTH) & _of(fresh, to) & (now - self._since <= _OFFER_S)
        good &= (
            (_of(told.version, to) == self.states.offer_version)
            & (lowest >= self._rank[self._own])
            & self._legal(to, told)
        )
        off = offering & ~good
        self._end(off)
        # an answer takes `_WAIT_S` and an offer heard in the last half second: a young offer cannot
        # have been taken
        taken = now - self._since > _WAIT_S - _HEARD_S
        self._quiet = np.where(off & taken, now + _QUIET_S, self._quiet)

    def _consider(
        self,
        now: float,
        told: ExchangeStates,
        fresh: Bools,
        gain: Floats,
        free: Bools,
        lowest: Ints,
    ) -> None:
        """2: look at the best offer to the own agent, and take it when its time has come."""
        offers = (
            fresh
            & (told.offer_to == self._own[:, None])
            & (told.offer_version == self.states.version[:, None])
        )
        offers &= (gain < WORTH) & free[:, None]
        partner = np.where(offers.any(axis=1), offers.argmax(axis=1), _NONE)
        if (partner >= 0).any():
            partner = np.where(
                (lowest >= self._rank[partner]) & self._legal(partner, told), partner, _NONE
            )
        self._since = np.where((partner >= 0) & (partner != self._partner), now, self._since)
        self._partner = partner
        offering = self.states.offer_to >= 0
        self.states.lock = np.where(offering, self._own, partner)
        due = (partner >= 0) & (now - self._since >= _WAIT_S)
        if due.any():
            states, version = self.states, _of(told.version, partner)
            states.answer_to = np.where(due, partner, states.answer_to)
            states.answer_version = np.where(due, version, states.answer_version)
            states.answer_role = np.where(due, states.role, states.answer_role)
            self._take(due, _of(told.role, partner))
            self._end(due)

    def _propose(
        self, now: float, told: ExchangeStates, near: Bools, gain: Floats, free: Bools, lowest: Ints
    ) -> None:
        """1: offer to the agent with which an exchange brings most, if it is legal."""
        free = free & (lowest >= self._rank[self._own])
        higher = np.arange(told.role.shape[1])[:, None] > self._own[:, None]
        open_ = near & higher & free[:, None] & (told.lock < 0) & (gain < WORTH)
        for _ in range(_TRIES):
            wants = open_.any(axis=1)
            if not wants.any():
                return
            best = np.where(open_, gain, np.inf).argmin(axis=1)
            legal = wants & self._legal(np.where(wants, best, _NONE), told)
            states = self.states
            states.offer_to = np.where(legal, best, states.offer_to)
            states.offer_version = np.where(legal, _of(told.version, best), states.offer_version)
            states.lock = np.where(legal, self._own, states.lock)
            self._since = np.where(legal, now, self._since)
            open_ = open_ & ~legal[:, None]
            np.put_along_axis(open_, best[:, None], np.zeros_like(open_[:, :1]), axis=1)

    def _legal(self, partner: Ints, told: ExchangeStates) -> Bools:
        """The swarm stays connected: each link of the two agents that fits in r still does, or is
        bridged."""
        legal = partner >= 0
        at, mission = np.nonzero(legal)
        if not len(at):
            return legal
        # K candidates: roles as heard, before and after the exchange (K, n)
        one, other, k = self._own[at, 0], partner[at, mission], np.arange(len(at))
        roles = told.role[at, :, mission]
        roles[k, one] = self.states.role[at, mission]
        links = np.moveaxis(self.links[..., mission], -1, 0)
        now = self._fitting(roles, mission) & links
        roles[k, one], roles[k, other] = roles[k, other], roles[k, one]
        then = self._fitting(roles, mission) & links
        # bridged: another agent has fitting links to both ends, a path of two in the new graph
        reach = then.astype(np.float32)
        for end in (one, other):
            bridged = (reach[k, end][:, None] @ reach)[:, 0] > 0
            legal[at, mission] &= ~(now[k, end] & ~then[k, end] & ~bridged).any(axis=1)
        return legal

    def _fitting(self, roles: Ints, mission: Ints) -> Bools:
        """Which slots are within 0.98 r of each other, (K, n, n), for roles (K, n)."""
        z = self.slots[:, roles, mission[:, None]]
        squared = ((z[:, :, :, None] - z[:, :, None]) ** 2).sum(axis=0)
        fits: Bools = squared <= (_WITHIN * self._r) ** 2
        return fits

    def _take(self, agents: Bools, role: Ints) -> None:
        self.states.role = np.where(agents, role, self.states.role)
        self.states.version = self.states.version + agents

    def _end(self, agents: Bools) -> None:
        """No offer, no consideration, no lock."""
        for name in ("offer_to", "offer_version", "lock"):
            setattr(self.states, name, np.where(agents, _NONE, getattr(self.states, name)))
        self._partner = np.where(agents, _NONE, self._partner)


def _of(heard: NDArray[T], which: Ints) -> NDArray[T]:
    """What was heard (a, n, m) of `which` (a, m); anything where that is no agent."""
    return np.take_along_axis(heard, np.maximum(which, 0)[:, None], axis=1)[:, 0]
