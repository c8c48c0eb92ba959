"""One agent's part in slot exchange (`core/swarm/exchange_protocol.py`): which agent flies to which
slot, and the own offers and answers.

A *role* is a place in the group's list of agents: role k flies to the k-th slot of each mission
step. Each agent begins with its own; an exchange swaps two, for this step and all that follow. New
exchanges begin only in form steps that allow them, and only between agents that are not done; an
exchange that has begun is brought to its end in any step that flies a formation. An operator's
shape gives each agent its own slot of it and knows no roles.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from operator import attrgetter
from typing import Final, TypeAlias

import numpy as np

from swarm_ctl.core.model.messages import AgentState, ExchangeState, Phase
from swarm_ctl.core.model.plan import GroupPlan, Plan, Point
from swarm_ctl.core.model.timeouts import FRESH_S, PREDICT_S
from swarm_ctl.core.swarm.exchange_protocol import (
    EVERY_S,
    GONE_S,
    WORTH,
    ExchangeProtocol,
    ExchangeStates,
)
from swarm_ctl.core.swarm.peers import Peers
from swarm_ctl.core.swarm.snapshot import FormationKey

_FIELDS: Final = tuple(ExchangeStates.__dataclass_fields__)
_ROW: Final = attrgetter(*_FIELDS)
_UNHEARD_S: Final = 1e9
_ROUNDING: Final = 1e-6
"""[units, units^2]: the round itself rounds otherwise."""
Links: TypeAlias = Mapping[int, tuple[int, ...]]


class SlotExchange:
    """Knows the roles as they are heard, and exchanges for one agent. Call `hear` and `look` every
    tick."""

    def __init__(self, plan: Plan, group: GroupPlan, own_id: int, peers: Peers) -> None:
        self._unit_m = plan.unit_m
        self._r = plan.law.r
        self._ids = group.ids
        self._places = {agent: place for place, agent in enumerate(self._ids)}
        self._own, self._place = own_id, self._places[own_id]
        self._peers = peers
        self._protocol: ExchangeProtocol | None = None
        self._slots: list[complex] = []
        """By role [units]."""
        self._links: Links = {}
        self._heard_of: dict[int, AgentState] = {}
        self._said = {agent: ExchangeState(role=place) for agent, place in self._places.items()}
        """What each agent said last; that it has its own role, where nothing that makes sense was
        heard."""
        self._due_s = 0.0
        self.exchange = ExchangeState(role=self._place)
        """What the own agent tells in its state."""
        self.roles: Mapping[int, int] = dict(self._places)
        """By agent, as heard; a new object whenever a role changes."""
        self.departed: Container[int] = ()
        """The agents that have left the formation (`Group.departed`)."""
        self.taken: list[tuple[float, int]] = []
        """(since [s], role), for every role but the first."""

    def hear(self) -> None:
        """Take in what is told now."""
        known, roles = self._heard_of, {self._own: self.exchange.role}
        for peer in self._peers:
            state, before = peer.state, known.get(peer.id)
            if state is None or state is before or peer.id not in self._places:
                continue
            known[peer.id] = state
            if before is None or state.exchange is not before.exchange:
                said = self._said[peer.id] = self._sense(peer.id, state.exchange)
                roles[peer.id] = said.role
        if any(self.roles[agent] != role for agent, role in roles.items()):
            self.roles = {**self.roles, **roles}

    def in_roles(self, neighbours: Sequence[tuple[int, ...]]) -> tuple[tuple[int, ...], ...]:
        """A step's graph by role as a graph by agent; both by id, in the plan's order."""
        holders = self._holders()
        found: list[tuple[int, ...]] = [()] * len(self._ids)
        for role, near in enumerate(neighbours):
            found[self._places[holders[role]]] = tuple(
                sorted(holders[self._places[i]] for i in near)
            )
        return tuple(found)

    def begin(self, slots: Sequence[Point]) -> None:
        """A form step begins: its slots by role [units]. An exchange under way goes on."""
        z = np.array(slots, dtype=np.float64).T[:, :, None]
        unlinked = np.zeros((len(self._ids), len(self._ids), 1), dtype=np.bool_)
        self._protocol = ExchangeProtocol(np.array([self._place]), z, unlinked, self._r)
        self._protocol.states = ExchangeStates(
            *(np.array([[getattr(self.exchange, name)]]) for name in _FIELDS)
        )
        self._links = {}
        self._slots = [complex(*slot) for slot in slots]

    def rejoin(self, now: float) -> None:
        """After a restart in flight: the role that none of the others has, and a version that was
        never told."""
        self.hear()
        held = {self._said[agent].role for agent in self._heard_of}
        free = [role for role in range(len(self._ids)) if role not in held]
        role = self.exchange.role if self.exchange.role in free or not free else free[0]
        self.exchange = ExchangeState(role=role, version=1 + int(now) % 0x4000)
        if role != self._place:
            self.taken.append((now, role))
        self.hear()

    @property
    def partners(self) -> frozenset[int]:
        """The agents that the own offer, answer or lock is about."""
        own = self.exchange
        return frozenset(self._ids[k] for k in (own.offer_to, own.answer_to, own.lock) if k >= 0)

    def settled(self, now: float) -> bool:
        """No agent that is heard waits for an answer of ours, nor we for one of theirs."""
        own = self.exchange
        if own.offer_to >= 0 or own.lock >= 0:
            return False
        if own.answer_to < 0:
            return True
        to = self._ids[own.answer_to]
        return self._said[to].version != own.answer_version or self._age(to, now) > GONE_S

    def look(
        self, now: float, own_m: Point, flying: FormationKey, links: Links, *, new: bool
    ) -> int | None:
        """Take part, if it is time. The agent whose slot becomes ours; None where ours stays.

        Args:
            now: mission time [s].
            own_m: own stop point.
            flying: what this agent flies; those that fly something else take no part.
            links: N_i of every agent by id.
            new: offers may be made and taken.
        """
        protocol = self._protocol
        if protocol is None or now < self._due_s:
            return None
        self._due_s = now + EVERY_S
        if self._at_rest(protocol) and not (new and self._may_exchange(now, own_m)):
            return None
        if links is not self._links:
            self._links = links
            protocol.links = np.array(
                [[j in links.get(i, ()) for j in self._ids] for i in self._ids]
            )[..., None]
        before = self.exchange.role
        points, told, age_s, fresh = self._heard(now, flying)
        own = np.array(own_m)[:, None, None] / self._unit_m
        changed = protocol.step(now, own, points, told, age_s, fresh, np.array([[new]]))
        self.exchange = ExchangeState(
            *(int(getattr(protocol.states, name)[0, 0]) for name in _FIELDS)
        )
        if not changed.any():
            return None
        # An agent that takes an offer takes a role that its partner still has; an agent that is
        # answered takes the role of a partner that already has ours.
        of = (
            i
            for role in (self.exchange.role, before)
            for i, told in self.roles.items()
            if told == role and i != self._own
        )
        partner = next(of, self._own)
        self.taken.append((now, self.exchange.role))
        self.hear()
        return partner

    def _at_rest(self, protocol: ExchangeProtocol) -> bool:
        """There is no exchange to bring to its end, and no other agent has the own role: a round
        without offers changes nothing."""
        own, role, version = self.exchange, self.exchange.role, self.exchange.version
        if own.offer_to >= 0 or own.lock >= 0 or not protocol.at_rest:
            return False
        return not any(
            said.role == role or (said.answer_to == self._place and said.answer_version == version)
            for agent, said in self._said.items()
            if agent != self._own
        )

    def _may_exchange(self, now: float, own_m: Point) -> bool:
        """An agent offers to this one, or this one may offer to another: nearly always neither, and
        the round, which costs as much as the law, is left out."""
        own, slot = complex(*own_m), self._slots[self.exchange.role]
        for agent, state in self._heard_of.items():
            said = self._said[agent]
            if said.offer_to == self._place:
                return True
            if self._places[agent] > self._place:  # offers go to higher ids
                ahead_s = min(self._age(agent, now), PREDICT_S)
                ahead = complex(*state.stop_point_m) + complex(*state.setpoint_mps) * ahead_s
                apart = (own - ahead) / self._unit_m
                gain = (apart.conjugate() * (slot - self._slots[said.role])).real
                if gain < WORTH + _ROUNDING and abs(apart) < self._r + _ROUNDING:
                    return True
        return False

    def _heard(
        self, now: float, flying: FormationKey
    ) -> tuple[np.ndarray, ExchangeStates, np.ndarray, np.ndarray]:
        """Points (2, 1, n, 1) [units], what was said, its age and whether it counts (1, n, 1), in
        the plan's order."""
        n = len(self._ids)
        points, age_s = np.zeros((2, 1, n, 1)), np.full((1, n, 1), _UNHEARD_S)
        fresh = np.zeros((1, n, 1), dtype=np.bool_)
        self._said[self._own] = self.exchange
        told = ExchangeStates(
            *np.array([_ROW(self._said[i]) for i in self._ids]).T[:, None, :, None]
        )
        if not self._heard_of:
            return points, told, age_s, fresh
        states = self._heard_of.values()
        places = [self._places[agent] for agent in self._heard_of]
        age = np.array([self._age(agent, now) for agent in self._heard_of])
        track = np.array([state.stop_point_m + state.setpoint_mps for state in states]).T
        ahead = track[:2] + track[2:] * np.minimum(age, PREDICT_S)
        points[:, 0, places, 0] = ahead / self._unit_m
        age_s[0, places, 0] = age
        same = [(s.step, s.override) == flying[1:] and s.phase is Phase.FLY for s in states]
        late = [self._peers.late_s(agent, now) for agent in self._heard_of]
        fresh[0, places, 0] = np.array(same) & (age <= FRESH_S + np.array(late))
        return points, told, age_s, fresh

    def _age(self, agent: int, now: float) -> float:
        """Age of the newest state [s]; of an agent that has left: as if it was never heard."""
        return _UNHEARD_S if agent in self.departed else self._peers.age(agent, now)

    def _sense(self, agent: int, said: ExchangeState) -> ExchangeState:
        """What an agent says; that it has its own role, where that makes no sense."""
        if said.role < 0 or said.beyond(len(self._ids)) is not None:
            return ExchangeState(role=self._places[agent])
        return said

    def _holders(self) -> list[int]:
        """The agent with each role. Where two have one for a moment it is the lower id's, if that
        one has not left the formation, and the others fill what is left."""
        holders: list[int | None] = [None] * len(self._ids)
        spare = []
        for i in sorted(self._ids, key=lambda agent: agent in self.departed):
            role = self.roles[i]
            if holders[role] is None:
                holders[role] = i
            else:
                spare.append(i)
        rest = iter(spare)
        return [holder if holder is not None else next(rest) for holder in holders]
