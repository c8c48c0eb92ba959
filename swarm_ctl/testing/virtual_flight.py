"""A flight on the virtual clock: all agents in this process, the same in every run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from swarm_ctl.commands.build import AgentNow, SwarmNow, build
from swarm_ctl.commands.parse import Order
from swarm_ctl.commands.send import CommandSender, SentCommand
from swarm_ctl.core.model.messages import AgentStatus, Event
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.testing.flight import FlightResult, SwarmFlight
from swarm_ctl.testing.virtual_swarm import VirtualSwarm


class VirtualFlight(SwarmFlight):
    """Tests may read and change `swarm`."""

    def __init__(self, mission: LoadedMission, seed: int = 1) -> None:
        self.plan = mission.plan
        self.swarm = VirtualSwarm(mission, seed)
        self._mission, self._seed = mission, seed
        self._sender = CommandSender(self.swarm.send, [agent.id for agent in self.plan.agents])

    def wait_step(self, step: int | str, within_s: float = 300.0) -> None:
        __tracebackhide__ = True
        number, until = self.step_number(step), self.swarm.now + within_s
        while not self._reached(number):
            live = any(member.alive for member in self.swarm.members.values())
            if self.swarm.now > until or not live:
                raise AssertionError(f"step {step!r} was not reached within {within_s:g} s")
            self.swarm.tick()

    def _reached(self, number: int) -> bool:
        live = [m for m in self.swarm.members.values() if m.alive and not m.frozen]
        return bool(live) and all(m.status is not None and m.status.step >= number for m in live)

    def wait_s(self, seconds: float) -> None:
        self.swarm.run(seconds)

    def order(self, order: Order) -> SentCommand:
        swarm = self._now()
        command = build(order, swarm, self._mission)
        sent = self._sender.send(command, self.swarm.now, swarm.meant(order))
        while not sent.over:
            self.swarm.tick()
            for ack in self.swarm.acks:
                self._sender.hear(ack)
            self._sender.turn(self.swarm.now)
        return sent

    def _now(self) -> SwarmNow:
        """What a ground station would know if messages took no time."""
        agents, step = [], 0
        for agent_id, point in self.swarm.positions().items():
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
        swarm.fly(until)
        # Vehicles without an agent take longer to come down.
        while not swarm.all_down and swarm.now < until:
            swarm.tick()
        if any(member.alive and not member.frozen for member in swarm.members.values()):
            raise AssertionError(f"the flight did not end within {within_s:g} s")
        closest_m = min(swarm.minimum.values(), default=math.inf)
        return FlightResult(swarm.outcomes(), closest_m, swarm.all_down, tuple(swarm.events))

    def close(self) -> None:
        """There is no process to end."""
