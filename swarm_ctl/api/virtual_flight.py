"""A flight on the virtual clock: all agents in this process, the same in every run, and the same as
processes in lockstep fly it."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Final

from swarm_ctl.api.flight import FlightError, FlightResult, SwarmFlight
from swarm_ctl.commands.parse import Order
from swarm_ctl.commands.send import SentCommand
from swarm_ctl.core.model.messages import AgentStatus, CommandKind, Event
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.swarm.gain_update import ASKS
from swarm_ctl.engine.station.ground_station import Station
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.station.picture.view import SwarmView
from swarm_ctl.virtual.scenario import Scenario
from swarm_ctl.virtual.scenario_flight import ScenarioFlight

_OF_WHERE: Final = frozenset({CommandKind.FORM, CommandKind.MOVE, *ASKS})
"""Orders that are made of where the agents are, or of their law, wait for them."""
_HEAR_S: Final = 5.0


class VirtualFlight(SwarmFlight):
    """Tests may read and change `swarm`. `scenario`: what befalls it; None: nothing but what the
    test does."""

    def __init__(
        self, mission: LoadedMission, seed: int = 1, scenario: Scenario | None = None
    ) -> None:
        super().__init__(mission.plan, scenario)
        befalls = scenario or Scenario(version=1, mission=str(mission.source), seed=seed)
        self._flight = ScenarioFlight(befalls, mission)
        self._flight.lands_the_held = scenario is not None
        self.swarm = self._flight.swarm
        self._seed = befalls.seed
        self._own: Station | None = None
        self._result: FlightResult | None = None

    @property
    def now(self) -> float:
        return self.swarm.now

    @property
    def over(self) -> bool:
        return self._flight.over

    @property
    def up(self) -> tuple[int, ...]:
        return self._flight.up

    def turn(self) -> None:
        self._flight.turn()
        if self._own is not None:
            self._own.hear()
        self.observed()

    def wait_s(self, seconds: float) -> None:
        until = self.now + seconds
        while self.now < until:  # vehicles fly on without their agents
            self.turn()

    def reached(self, step: int, agents: Collection[int] = ()) -> bool:
        live = [
            m
            for i, m in self.swarm.members.items()
            if m.alive and not m.frozen and (i in agents or not agents)
            if m.state is None or m.state.left is None
        ]
        return bool(live) and all(m.status is not None and m.status.step >= step for m in live)

    @property
    def _station(self) -> Station:
        """The flight's own; when that is gone, one of the test's own that only hears and orders."""
        if self._flight.station is not None:
            return self._flight.station
        if self._own is None:
            self._own = self._flight.operated(0)
        return self._own

    def view(self) -> SwarmView:
        return self._station.view()

    def give(self, order: Order) -> SentCommand:
        return self._station.order(order)

    def order(self, order: Order) -> SentCommand:
        until = self.now + _HEAR_S
        while order.kind in _OF_WHERE and self.now < until:
            if len(self._station.states()) >= len(self.up):
                break
            self.turn()  # agents say where they would come to rest
        sent = self.give(order)
        while not sent.over:
            self.turn()
        return sent

    def kill_agent(self, agent: int) -> None:
        self._flight.kill(self.known(agent))

    def freeze_agent(self, agent: int) -> None:
        self.swarm.members[self.known(agent)].frozen = True

    def thaw_agent(self, agent: int) -> None:
        self.swarm.members[self.known(agent)].frozen = False

    def kill_station(self) -> None:
        self._flight.kill_station()

    def events(self) -> Sequence[Event]:
        return tuple(self.swarm.events)

    def statuses(self) -> Mapping[int, AgentStatus]:
        return {i: member.status for i, member in self.swarm.members.items() if member.status}

    @property
    def where(self) -> str:
        now = f"{self.swarm.now:.1f} s on the virtual clock, seed {self._seed}"
        return f"{now}: no run folder; a flight with virtual=False leaves one, with a report"

    def finish(self, within_s: float | None = None) -> FlightResult:
        __tracebackhide__ = True
        if self._result is not None:
            return self._result
        swarm, within_s = self.swarm, self.bound_s if within_s is None else within_s
        until = swarm.now + within_s
        # Vehicles whose agent stands still come down by themselves.
        while not (self._flown and (self.over or swarm.all_down)) and swarm.now < until:
            self.turn()
        if not self._flown:
            who = agents_named(self.up)
            raise FlightError(f"the flight did not end within {within_s:g} s: {who} did not")
        flown = self._flight.conclude(lambda _: self.observed())
        closest_m = min(swarm.minimum.values(), default=math.inf)
        self._result = FlightResult(
            swarm.outcomes(),
            closest_m,
            swarm.all_down,
            tuple(swarm.events),
            flown.summary,
            flown.truth,
            digest=flown.digest,
        )
        return self._result

    @property
    def _flown(self) -> bool:
        """Every agent that goes on has ended."""
        flies = any(member.alive and not member.frozen for member in self.swarm.members.values())
        return not flies and not self._flight.comes_back

    def land(self) -> None:
        if not self._flown:
            self.command(CommandKind.LAND)
            self.finish()

    def close(self) -> None:
        """There is no process to end."""
