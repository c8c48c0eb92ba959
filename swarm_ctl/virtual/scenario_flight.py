"""Flies a scenario on the virtual clock and judges it as `run` judges a flight."""

from __future__ import annotations

import heapq
import itertools
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from swarm_ctl.commands.send import SentCommand
from swarm_ctl.core.model.messages import AgentStatus, Event, Phase
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.timeouts import LANDING_AT_MOST_S
from swarm_ctl.engine.collector import collected_rarely
from swarm_ctl.engine.script import HELD_S, Excused, Holding, ScriptedOrder, holds
from swarm_ctl.engine.station.ground_station import Station
from swarm_ctl.engine.station.scripted_operator import give_line, refusal
from swarm_ctl.errors import InputError
from swarm_ctl.mesh.impaired import ImpairedTransport
from swarm_ctl.mesh.memory_transport import MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.transport import Transport
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.report.judge.summary import Summary
from swarm_ctl.runfolder.refused_orders import RefusedOrder, in_order
from swarm_ctl.runfolder.truth import Truth
from swarm_ctl.virtual.account import Account
from swarm_ctl.virtual.as_processes import cut, dice_of, impairment_of, own_clocks, untruth_of
from swarm_ctl.virtual.scenario import STATION, Happening, Says, Scenario
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm, configuration

_DRAIN_S: Final = 90.0
"""The simulator of a run goes on for so long without agents."""


def longest_s(plan: Plan, scenario: Scenario | None = None) -> float:
    """A flight's upper bound [s]: every wait of it has a time-out, and these are their sum, with
    the longest way down at the end, and without agents after that."""
    steps = max(sum(s.timeout_s for s in plan.steps_of(agent.id)) for agent in plan.agents)
    waits = plan.prepare_timeout_s + steps + 2.0 * LANDING_AT_MOST_S + _DRAIN_S
    if scenario is None:
        return waits
    policies = plan.policies
    waits += scenario.ends_s + HELD_S
    return waits + policies.override_pause_s + policies.hold_before_land_s


@dataclass(slots=True)
class GivenOrder:
    """An order of the scenario."""

    at_s: float
    order: ScriptedOrder
    sent: SentCommand | None
    """None: the station refused to build it."""
    refused: str = ""
    """Why."""

    @property
    def line(self) -> str:
        """As it is typed."""
        return self.order.line

    @property
    def refusal(self) -> RefusedOrder | None:
        """That it was refused; None: it was not, or may be."""
        if self.sent is not None:
            return refusal(self.order, self.sent)
        order = self.order
        return None if order.may_be_refused else RefusedOrder(order.at_s, order.line, self.refused)


@dataclass(slots=True)
class Met:
    """A happening as it met the swarm."""

    happening: Happening
    step: str
    """The furthest step of any agent, by its name's first word: `form`; `prepare` before."""
    phases: frozenset[Phase]
    """Of all live agents."""


@dataclass(slots=True, eq=False)
class FlownScenario:
    """How it went."""

    scenario: Scenario
    mission: LoadedMission
    summary: Summary
    truth: Truth
    statuses: tuple[AgentStatus, ...]
    """As the station heard them, and each agent's own last one."""
    states: tuple[bytes, ...]
    """Each state of an agent, encoded as on the mesh."""
    events: tuple[Event, ...]
    orders: tuple[GivenOrder, ...]
    met: tuple[Met, ...]
    bound_s: float
    end_s: float
    up: tuple[int, ...]
    """The agents that had not ended by the bound."""
    digest: str
    """Of every message, the truth and the verdict: the same seed has the same."""
    folder: Path | None = None

    @property
    def all_down(self) -> bool:
        """Every vehicle stood disarmed on the ground at the end."""
        truth = self.truth
        return bool(len(truth.time_s)) and not (truth.armed[-1].any() or truth.airborne[-1].any())


@dataclass(slots=True)
class _Due:
    do: Callable[[], None]
    met: Happening | None = field(default=None)


class ScenarioFlight:
    """One flight. `swarm` may be read and changed between ticks; `folder`: what a run leaves is
    written there."""

    def __init__(
        self, scenario: Scenario, mission: LoadedMission, folder: Path | None = None
    ) -> None:
        self.scenario, self.mission, self._folder = scenario, mission, folder
        self.plan = plan = mission.plan
        self._ids = [agent.id for agent in plan.agents]
        self._parts: Counter[tuple[int | str, int | str]] = Counter()
        """How often (hearer, speaker) is cut."""
        self._transports: dict[int, ImpairedTransport] = {}
        self._impairment = impairment_of(scenario)
        self._clocks = own_clocks(scenario)
        self.account = Account(mission, configuration(mission, scenario.seed), folder)
        self.swarm = VirtualSwarm(
            mission,
            scenario.seed,
            mesh=self._wrap,
            clocks={i: self._clock(i) for i in self._clocks},
            lockstep=True,
        )
        self.swarm.account = self.account
        self._truth = self.account.watch(self.swarm.hub.world, self.swarm.mesh)
        self.swarm.hub.recorder = self._truth
        self.swarm.station_alive = False  # there is another one
        self.swarm.after_tick = self._operate
        self._stations = 1
        self.station: Station | None = self.operated(1)
        """None: it is gone."""
        self.lands_the_held = True
        """In the end, as the scenario has it."""
        self._holding, self._excused = Holding(scenario.ends_s), Excused()
        self._killed: set[str] = set()
        self.orders: list[GivenOrder] = []
        self.met: list[Met] = []
        self.bound_s = longest_s(plan, scenario)
        self._number = itertools.count()
        self._due: list[tuple[float, int, _Due]] = []
        for happening in scenario.happens:
            self._plan(happening)

    # --- the timetable ---

    def _plan(self, happening: Happening) -> None:
        for at_s, do in self._doings(happening):
            first = happening if at_s == happening.at_s else None
            heapq.heappush(self._due, (at_s, next(self._number), _Due(do, first)))

    def _doings(self, happening: Happening) -> Iterator[tuple[float, Callable[[], None]]]:
        """What is done when."""
        at_s, for_s = happening.at_s, happening.for_s
        end_s = None if for_s is None else at_s + for_s
        if happening.order:
            order = ScriptedOrder(at_s, happening.order, happening.may_be_refused)
            yield at_s, lambda: self._order(order)
        elif happening.kill:
            yield at_s, lambda: self.kill(*happening.kill or ())
        elif happening.restart:
            yield at_s, lambda: self._restart(happening.restart or ())
        elif happening.stop and end_s is not None:
            yield at_s, lambda: self._stop(happening.stop or (), True)
            yield end_s, lambda: self._stop(happening.stop or (), False)
        elif happening.station:
            yield at_s, self.kill_station
            if end_s is not None:
                yield end_s, self._station_comes
        elif happening.part is not None:
            pairs = list(cut(happening.part))
            yield at_s, lambda: self._part(pairs, 1)
            if end_s is not None:
                yield end_s, lambda: self._part(pairs, -1)
        elif happening.clock is not None:
            yield at_s, lambda: self._set_clocks(happening)
        elif happening.says is not None:
            says = happening.says
            yield at_s, lambda: self._say(says, True)
            if end_s is not None:
                yield end_s, lambda: self._say(says, False)
        else:  # the simulator's own timetable has it
            yield at_s, lambda: None

    def _order(self, order: ScriptedOrder) -> None:
        sent, refused, order = None, "", self._excused.of(order)
        if self.station is None:  # the scenario has killed it
            refused, order = "there is no station", order._replace(may_be_refused=True)
        else:
            try:
                sent = give_line(self.station, order.line, len(self.orders) + 1)
            except InputError as error:
                refused = str(error)
            else:
                self._excused.gave(sent.command)
        self.orders.append(GivenOrder(self.swarm.now, order, sent, refused))

    def operated(self, number: int) -> Station:
        """The station that the operator sits at, as in a run."""
        node = Node(MemoryTransport(self.swarm.mesh), "test", f"{STATION}-{number}")
        return Station(self.plan, node, _SwarmClock(self.swarm))

    def kill(self, *agents: int) -> None:
        """Kill agents' processes."""
        for agent in agents:
            if self.swarm.members[agent].alive:
                self._killed.add(f"agent-{agent}")
                self.swarm.kill(agent)

    def _restart(self, agents: tuple[int, ...]) -> None:
        for agent in agents:
            member = self.swarm.members[agent]
            if not member.alive and member.ended is None:
                clock = self._clock(agent) if agent in self._clocks else None
                self.swarm.restart(agent, clock=clock)

    def _stop(self, agents: tuple[int, ...], stops: bool) -> None:
        for agent in agents:
            self.swarm.members[agent].frozen = stops

    def kill_station(self) -> None:
        """Kill the station's process."""
        self.station = None
        self._killed.add(STATION)

    def _station_comes(self) -> None:
        self._stations += 1
        self.station = self.operated(self._stations)

    def _part(self, pairs: list[tuple[int | str, int | str]], by: int) -> None:
        for pair in pairs:
            self._parts[pair] += by
        self._silence()

    def _silence(self) -> None:
        for agent, transport in self._transports.items():
            cut = (pair[1] for pair, times in self._parts.items() if times and pair[0] == agent)
            transport.silent = set(map(str, cut))

    def _set_clocks(self, happening: Happening) -> None:
        for agent in happening.clock.agents if happening.clock else ():
            ahead_s, drift = self._clocks[agent]
            jump_s = happening.clock.ahead_s if happening.clock else 0.0
            self._clocks[agent] = (ahead_s + jump_s, drift)

    def _say(self, says: Says, on: bool) -> None:
        for agent in says.agents:
            self.swarm.members[agent].tampered = untruth_of(says).of if on else None

    def _clock(self, agent: int) -> Callable[[float], float]:
        def own(now: float) -> float:
            ahead_s, drift = self._clocks[agent]
            return now * (1.0 + drift) + ahead_s

        return own

    def _wrap(self, transport: Transport, agent: int) -> Transport:
        if self._impairment is None:
            return transport
        wrapped = ImpairedTransport(
            transport,
            [*self._ids, STATION],
            self._impairment,
            lambda: self.swarm.now if hasattr(self, "swarm") else 0.0,
            dice_of(self.scenario, agent),
        )
        self._transports[agent] = wrapped
        self._silence()
        return wrapped

    # --- the flight ---

    def turn(self) -> None:
        """One tick, and what is due then."""
        swarm = self.swarm
        while self._due and self._due[0][0] <= swarm.now + 1e-9:
            due = heapq.heappop(self._due)[2]
            if due.met is not None:
                self.met.append(self._meet(due.met))
            due.do()
        swarm.tick()

    def _operate(self) -> None:
        """The station's turn, and the operator's. Where agents hold without a station, another one
        comes in the end: they would hold until their batteries are low."""
        if self.station is not None:
            self.station.turn()
            states = list(self.station.states())
        else:
            live = (m.state for m in self.swarm.members.values() if m.alive)
            states = [state for state in live if state is not None]
        self._excused.hear(states)
        if not self.lands_the_held or not self._holding.lands(holds(states), self.swarm.now):
            return
        if self.station is not None:
            self._order(ScriptedOrder(self.swarm.now, "land", may_be_refused=True))
        else:
            self._station_comes()

    def _meet(self, happening: Happening) -> Met:
        live = [m.status for m in self.swarm.members.values() if m.alive and m.status is not None]
        names = {s.step: self.plan.group_of(s.agent, s.step).step_name(s.step) for s in live}
        name = names[max(names)].split()[0] if names else "prepare"
        return Met(happening, name, frozenset(status.phase for status in live))

    @property
    def up(self) -> tuple[int, ...]:
        """The agents that have not ended."""
        return tuple(i for i, m in self.swarm.members.items() if m.alive)

    @property
    def over(self) -> bool:
        """Every agent has ended, and so has what is to be done to them."""
        return not any(m.alive for m in self.swarm.members.values()) and not self.comes_back

    @property
    def comes_back(self) -> bool:
        """A killed agent is still to be started again."""
        return any(due.met is not None and due.met.restart for _, _, due in self._due)

    def fly(self, watch: Callable[[ScenarioFlight], None] = lambda _: None) -> FlownScenario:
        """To its end, or to its upper bound; `watch` is called after each tick."""
        swarm = self.swarm
        with collected_rarely():
            while not self.over and swarm.now < self.bound_s:
                self.turn()
                watch(self)
            return self.conclude(watch)

    def conclude(self, watch: Callable[[ScenarioFlight], None] = lambda _: None) -> FlownScenario:
        """Once no agent goes on: until all vehicles are down, and then the verdict."""
        swarm, until_s = self.swarm, self.swarm.now + _DRAIN_S
        up = self.up
        swarm.tick()  # in which the simulator learns that no agent is left
        while not swarm.all_down and swarm.now < until_s:
            swarm.tick()
            watch(self)
        self._truth.close()
        swarm.hub.recorder = None
        names = [*(f"agent-{agent}" for agent in self._ids), STATION, "simulator"]
        refused = in_order(each for order in self.orders if (each := order.refusal))
        summary, truth = self.account.judge({name: name in self._killed for name in names}, refused)
        return FlownScenario(
            scenario=self.scenario,
            mission=self.mission,
            summary=summary,
            truth=truth,
            statuses=(*self.account.statuses, *self.account.finals.values()),
            states=tuple(self.account.states),
            events=tuple(self.account.events),
            orders=tuple(self.orders),
            met=tuple(self.met),
            bound_s=self.bound_s,
            end_s=swarm.now,
            up=up,
            digest=self.account.digest(),
            folder=self._folder,
        )


def fly_scenario(
    scenario: Scenario, mission: LoadedMission, folder: Path | None = None
) -> FlownScenario:
    """Fly a scenario to its end; `folder`: what a run leaves is written there."""
    return ScenarioFlight(scenario, mission, folder).fly()


@dataclass(slots=True)
class _SwarmClock:
    """As a station reads the swarm's time."""

    swarm: VirtualSwarm
    speedup: float = 1.0
    stepped: bool = True

    def now(self) -> float:
        """Mission time [s]."""
        return self.swarm.now
