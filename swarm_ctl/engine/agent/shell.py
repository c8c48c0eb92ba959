"""What stands around an agent in its process, on the virtual clock and in tests: each tick it reads
vehicle and mesh, lets the agent decide, sends the vehicle's goal first, then the rest.

It decides nothing. If it stalls, nothing is sent: the vehicle's own failsafe stops it (deadman).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable
from typing import Any, Final, TypeVar

from swarm_ctl.core.agent.agent import Actions, Agent, Ended, Inbox
from swarm_ctl.core.model.fleet import FleetAgent
from swarm_ctl.core.model.messages import (
    AgentState,
    AgentStatus,
    Glimpse,
    Payload,
    Refusal,
    TickReport,
)
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.swarm.hearing import hears_all
from swarm_ctl.engine.vehicle_memory import Remembering
from swarm_ctl.mavlink.autopilots.timing import streams_hz
from swarm_ctl.mavlink.link import VehicleLink
from swarm_ctl.mavlink.mirror import Mirror
from swarm_ctl.mavlink.signing import LinkSigning
from swarm_ctl.mavlink.wires import Wire
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node
from swarm_ctl.rim import Rim

P = TypeVar("P")
_SHOWN: Final = frozenset({keys.EVENT.name, keys.SIGMA.name, keys.STATUS.name})


class OwnTime:
    """An agent's clock, from the swarm's time to its own [s]. One that is set back goes on from
    where it was: else each wait would last, and each silence count for nothing, until the clock is
    there again."""

    def __init__(self, clock: Callable[[float], float]) -> None:
        self._clock = clock
        self._back_s = 0.0
        self._swarm_s = self._last_s = -math.inf

    def __call__(self, swarm_s: float) -> float:
        return self._clock(swarm_s) + self._back_s

    def tick(self, swarm_s: float) -> float:
        """The time of a tick, later than that of the one before."""
        now = self(swarm_s)
        if now <= self._last_s:
            goes_on_s = self._last_s + swarm_s - self._swarm_s
            self._back_s += goes_on_s - now
            now = goes_on_s
        self._swarm_s, self._last_s = swarm_s, now
        return now


class AgentShell:
    """One agent with its links."""

    tampered: Callable[[AgentState], AgentState] | None = None
    """Changes the states that it sends."""
    shown: Rim | None = None
    """What an error goes through of what only shows; None: it is raised."""
    remembers: Rim | None = None
    """The same of the vehicle's memory."""

    def __init__(
        self,
        agent: Agent,
        link: VehicleLink,
        node: Node,
        remembering: Remembering,
        clock: Callable[[float], float] = float,
    ) -> None:
        self.agent, self.link, self.node = agent, link, node
        self._remembering = remembering
        self.clock = OwnTime(clock)
        self.status: AgentStatus | None = None
        self.ended: Ended | None = None

    def turn(
        self,
        swarm_s: float,
        told_to_end: str = "",
        tick: Callable[[], TickReport] = TickReport,
        refused: Callable[[float], tuple[Refusal, ...]] | None = None,
    ) -> Generator[None, None, Actions]:
        """The tick at this mission time [s], with a halt after each part (`Agent.stages`)."""
        now, node = self.clock.tick(swarm_s), self.node
        self.link.receive(now)
        yield
        view = self.link.view()
        yield
        inbox = Inbox(
            view=view,
            states=self._timed(keys.STATE, self._likely),
            far=self._timed(keys.FAR, self._likely),
            clocks=self._timed(keys.CLOCK, self._likely),
            laws=[news for news, _ in node.take(keys.LAW)],
            targets=[*self._timed(keys.TARGET), *self._timed(keys.SIGHTING)],
            beacons=self._timed(keys.BEACON),
            commands=[command for command, _ in node.take(keys.COMMAND)],
            told_to_end=told_to_end,
            tick=tick,
            bad_payloads=node.bad_payloads,
            refused=refused or node.refused,
        )
        yield
        actions = yield from self.agent.stages(now, inbox)
        yield
        self.link.pursue(actions.goal, now)
        yield
        if self.tampered is not None and actions.state is not None:
            actions.state = self.tampered(actions.state)
        publish(node, actions, self.shown)
        self.follow(actions.follow)
        if actions.status is not None:
            self.status = actions.status
            _run(self.remembers, self._remembering.serve, self.link, actions.status.own)
        self.ended = actions.ended
        return actions

    def _timed(
        self, channel: keys.Channel[P], likely: Callable[[Glimpse, float], bool] | None = None
    ) -> list[tuple[P, float]]:
        """What came on a channel, each with when it came on the agent's clock."""
        return [(word, self.clock(at)) for word, at in self.node.take(channel, likely)]

    def _likely(self, word: Glimpse, at: float) -> bool:
        return self.agent.likely(word, self.clock(at))

    def follow(self, near: frozenset[int] | None) -> None:
        """Hear the states of these from now on; None: as before."""
        if near is not None:
            self.node.follow(keys.STATE, near)


def vehicle_link(
    vehicle: FleetAgent,
    wire: Wire | str,
    signing: LinkSigning | None,
    tap: Callable[[bytes, float], None] | None = None,
    *,
    remembers: bool,
    mirror: Mirror | None = None,
) -> VehicleLink:
    """The link to the vehicle of an entry in the fleet, at this wire or endpoint."""
    return VehicleLink(
        wire,
        vehicle.autopilot,
        vehicle.sysid,
        tap,
        remembers=remembers,
        agent_sysid=vehicle.agent_sysid,
        mirror=mirror,
        signing=signing,
        streams_hz=streams_hz(vehicle.radio, vehicle.autopilot, signed=signing is not None),
    )


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
        rim = shown if channel.name in _SHOWN else None
        for payload in payloads:
            if payload is not None:
                _run(rim, node.send, channel, payload)


def _run(rim: Rim | None, call: Callable[..., object], *args: object) -> None:
    if rim is None:
        call(*args)
    else:
        rim.run(call, *args)
