"""Flies a scenario on the virtual clock and judges it as `run` judges a flight."""

from __future__ import annotations

import heapq
import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from swarm_ctl.commands.build import AgentNow, SwarmNow, build
from swarm_ctl.commands.parse import parse
from swarm_ctl.commands.send import CommandSender, SentCommand
from swarm_ctl.core.agent.progress import step_name
from swarm_ctl.core.model.messages import AgentState, AgentStatus, Event, Phase
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.timeouts import LANDING_AT_MOST_S, NEIGHBOUR_S
from swarm_ctl.errors import InputError
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.impaired import ImpairedTransport, Impairment
from swarm_ctl.mesh.memory_transport import MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.transport import Transport
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.report.folder.truth import Truth
from swarm_ctl.report.judge.summary import Summary
from swarm_ctl.runtime.collector import collected_rarely
from swarm_ctl.virtual.account import Account
from swarm_ctl.virtual.scenario import STATION, Happening, Says, Scenario
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm, configuration

_HELD_S: Final = 20.0
"""A shorter hold may end by itself."""
_DRAIN_S: Final = 90.0
"""The simulator of a run goes on for so long without agents."""


def longest_s(plan: Plan, scenario: Scenario | None = None) -> float:
    """A flight's upper bound [s]: every wait of it has a time-out, and these are their sum, with
    the longest way down at the end, and without agents after that."""
    steps = sum(step.timeout_s for step in plan.steps)
    waits = plan.prepare_timeout_s + steps + 2.0 * LANDING_AT_MOST_S + _DRAIN_S
    if scenario is None:
        return waits
    policies = plan.policies
    waits += scenario.ends_s + _HELD_S
    return waits + policies.override_pause_s + policies.hold_before_land_s


@dataclass(slots=True)
class GivenOrder:
    """An order of the scenario."""

    at_s: float
    line: str
    sent: SentCommand | None
    """None: the station refused to build it."""
    refused: str = ""
    """Why."""


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
        quality = scenario.mesh
        self._impaired = bool(quality.model_dump(exclude_defaults=True)) or any(
            each.part for each in scenario.happens
        )
        self._clocks = {i: (c.ahead_s, c.drift) for c in scenario.clocks for i in c.agents}
        self._clocks |= {
            i: self._clocks.get(i, (0.0, 0.0))
            for each in scenario.happens
            if each.clock is not None
            for i in each.clock.agents
        }
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
        self._sender = CommandSender(self.swarm.send, self._ids)
        self._heard_acks = 0
        self._listener = Node(MemoryTransport(self.swarm.mesh), "test", "listener")
        self._listener.listen(keys.STATE, agents=self._ids)
        self._states: dict[int, tuple[AgentState, float]] = {}
        self._killed: set[str] = set()
        self.orders: list[GivenOrder] = []
        self.met: list[Met] = []
        self.bound_s = longest_s(plan, scenario)
        self._number = itertools.count()
        self._due: list[tuple[float, int, _Due]] = []
        for happening in scenario.happens:
            self._plan(happening)
        self._held_since_s = math.inf

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
            yield at_s, lambda: self._order(happening.order)
        elif happening.kill:
            yield at_s, lambda: self._kill(happening.kill or ())
        elif happening.restart:
            yield at_s, lambda: self._restart(happening.restart or ())
        elif happening.stop and end_s is not None:
            yield at_s, lambda: self._stop(happening.stop or (), True)
            yield end_s, lambda: self._stop(happening.stop or (), False)
        elif happening.station:
            yield at_s, self._station_gone
            if end_s is not None:
                yield end_s, lambda: setattr(self.swarm, "station_alive", True)
        elif happening.part is not None:
            pairs = list(_cut(happening.part.one, happening.part.other, happening.part.one_way))
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

    def _order(self, line: str) -> None:
        order = parse(line, self.plan)
        swarm = self._now()
        if not self.swarm.station_alive:
            self.orders.append(GivenOrder(self.swarm.now, line, None, "there is no station"))
            return
        try:
            command = build(order, swarm, self.mission)
        except InputError as error:
            self.orders.append(GivenOrder(self.swarm.now, line, None, str(error)))
            return
        command = replace(command, id=f"order-{len(self.orders) + 1}")
        sent = self._sender.send(command, self.swarm.now, swarm.meant(order))
        self.orders.append(GivenOrder(self.swarm.now, line, sent))

    def _now(self) -> SwarmNow:
        """The swarm as the station knows it."""
        now, step, agents = self.swarm.now, 0, []
        for agent, member in self.swarm.members.items():
            status, heard = member.status, self._states.get(agent)
            state = heard[0] if heard else None
            old = heard is None or now - heard[1] > NEIGHBOUR_S
            agents.append(
                AgentNow(
                    agent,
                    state.stop_point_m if state else None,
                    lost=old,
                    flies=member.alive and not old,
                    gains=status.gains if status else None,
                    left=state is not None and state.left is not None,
                    down=not member.alive,
                )
            )
            if member.alive and state is not None:
                step = max(step, state.step)
        return SwarmNow(self.plan, now, step, tuple(agents))

    def _kill(self, agents: tuple[int, ...]) -> None:
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

    def _station_gone(self) -> None:
        self.swarm.station_alive = False
        self._killed.add(STATION)

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
            self.swarm.members[agent].tampered = _tells(says) if on else None

    def _clock(self, agent: int) -> Callable[[float], float]:
        def own(now: float) -> float:
            ahead_s, drift = self._clocks[agent]
            return now * (1.0 + drift) + ahead_s

        return own

    def _wrap(self, transport: Transport, agent: int) -> Transport:
        if not self._impaired:
            return transport
        quality = self.scenario.mesh
        how = Impairment(quality.loss, quality.delay_s, quality.jitter_s, quality.duplicate)
        wrapped = ImpairedTransport(
            transport,
            [*self._ids, STATION],
            how,
            lambda: self.swarm.now if hasattr(self, "swarm") else 0.0,
            self.scenario.seed * 1009 + agent,
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
        for state, _ in self._listener.take(keys.STATE):
            self._states[state.agent] = (state, swarm.now)
        for ack in swarm.acks[self._heard_acks :]:
            self._sender.hear(ack)
            self.account.sent(ack, swarm.now)
        self._heard_acks = len(swarm.acks)
        if swarm.station_alive:
            self._sender.turn(swarm.now)
        self._land_the_held()

    def _land_the_held(self) -> None:
        """The operator, in the end: a swarm that holds would hold until its batteries are low."""
        now = self.swarm.now
        if not self._held():
            self._held_since_s = math.inf
            return
        self._held_since_s = min(self._held_since_s, now)
        if now >= max(self.scenario.ends_s, self._held_since_s + _HELD_S):
            self._held_since_s = now
            self._order("land")

    def _held(self) -> bool:
        """An order of the operator's keeps some agent from going on."""
        live = (i for i, m in self.swarm.members.items() if m.alive and not m.frozen)
        heard = (self._states[i][0] for i in live if i in self._states)
        return any(state.override or state.phase is Phase.HOLD for state in heard)

    def _meet(self, happening: Happening) -> Met:
        live = [m.status for m in self.swarm.members.values() if m.alive and m.status is not None]
        step = max((status.step for status in live), default=0)
        name = step_name(self.plan, step).split()[0] if step else "prepare"
        return Met(happening, name, frozenset(status.phase for status in live))

    @property
    def over(self) -> bool:
        """Every agent has ended, and so has what is to be done to them."""
        return not any(m.alive for m in self.swarm.members.values()) and not self._comes_back()

    def _comes_back(self) -> bool:
        """A killed agent is still to be started again."""
        return any(due.met is not None and due.met.restart for _, _, due in self._due)

    def fly(self, watch: Callable[[ScenarioFlight], None] = lambda _: None) -> FlownScenario:
        """To its end, or to its upper bound; `watch` is called after each tick."""
        swarm = self.swarm
        with collected_rarely():
            while not self.over and swarm.now < self.bound_s:
                self.turn()
                watch(self)
            up = tuple(i for i, m in swarm.members.items() if m.alive)
            until_s = swarm.now + _DRAIN_S
            swarm.tick()  # in which the simulator learns that no agent is left
            while not swarm.all_down and swarm.now < until_s:
                swarm.tick()
                watch(self)
        self._truth.close()
        names = [*(f"agent-{agent}" for agent in self._ids), STATION, "simulator"]
        summary, truth = self.account.judge({name: name in self._killed for name in names})
        return FlownScenario(
            self.scenario,
            self.mission,
            summary,
            truth,
            (*self.account.statuses, *self.account.finals.values()),
            tuple(self.account.events),
            tuple(self.orders),
            tuple(self.met),
            self.bound_s,
            swarm.now,
            up,
            self.account.digest(),
            self._folder,
        )


def fly_scenario(
    scenario: Scenario, mission: LoadedMission, folder: Path | None = None
) -> FlownScenario:
    """Fly a scenario to its end; `folder`: what a run leaves is written there."""
    return ScenarioFlight(scenario, mission, folder).fly()


def _cut(
    one: tuple[int | str, ...], other: tuple[int | str, ...], one_way: bool
) -> Iterator[tuple[int | str, int | str]]:
    """(hearer, speaker) of all that do not hear."""
    for a, b in itertools.product(one, other):
        yield a, b
        if not one_way:
            yield b, a


def _tells(says: Says) -> Callable[[AgentState], AgentState]:
    north, east = says.moved_m

    def told(state: AgentState) -> AgentState:
        (n, e, d), (stop_n, stop_e) = state.position_ned_m, state.stop_point_m
        moved = replace(
            state,
            position_ned_m=(n + north, e + east, d),
            stop_point_m=(stop_n + north, stop_e + east),
        )
        wrong: Any = says.set
        return replace(moved, **wrong)

    return told
