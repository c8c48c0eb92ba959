"""N_i as the mission goes on: chosen by steps, bridged where an agent is lost, reported when a
neighbour is not heard."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from swarm_ctl.core.law import graph
from swarm_ctl.core.model.messages import Severity
from swarm_ctl.core.model.plan import GroupPlan
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.timeouts import NEIGHBOUR_S
from swarm_ctl.core.swarm.snapshot import PeerSnapshot


class Neighbourhood:
    """One agent's knowledge of the graph. What it has to say comes out as (severity, text)."""

    def __init__(self, group: GroupPlan, own_id: int) -> None:
        self._own_id = own_id
        self._ids = group.ids
        self._planned: Mapping[int, tuple[int, ...]] = {
            agent.id: tuple(j for j in agent.neighbours if j in group.ids) for agent in group.agents
        }
        self._lost: frozenset[int] = frozenset()
        self._heard: tuple[int, ...] = self._planned[own_id]
        self._new_until_s: float | None = None
        """A neighbour that was far is heard at every tick only from then on; None: from the next
        tick on so long."""
        self.links = self._planned
        """N_i of every agent, by id; a new object whenever one of them changes. Lost agents are
        not in it."""
        self.own = frozenset(self._planned[own_id])
        """N_i of this agent, heard or not."""

    def heard(self, peers: PeerSnapshot) -> tuple[int, ...]:
        """N_i now: the neighbours that are heard, in the group's order."""
        own = self.own
        return tuple([peer.id for peer in peers.peers if peer.followed and peer.id in own])

    def choose(self, neighbours: Iterable[tuple[int, ...]]) -> None:
        """A step brings a graph of its own, in the order of the group's agents."""
        self._planned = dict(zip(self._ids, neighbours, strict=True))
        self._apply()
        self._heard, self._new_until_s = tuple(sorted(self.own)), None

    def lose(self, lost: Iterable[int]) -> list[tuple[Severity, str]]:
        """The mission goes on without these agents: their neighbours become neighbours of each
        other."""
        lost = frozenset(lost)
        if lost == self._lost:
            return []
        before = self.own
        self._lost = lost
        self._apply()
        new = sorted(self.own - before)
        if not new:
            return []
        self._heard = tuple(sorted({*self._heard, *new}))
        text = f"now a neighbour of {agents_named(new)}, so that the graph stays connected"
        return [(Severity.INFO, text)]

    def watch(self, peers: PeerSnapshot) -> list[tuple[Severity, str]]:
        """Neighbours that are no longer heard, or again, and what that does to the graph."""
        heard, before = self.heard(peers), self._heard
        if self._new_until_s is None:
            self._new_until_s = peers.now_s + NEIGHBOUR_S
        if peers.now_s < self._new_until_s:
            heard = tuple(sorted({*heard, *before}))
        if heard == before:
            return []
        self._heard = heard
        gone = sorted(set(before) - set(heard) - self._lost)
        back = sorted(set(heard) - set(before))
        said = [(Severity.INFO, f"neighbour {agent} is heard again") for agent in back]
        if gone:
            parts = graph.components(graph.without(self.links, self.own - set(heard)))
            what = "stays connected"
            if len(parts) > 1:
                what = f"falls apart: {' | '.join(map(str, parts))}"
            are = f"{'neighbours' if len(gone) > 1 else 'neighbour'} {', '.join(map(str, gone))}"
            are += " are" if len(gone) > 1 else " is"
            said.append((Severity.WARNING, f"{are} not heard; the graph {what}"))
        return said

    def _apply(self) -> None:
        self.links = graph.bridged(self._planned, self._lost)
        self.own = frozenset(self.links[self._own_id])
