"""Which peers an agent has to hear at every tick, and which now and then.

In a swarm of at most `SMALL_SWARM` agents every agent hears every state of all others. In a larger
one an agent hears the states of its *near* peers, and of all others a *far word* each
`FAR_EVERY_S`: the same payload on a channel of its own.
"""

from __future__ import annotations

from typing import Final

from swarm_ctl.core.model.plan import Plan

SMALL_SWARM: Final = 16
"""Up to so many agents are a mesh of peers, and all are near. Links and messages of a mesh grow
with the square of the agents: 32 of them fill two cores."""

FOLLOW_TICKS: Final = 5
"""From the decision to follow a peer to the first tick whose state of that peer is heard. In
lockstep always; in real time the mesh's word arrives within, even on a busy machine."""


def hears_all(plan: Plan) -> bool:
    """All agents of this plan hear all states of each other."""
    return len(plan.agents) <= SMALL_SWARM
