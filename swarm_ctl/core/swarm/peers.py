"""What an agent has heard of its peers, and the snapshot of it that each tick works with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from swarm_ctl.core.model.messages import AgentState, Phase
from swarm_ctl.core.model.plan import Plan, Point
from swarm_ctl.core.model.vehicle import Contact
from swarm_ctl.core.swarm.clocks import Clocks
from swarm_ctl.core.swarm.peer import Peer
from swarm_ctl.core.swarm.snapshot import PeerSnapshot
from swarm_ctl.core.swarm.traffic import Traffic


class Peers:
    """All other agents of the plan, in the plan's order."""

    def __init__(self, plan: Plan, own_id: int) -> None:
        self.clocks = Clocks(own_id, (agent.id for agent in plan.agents if agent.id != own_id))
        self._by_id = {agent: Peer(agent, clock) for agent, clock in self.clocks.of.items()}
        self._traffic = Traffic(plan)

    def __iter__(self) -> Iterator[Peer]:
        return iter(self._by_id.values())

    def hear(self, state: AgentState, received_s: float) -> None:
        """Take a state in; a state of an agent that the plan does not have is ignored."""
        peer = self._by_id.get(state.agent)
        if peer is not None:
            peer.hear(state, received_s)

    def age(self, agent: int, now: float) -> float:
        """Age of the newest state of `agent` [s]."""
        return self._by_id[agent].age(now)

    def state(self, agent: int) -> AgentState | None:
        """The newest state of `agent`."""
        return self._by_id[agent].state

    def count_ages(self, now: float) -> None:
        """Sample the age of every heard peer that has not ended; call it once a tick."""
        for peer in self:
            ended = peer.state is None or peer.state.phase is Phase.ENDED
            if not ended and peer.clock.known:
                peer.ages.add(peer.age(now))

    def snapshot(
        self, now: float, contacts: Sequence[Contact] = (), own_m: Point = (0.0, 0.0)
    ) -> PeerSnapshot:
        """The other aircraft now; `own_m` decides which contacts are the nearest ones."""
        peers = tuple(peer.view(now) for peer in self)
        return PeerSnapshot(now, peers, self._traffic.unexplained(now, contacts, peers, own_m))
