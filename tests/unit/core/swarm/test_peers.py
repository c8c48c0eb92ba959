"""What one agent counts of its peers."""

from __future__ import annotations

from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.swarm.peers import Peers
from tests.unit.station.swarm import hexagon_plan, state_of


def test_the_age_of_a_state_is_not_counted_once_its_agent_has_ended() -> None:
    """Agent 2 ends at 5 s and says no more; agent 3 goes on."""
    plan = hexagon_plan()
    peers, links = Peers(plan, 1), {}
    for k in range(200):
        now = 0.05 * (k + 1)
        for agent in (2, 3):
            phase = Phase.ENDED if agent == 2 and now > 5.0 else Phase.FLY
            if agent == 3 or now <= 5.1:
                peers.hear(state_of(plan, agent, now, seq=k, phase=phase), now)
                peers.clocks.of[agent].answered(now - 0.01, now - 0.005, now - 0.005, now)
        peers.count_ages(now)
        links = {peer.id: peer.report(now) for peer in peers}
    assert [links[i].age_p99_s for i in (2, 3)] == [0.01, 0.01]
