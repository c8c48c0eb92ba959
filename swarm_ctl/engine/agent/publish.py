"""What an agent hears of the mesh, and what its tick sends there."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

from swarm_ctl.core.agent.agent import Actions
from swarm_ctl.core.model.messages import Payload
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.swarm.hearing import hears_all
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node
from swarm_ctl.rim import Rim

_SHOWN: Final = frozenset({keys.EVENT.name, keys.SIGMA.name, keys.STATUS.name})


def listen(node: Node, plan: Plan) -> None:
    """Subscribe to what all agents of the plan hear."""
    states = keys.STATE if hears_all(plan) else keys.FAR
    agents = [agent.id for agent in plan.agents]
    node.listen(states, keys.CLOCK, keys.BEACON, keys.COMMAND, keys.LAW, agents=agents)
    if plan.targets:
        node.listen(keys.TARGET, keys.SIGHTING, agents=agents)


def publish(node: Node, actions: Actions, shown: Rim | None = None) -> None:
    """Send each message of the tick on its channel. What only shows goes through the rim `shown`:
    an error there keeps none of the others back; None: it is raised."""
    messages: tuple[tuple[keys.Channel[Any], Iterable[Payload | None]], ...] = (
        (keys.STATE, (actions.state,)),
        (keys.FAR, (actions.far,)),
        (keys.CLOCK, (actions.clock,)),
        (keys.LAW, (actions.law,)),
        (keys.TARGET, actions.targets),
        (keys.ACK, actions.acks),
        (keys.EVENT, actions.events),
        (keys.SIGMA, (actions.sigma,)),
        (keys.STATUS, (actions.status,)),
    )
    for channel, payloads in messages:
        for payload in payloads:
            if payload is None:
                continue
            if shown is not None and channel.name in _SHOWN:
                shown.run(node.send, channel, payload)
            else:
                node.send(channel, payload)
