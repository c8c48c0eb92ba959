"""What an agent has heard of its peers, and the snapshot of it that each tick works with."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Sequence
from typing import Final

from swarm_ctl.core.model.messages import (
    AgentState,
    ClockNews,
    Glimpse,
    LinkReport,
    Phase,
    Severity,
)
from swarm_ctl.core.model.plan import Plan, Point
from swarm_ctl.core.model.route import Routes
from swarm_ctl.core.model.vehicle import Contact
from swarm_ctl.core.swarm.clocks import Clocks
from swarm_ctl.core.swarm.hearing import hears_all
from swarm_ctl.core.swarm.peer import Peer
from swarm_ctl.core.swarm.plausibility import CLOCK_S, LASTS_S, BeliefLimits, Doubt, Suspicion
from swarm_ctl.core.swarm.snapshot import PeerSnapshot
from swarm_ctl.core.swarm.traffic import Traffic, Vacated

_CLEAR: Final = "both places where it may be are kept clear"
_EXPEL: Final = "others make all the way for it; `expel` ends that they follow it"


class Peers:
    """All other agents of the plan, in the plan's order. `same_clock`: those on the own clock."""

    def __init__(self, plan: Plan, own_id: int, same_clock: Container[int] = ()) -> None:
        others = (agent.id for agent in plan.agents if agent.id != own_id)
        self.clocks = Clocks(own_id, others, same_clock)
        limits = BeliefLimits.of(plan)
        near_s, routes = -math.inf if hears_all(plan) else math.inf, Routes(plan)
        self._by_id = {
            agent: Peer(agent, clock, limits, routes.of[agent].names, near_s=near_s)
            for agent, clock in self.clocks.of.items()
        }
        self._near = list(self) if hears_all(plan) else []
        self._traffic, self._vacated = Traffic(plan), Vacated(plan)
        self._suspects: dict[int, Doubt] = {}
        self._off_since: dict[int, float] = {}

    def __iter__(self) -> Iterator[Peer]:
        return iter(self._by_id.values())

    def hear(self, state: AgentState, received_s: float, *, far: bool = False) -> bool:
        """Take a state (`far`: a far word) in, if it is believed; one of an agent that the plan
        does not have is not."""
        peer = self._by_id.get(state.agent)
        if peer is None:
            return False
        return peer.hear(peer.limits.in_plan.own_mission(state), received_s, far=far)

    def likely(self, word: Glimpse, received_s: float) -> bool:
        """Whether this word of a peer may follow what was believed of it."""
        peer = self._by_id.get(word.agent)
        return peer is not None and peer.likely(word, received_s)

    def follow(self, near: Container[int], now: float) -> None:
        """These peers are near, and all others far."""
        for peer in self:
            peer.approach(now, near=peer.id in near)
        self._near = [peer for peer in self if peer.id in near]

    def links(self, now: float) -> dict[int, LinkReport]:
        """The mesh links from the near peers."""
        return {peer.id: peer.report(now) for peer in self._near}

    def hear_clock(self, news: ClockNews, received_s: float) -> None:
        """Take in what a peer says of its clock."""
        peer = self._by_id.get(news.agent)
        if peer is not None and not peer.expelled:
            peer.clock.stepped_s = 0.0
            self.clocks.hear(news, received_s)
            if peer.clock.stepped_s > CLOCK_S:
                peer.doubt(
                    Suspicion(Doubt.CLOCK, f"its clock word steps by {peer.clock.stepped_s:.3g} s"),
                    received_s,
                )

    def doubt(self, agent: int, finding: Suspicion, now: float) -> None:
        """A word of this peer is not believed, as another part of the agent found."""
        self._by_id[agent].doubt(finding, now)

    def expel(self, agents: Container[int]) -> None:
        """Listen to these peers no more, and to all others."""
        for peer in self:
            peer.expel(out=peer.id in agents)

    def suspects(self, now: float) -> dict[int, str]:
        """The peers of which a word was not believed of late, and why."""
        return {p.id: p.found.words for p in self if p.found is not None and p.suspect(now)}

    def watch(self, now: float) -> list[tuple[Severity, str]]:
        """Peers that are no longer believed, or again: said once each."""
        said = []
        for peer in self:
            if peer.found is None:
                continue  # it was always believed
            before = self._suspects.get(peer.id)
            if peer.suspect(now):
                if peer.found.doubt is not before:
                    self._suspects[peer.id] = peer.found.doubt
                    then = _EXPEL if peer.found.doubt is Doubt.CREEP else _CLEAR
                    words = f"agent {peer.id} is not believed: {peer.found.words}; {then}"
                    said.append((Severity.WARNING, words))
            elif before is not None:
                del self._suspects[peer.id]
                said.append((Severity.INFO, f"agent {peer.id} is believed again"))
        return said

    def age(self, agent: int, now: float) -> float:
        """Age of the newest state of `agent` [s]."""
        return self._by_id[agent].age(now)

    def late_s(self, agent: int, now: float) -> float:
        """By how much [s] the words of `agent` may be older than states are."""
        return self._by_id[agent].late_s(now)

    def state(self, agent: int) -> AgentState | None:
        """The newest state of `agent`."""
        return self._by_id[agent].state

    def count_ages(self, now: float) -> None:
        """Sample the age of every near peer that has not ended; call it once a tick."""
        for peer in self._near:
            state = peer.state
            if state is not None and state.phase is not Phase.ENDED and peer.clock.known:
                peer.ages.add(now - peer.true_s)

    def snapshot(
        self, now: float, contacts: Sequence[Contact] = (), own_m: Point = (0.0, 0.0)
    ) -> PeerSnapshot:
        """The other aircraft now; `own_m` decides which contacts are the nearest ones."""
        peers = self._vacated.at_rest(tuple([peer.view(now) for peer in self]))
        traffic = self._traffic.unexplained(now, contacts, peers, own_m)
        self._vacated.look(now, contacts, peers, sees=bool(self._traffic.seen))
        self._compare(now)
        # one that the sensor sees where it was believed to be is not elsewhere
        seen = self._traffic.seen
        elsewhere = [at for p in self if p.id not in seen and (at := p.elsewhere(now)) is not None]
        return PeerSnapshot(now, peers, (*traffic, *elsewhere))

    def _compare(self, now: float) -> None:
        """Doubt the peers that the traffic sensor has seen stop elsewhere for a while."""
        off_m = self._traffic.off
        if not off_m and not self._off_since:
            return
        self._off_since = {i: self._off_since.get(i, now) for i in off_m}
        for i, since_s in self._off_since.items():
            if now - since_s >= LASTS_S:
                words = f"the traffic sensor sees it stop {off_m[i]:.1f} m from where it says"
                self._by_id[i].doubt(Suspicion(Doubt.SENSOR, words), now)
