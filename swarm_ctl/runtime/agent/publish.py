"""What an agent hears of the mesh, and what its tick sends there."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from swarm_ctl.core.agent.agent import Actions
from swarm_ctl.core.model.messages import Payload
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.swarm.hearing import hears_all
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node


def listen(node: Node, plan: Plan) -> None:
    """Subscribe to what all agents of the plan hear."""
    states = keys.STATE if hears_all(plan) else keys.FAR
    agents = [agent.id for agent in plan.agents]
    node.listen(states, keys.CLOCK, keys.BEACON, keys.COMMAND, agents=agents)


def publish(node: Node, actions: Actions) -> None:
    """Send each message of the tick on its channel."""
    messages: tuple[tuple[keys.Channel[Any], Iterable[Payload | None]], ...] = (
        (keys.STATE, (actions.state,)),
        (keys.FAR, (actions.far,)),
        (keys.CLOCK, (actions.clock,)),
        (keys.ACK, actions.acks),
        (keys.EVENT, actions.events),
        (keys.SIGMA, (actions.sigma,)),
        (keys.STATUS, (actions.status,)),
    )
    for channel, payloads in messages:
        for payload in payloads:
            if payload is not None:
                node.send(channel, payload)
