"""A flight on the virtual clock: all agents in this process, the same in every run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from swarm_ctl.api.flight import FlightError, FlightResult, SwarmFlight
from swarm_ctl.commands.build import AgentNow, SwarmNow, build
from swarm_ctl.commands.parse import Order
from swarm_ctl.commands.send import CommandSender, SentCommand
from swarm_ctl.core.model.messages import AgentStatus, CommandKind, Event
from swarm_ctl.core.model.plan import Point
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.station.picture.model import Model
from swarm_ctl.station.picture.view import SwarmView
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm

_WATCHED: Final[tuple[keys.Channel[Any], ...]] = (
    keys.STATE,
    keys.SIGMA,
    keys.STATUS,
    keys.EVENT,
    keys.COMMAND,
    keys.ACK,
)


class Watching:
    """A ground station that says nothing, on the virtual mesh."""

    def __init__(self, swarm: VirtualSwarm) -> None:
        self._node = Node(MemoryTransport(swarm.mesh), "test", "watching")
        self._node.listen(*_WATCHED, agents=[agent.id for agent in swarm.plan.agents])
        self._model = Model(swarm.plan, speedup=1.0, since_s=swarm.now, station="watching")

    def hear(self, now: float) -> None:
        """Take in what was said up to `now` [s]."""
        for channel in _WATCHED:
            for payload, _ in self._node.take(channel):
                self._model.fold(payload, now)

    def view(self, now: float) -> SwarmView:
        """The picture at `now`."""
        self.hear(now)
        return self._model.view(now)


class VirtualFlight(SwarmFlight):
    """Tests may read and change `swarm`."""

    def __init__(self, mission: LoadedMission, seed: int = 1) -> None:
        self.plan = mission.plan
        self.swarm = VirtualSwarm(mission, seed)
        self._mission, self._seed = mission, seed
        self._watching: Watching | None = None
        self._sender = CommandSender(self.swarm.send, [agent.id for agent in self.plan.agents])

    @property
    def now(self) -> float:
        return self.swarm.now

    @property
    def over(self) -> bool:
        return not any(member.alive for member in self.swarm.members.values())

    def turn(self) -> None:
        self.swarm.tick()
        if self._watching is not None:
            self._watching.hear(self.swarm.now)

    def wait_s(self, seconds: float) -> None:
        until = self.now + seconds
        while self.now < until:  # vehicles fly on without their agents
            self.turn()

    def reached(self, step: int) -> bool:
        live = [m for m in self.swarm.members.values() if m.alive and not m.frozen]
        return bool(live) and all(m.status is not None and m.status.step >= step for m in live)

    def view(self) -> SwarmView:
        if self._watching is None:
            self._watching = Watching(self.swarm)
        return self._watching.view(self.swarm.now)

    def order(self, order: Order) -> SentCommand:
        if self._watching is None and (order.by or order.kind == CommandKind.FORM):
            self.view()
            self.turn()  # agents say where they would come to rest
        swarm = self._now()
        command = build(order, swarm, self._mission)
        sent = self._sender.send(command, self.swarm.now, swarm.meant(order))
        while not sent.over:
            self.turn()
            for ack in self.swarm.acks:
                self._sender.hear(ack)
            self._sender.turn(self.swarm.now)
        return sent

    def _now(self) -> SwarmNow:
        """What a ground station would know if messages took no time: where agents said that they
        would come to rest, and where their vehicles are while nothing is heard."""
        agents, step = [], 0
        points: dict[int, Point] = dict(self.swarm.positions())
        if self._watching is not None:
            heard = self._watching.view(self.swarm.now).agents
            points |= {a.id: a.state.stop_point_m for a in heard if a.state is not None}
        for agent_id, point in points.items():
            member = self.swarm.members[agent_id]
            status = member.status
            gains = status.gains if status else None
            left = status is not None and status.left is not None
            down = not member.alive
            agents.append(
                AgentNow(agent_id, point, flies=member.alive, gains=gains, left=left, down=down)
            )
            if member.alive and status:
                step = max(step, status.step)
        return SwarmNow(self.plan, self.swarm.now, step, tuple(agents))

    def kill_agent(self, agent: int) -> None:
        self.swarm.kill(self.known(agent))

    def freeze_agent(self, agent: int) -> None:
        self.swarm.members[self.known(agent)].frozen = True

    def thaw_agent(self, agent: int) -> None:
        self.swarm.members[self.known(agent)].frozen = False

    def kill_station(self) -> None:
        self.swarm.station_alive = False

    def events(self) -> Sequence[Event]:
        return tuple(self.swarm.events)

    def statuses(self) -> Mapping[int, AgentStatus]:
        return {i: member.status for i, member in self.swarm.members.items() if member.status}

    @property
    def where(self) -> str:
        now = f"{self.swarm.now:.1f} s on the virtual clock, seed {self._seed}"
        return f"{now}: no run folder; a flight with virtual=False leaves one, with a report"

    def finish(self, within_s: float = 900.0) -> FlightResult:
        __tracebackhide__ = True
        swarm, until = self.swarm, self.swarm.now + within_s
        # Vehicles without an agent take longer to come down.
        while not (self._flown and swarm.all_down) and swarm.now < until:
            self.turn()
        if not self._flown:
            raise FlightError(f"the flight did not end within {within_s:g} s")
        closest_m = min(swarm.minimum.values(), default=math.inf)
        return FlightResult(swarm.outcomes(), closest_m, swarm.all_down, tuple(swarm.events))

    @property
    def _flown(self) -> bool:
        """Every agent that goes on has ended."""
        return not any(member.alive and not member.frozen for member in self.swarm.members.values())

    def land(self) -> None:
        if not self._flown:
            self.command(CommandKind.LAND)
            self.finish()

    def close(self) -> None:
        """There is no process to end."""
