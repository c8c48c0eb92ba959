"""One agent's part in slot exchange (`core/kernel/exchange.py`): which agent flies to which
slot, and the own offers and answers.

A *role* is a place in the group's list of agents: role k flies to the k-th slot of each mission
step. Each agent begins with its own; an exchange swaps two, for this step and all that follow. New
exchanges begin only in form steps that allow them, and only between agents that are not done; an
exchange that has begun is brought to its end in any step that flies a formation. An operator's
shape gives each agent its own slot of it and knows no roles.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from operator import attrgetter
from typing import Final, TypeAlias

from swarm_ctl.core.kernel.exchange import (
    EVERY_S,
    GONE_S,
    NO_PART,
    WORTH,
    Said,
    Shape,
    ranks,
    took_part,
)
from swarm_ctl.core.model.messages import AgentState, ExchangeState, Phase
from swarm_ctl.core.model.plan import GroupPlan, Plan, Point
from swarm_ctl.core.model.timeouts import FRESH_S, PREDICT_S
from swarm_ctl.core.swarm.peers import Peers
from swarm_ctl.core.swarm.snapshot import FormationKey

_ROW: Final = attrgetter(*Said._fields)
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
        self._ids, self._steps = group.ids, group.told_steps
        self._places = {agent: place for place, agent in enumerate(self._ids)}
        self._own, self._place = own_id, self._places[own_id]
        self._peers = peers
        self._shape: Shape | None = None
        """None: before the first form step."""
        self._part = NO_PART
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
            if state.step not in self._steps:  # it flies in another group, with other roles
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
        n = len(self._ids)
        unlinked = [[False] * n for _ in range(n)]
        self._shape = Shape([complex(*slot) for slot in slots], unlinked, ranks(n), self._r)
        self._part, self._links = NO_PART, {}

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
        shape = self._shape
        if shape is None or now < self._due_s:
            return None
        self._due_s = now + EVERY_S
        if self._at_rest() and not (new and self._may_exchange(now, own_m, shape)):
            return None
        if links is not self._links:
            self._links = links
            linked = [[j in links.get(i, ()) for j in self._ids] for i in self._ids]
            self._shape = shape = shape._replace(links=linked)
        before = self.exchange.role
        heard = self._heard(now, own_m, flying)
        said, self._part = took_part(
            now, self._place, Said(*_ROW(self.exchange)), self._part, shape, *heard, new
        )
        self.exchange = ExchangeState(**said._asdict())
        if said.role == before:
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

    def _at_rest(self) -> bool:
        """There is no exchange to bring to its end, and no other agent has the own role: a round
        without offers changes nothing."""
        own, role, version = self.exchange, self.exchange.role, self.exchange.version
        part = self._part
        if own.offer_to >= 0 or own.lock >= 0 or part.partner >= 0 or part.twins_s < math.inf:
            return False
        return not any(
            said.role == role or (said.answer_to == self._place and said.answer_version == version)
            for agent, said in self._said.items()
            if agent != self._own
        )

    def _may_exchange(self, now: float, own_m: Point, shape: Shape) -> bool:
        """An agent offers to this one, or this one may offer to another: nearly always neither, and
        the round, which costs as much as the law, is left out."""
        own, slot = complex(*own_m), shape.slots[self.exchange.role]
        for agent, state in self._heard_of.items():
            said = self._said[agent]
            if said.offer_to == self._place:
                return True
            if self._places[agent] > self._place:  # offers go to higher ids
                ahead_s = min(self._age(agent, now), PREDICT_S)
                ahead = complex(*state.stop_point_m) + complex(*state.setpoint_mps) * ahead_s
                apart = (own - ahead) / self._unit_m
                gain = (apart.conjugate() * (slot - shape.slots[said.role])).real
                if gain < WORTH + _ROUNDING and abs(apart) < self._r + _ROUNDING:
                    return True
        return False

    def _heard(
        self, now: float, own_m: Point, flying: FormationKey
    ) -> tuple[list[complex], list[Said], list[float], list[bool]]:
        """Of all agents in the plan's order: the own stop point minus theirs [units], what they
        said, its age and whether it counts."""
        own, n = complex(*own_m), len(self._ids)
        apart, age_s, fresh = [0j] * n, [_UNHEARD_S] * n, [False] * n
        self._said[self._own] = self.exchange
        told = [Said(*_ROW(self._said[i])) for i in self._ids]
        for agent, state in self._heard_of.items():
            place, age = self._places[agent], self._age(agent, now)
            ahead_s = min(age, PREDICT_S)
            ahead = complex(*state.stop_point_m) + complex(*state.setpoint_mps) * ahead_s
            apart[place], age_s[place] = (own - ahead) / self._unit_m, age
            if (state.step, state.override) == flying[1:] and state.phase is Phase.FLY:
                fresh[place] = age <= FRESH_S + self._peers.late_s(agent, now)
        return apart, told, age_s, fresh

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
