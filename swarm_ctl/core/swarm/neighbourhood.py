"""N_i as the mission goes on: chosen by steps, bridged where an agent is lost, reported when
somebody is not heard."""

from __future__ import annotations

from collections.abc import Iterable

from swarm_ctl.core.law import graph
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.swarm.peers import Peers


class Neighbourhood:
    """One agent's knowledge of the graph. Sentences come out for the log: (level, text)."""

    def __init__(self, plan: Plan, own_id: int, peers: Peers) -> None:
        self._own = own_id
        self._peers = peers
        self._ids = tuple(agent.id for agent in plan.agents)
        self._planned: dict[int, tuple[int, ...]] = {
            agent.id: agent.neighbours for agent in plan.agents
        }
        self._lost: frozenset[int] = frozenset()
        self._heard: tuple[int, ...] = self._planned[own_id]
        self.links = self._planned
        """N_i of everybody, by id; a new object whenever somebody's changes. Who is lost is not in
        it."""

    def choose(self, neighbours: Iterable[tuple[int, ...]]) -> None:
        """A step brings a graph of its own, in the order of the plan's agents."""
        self._planned = dict(zip(self._ids, neighbours, strict=True))
        self._apply()
        self._heard = self._peers.chosen

    def lose(self, lost: Iterable[int]) -> list[tuple[str, str]]:
        """The mission goes on without these agents: their neighbours become neighbours of each
        other."""
        lost = frozenset(lost)
        if lost == self._lost:
            return []
        before = set(self._peers.chosen)
        self._lost = lost
        self._apply()
        new = sorted(set(self._peers.chosen) - before)
        return (
            [("info", f"now a neighbour of {agents_named(new)}, so that the graph stays connected")]
            if new
            else []
        )

    def watch(self, now: float) -> list[tuple[str, str]]:
        """Who leaves and rejoins N_i, and what that does to the graph (docs/pages/law.md#symbols)."""
        heard = self._peers.neighbours(now)
        if heard == self._heard:
            return []
        gone = sorted(set(self._heard) - set(heard) - self._lost)
        back = sorted(set(heard) - set(self._heard))
        known = set(self._heard)
        self._heard = heard
        said = [
            ("info", f"neighbour {agent} is heard again") for agent in back if agent not in known
        ]
        if gone:
            silent = set(self.links[self._own]) - set(heard)
            parts = graph.components(graph.without(self.links, silent))
            what = (
                "stays connected"
                if len(parts) == 1
                else f"falls apart: {' | '.join(map(str, parts))}"
            )
            said.append(
                ("warning", f"neighbour {', '.join(map(str, gone))} is not heard; the graph {what}")
            )
        return said

    def _apply(self) -> None:
        self.links = graph.bridged(self._planned, self._lost)
        self._peers.choose(self.links[self._own])
