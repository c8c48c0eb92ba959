"""Which peers an agent has to hear at every tick, and which now and then.

In a swarm of at most `SMALL_SWARM` agents every agent hears every state of all others. In a larger
one an agent hears the states of its *near* peers, and of all others a *far word* each
`FAR_EVERY_S`: the same payload on a channel of its own.

An aircraft constrains nothing while its stop point is farther away than the safety filter reaches.
So a peer is near when its stop point may come within that reach before its states would be heard:
it has flown at top speed since its newest word was true, however many words were lost since, and
both fly at top speed until the next look and until a subscription works.
docs/understand/safety-evidence.md has the figures.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from collections.abc import Set as AbstractSet
from typing import Final, Protocol

from swarm_ctl.core.kernel.boundary import KEPT_S, LOOK_S, boundary_of, near_m
from swarm_ctl.core.model.messages import AgentState
from swarm_ctl.core.model.plan import Plan, Point
from swarm_ctl.core.model.timeouts import FAR_EVERY_S
from swarm_ctl.core.swarm.plausibility import JUMP_M

SMALL_SWARM: Final = 16
"""Up to so many agents are a mesh of peers, and all are near. Links and messages of a mesh grow
with the square of the agents: 32 of them fill two cores."""


def hears_all(plan: Plan) -> bool:
    """All agents of this plan hear all states of each other."""
    return len(plan.agents) <= SMALL_SWARM


def mesh_words(agents: int, *, routed: bool) -> str:
    """How a swarm of so many agents is linked; `routed`: its fleet names routers."""
    if agents > SMALL_SWARM:
        rare = f"far words at {1 / FAR_EVERY_S:g} Hz"
        return f"one router a host, {agents} agents: near peers every tick, {rare}"
    if routed:
        return f"one router a host, {agents} agents: all peers every tick"
    return f"of peers, {agents} agents, {agents * (agents - 1) // 2} links"


class Heard(Protocol):
    """A peer as it was heard last."""

    @property
    def id(self) -> int:
        """Its agent id."""

    @property
    def state(self) -> AgentState | None:
        """Its newest state; None: it was never heard."""

    @property
    def earliest_s(self) -> float:
        """When that was true, on the own clock, at the earliest."""


class Hearing:
    """Chooses the near peers of one agent of a large swarm.

    `reach_m`: an aircraft whose stop point is farther away constrains nothing.
    """

    def __init__(self, plan: Plan, own_id: int, reach_m: float) -> None:
        silent_s = plan.policies.agent_lost_after_s
        speed_mps = plan.limits.speed_mps
        self.boundary = boundary_of(reach_m, JUMP_M, speed_mps, plan.tick_s, silent_s)
        index = [agent.id for agent in plan.agents].index(own_id)
        self._phase_s, self._half_s = index * plan.tick_s, 0.5 * plan.tick_s
        self._due_s = self._word_s = -math.inf
        self._always: AbstractSet[int] = frozenset()
        self._near_s: dict[int, float] = {}
        """When each was near last."""

    def look(
        self, now: float, own_m: Point | None, peers: Iterable[Heard], always: AbstractSet[int]
    ) -> frozenset[int] | None:
        """The near peers; None where it is not time to look.

        Args:
            now: [s].
            own_m: own stop point; None: not known yet.
            peers: all of them.
            always: the peers that are near wherever they are, N_i among them.
        """
        due = now + self._half_s >= self._due_s
        if due:
            self._due_s = self._next(self._due_s, now, LOOK_S)
        elif always == self._always:
            return None
        self._always = always
        self._near_s |= dict.fromkeys(always, now)
        if own_m is not None:
            north, east = own_m
            for peer in peers:
                if peer.state is not None:
                    at = peer.state.stop_point_m
                    within_m = near_m(now - peer.earliest_s, self.boundary)
                    if math.hypot(at[0] - north, at[1] - east) <= within_m:
                        self._near_s[peer.id] = now
        self._near_s = {
            i: at_s for i, at_s in self._near_s.items() if now - at_s <= KEPT_S + self._half_s
        }
        return frozenset(self._near_s)

    def says(self, now: float) -> bool:
        """It is time for the own far word."""
        if now + self._half_s < self._word_s:
            return False
        self._word_s = self._next(self._word_s, now, FAR_EVERY_S)
        return True

    def _next(self, due_s: float, now: float, every_s: float) -> float:
        """When it is time again. Agents that start together are spread over the ticks."""
        if now - due_s > every_s:
            return now + every_s - self._phase_s % every_s
        return due_s + every_s
