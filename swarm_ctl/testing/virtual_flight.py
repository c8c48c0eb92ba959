"""A flight on the virtual clock: the whole swarm in this process, as fast as it computes, the same
every time."""

from __future__ import annotations

import math

from swarm_ctl.commands.build import AgentNow, SwarmNow, build
from swarm_ctl.commands.parse import Order
from swarm_ctl.commands.send import CommandSender, SentCommand
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.testing.flight import Flight, Flown
from swarm_ctl.testing.virtual_swarm import VirtualSwarm


class VirtualFlight(Flight):
    """See `Flight`; `swarm` is open to look into."""

    def __init__(self, mission: LoadedMission, seed: int = 1) -> None:
        self.plan = mission.plan
        self.swarm = VirtualSwarm(mission, seed)
        self._mission = mission
        self._sender = CommandSender(self.swarm.send, [agent.id for agent in self.plan.agents])

    def wait_step(self, step: int | str, within_s: float = 300.0) -> None:
        """As `Flight.wait_step`."""
        number, until = self.step_number(step), self.swarm.now + within_s
        while not self._reached(number):
            live = any(member.alive for member in self.swarm.members.values())
            if self.swarm.now > until or not live:
                raise AssertionError(f"step {step!r} was not reached within {within_s:g} s")
            self.swarm.tick()

    def _reached(self, number: int) -> bool:
        live = [
            member for member in self.swarm.members.values() if member.alive and not member.frozen
        ]
        return bool(live) and all(m.status is not None and m.status.step >= number for m in live)

    def wait_s(self, seconds: float) -> None:
        """As `Flight.wait_s`."""
        self.swarm.run(seconds)

    def order(self, order: Order) -> SentCommand:
        """As `Flight.order`."""
        sent = self._sender.send(build(order, self._now(), self._mission), self.swarm.now)
        while not sent.over:
            self.swarm.tick()
            for ack in self.swarm.acks:
                self._sender.hear(ack)
            self._sender.turn(self.swarm.now)
        return sent

    def _now(self) -> SwarmNow:
        """What a ground station without any delay would know."""
        agents, step = [], 0
        for agent_id, point in self.swarm.positions().items():
            member = self.swarm.members[agent_id]
            status = member.status
            agents.append(
                AgentNow(
                    agent_id, point, flies=member.alive, gains=status.gains if status else None
                )
            )
            if member.alive and status:
                step = max(step, status.step)
        return SwarmNow(self.plan, self.swarm.now, step, tuple(agents))

    def kill_agent(self, agent: int) -> None:
        """As `Flight.kill_agent`."""
        self.swarm.kill(agent)

    def freeze_agent(self, agent: int) -> None:
        """As `Flight.freeze_agent`."""
        self.swarm.members[agent].frozen = True

    def thaw_agent(self, agent: int) -> None:
        """As `Flight.thaw_agent`."""
        self.swarm.members[agent].frozen = False

    def kill_station(self) -> None:
        """As `Flight.kill_station`."""
        self.swarm.station_alive = False

    def finish(self, within_s: float = 900.0) -> Flown:
        """As `Flight.finish`; waits for vehicles left to themselves, too."""
        until = self.swarm.now + within_s
        self.swarm.fly(until)
        while not self.swarm.all_down and self.swarm.now < until:
            self.swarm.tick()
        closest_m = min(self.swarm.minimum.values(), default=math.inf)
        return Flown(
            self.swarm.outcomes(), closest_m, self.swarm.all_down, tuple(self.swarm.events)
        )

    def close(self) -> None:
        """Nothing is outside this process."""
