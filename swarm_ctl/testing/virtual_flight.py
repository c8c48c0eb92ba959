"""A flight on the virtual clock: the whole swarm in this process, as fast as it computes, the same
every time."""

from __future__ import annotations

import math
from collections.abc import Sequence

from swarm_ctl.commands import build
from swarm_ctl.core.model.messages import Command
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.mission.input.units import in_units
from swarm_ctl.testing.flight import Answer, Flight, Flown
from swarm_ctl.testing.virtual_swarm import VirtualSwarm

_ANSWER_S = 1.0


class VirtualFlight(Flight):
    """See `Flight`; `swarm` is open to look into."""

    def __init__(self, mission: LoadedMission, seed: int = 1) -> None:
        self.plan = mission.plan
        self.swarm = VirtualSwarm(mission, seed)
        self._shapes = in_units(mission.file).shapes
        self._sent = 0

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

    def command(self, kind: str, agents: Sequence[int] = ()) -> Answer:
        """As `Flight.command`."""
        steps = [
            member.status.step
            for member in self.swarm.members.values()
            if member.alive and member.status
        ]
        at_step = max(steps, default=0) if kind == "next" else 0
        return self._send(
            Command(self._name(), kind, tuple(agents), self.swarm.now, at_step=at_step)
        )

    def form(self, shape: str) -> Answer:
        """As `Flight.form`."""
        step = build.form_step(
            self._shapes, self.plan, shape, self.swarm.positions(), "this mission"
        )
        return self._send(Command(self._name(), "form", (), self.swarm.now, step, self.plan.hash()))

    def move(self, north_m: float, east_m: float, speed_mps: float | None = None) -> Answer:
        """As `Flight.move`."""
        step = build.move(self.plan, (north_m, east_m), speed_mps)
        return self._send(Command(self._name(), "move", (), self.swarm.now, step, self.plan.hash()))

    def _name(self) -> str:
        self._sent += 1
        return f"test-{self._sent}"

    def _send(self, command: Command) -> Answer:
        meant = command.agents or tuple(agent.id for agent in self.plan.agents)
        until = self.swarm.now + _ANSWER_S
        self.swarm.send(command)
        while self.swarm.now < until:
            self.swarm.tick()
            acks = {
                ack.agent: ack
                for ack in self.swarm.acks
                if ack.command == command.id and ack.agent in meant
            }
            if len(acks) == len(meant):
                break
        return Answer(acks, meant)

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
