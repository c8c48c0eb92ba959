"""What an agent's tick sends to the mesh."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from swarm_ctl.core.agent.agent import Actions
from swarm_ctl.core.model.messages import Payload
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node


def publish(node: Node, actions: Actions) -> None:
    """Send each message of the tick on its channel."""
    messages: tuple[tuple[keys.Channel[Any], Iterable[Payload | None]], ...] = (
        (keys.STATE, (actions.state,)),
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
