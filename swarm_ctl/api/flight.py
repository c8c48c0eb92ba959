"""One interface to a flight under test, with real processes or on a virtual clock."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

from swarm_ctl.commands.parse import Order, addressed
from swarm_ctl.commands.send import SentCommand
from swarm_ctl.core.model.messages import AgentStatus, Event
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.text import agents_named, ranges
from swarm_ctl.errors import SwarmError
from swarm_ctl.mission.compile.forecast import forecast, refuse_too_close
from swarm_ctl.mission.compile.loader import LoadedMission, dumps, load, loads
from swarm_ctl.mission.mission_file import MissionFile
from swarm_ctl.report.judge.summary import Summary
from swarm_ctl.runfolder.truth import Truth
from swarm_ctl.station.picture.view import SwarmView
from swarm_ctl.virtual.scenario import Scenario, load_scenario, scenario_of, scenario_text
from swarm_ctl.virtual.scenario_file import is_scenario, says_scenario
from swarm_ctl.virtual.scenario_flight import longest_s

Mission: TypeAlias = "str | Path | MissionFile | LoadedMission | Scenario"
"""A mission's or a scenario's file, its text (more than one line), or what is built in Python."""


def loaded(
    mission: Mission, beside: Path, seed: int | None = None
) -> tuple[LoadedMission, Scenario | None]:
    """The checked mission, and the scenario that it is flown in, with this seed if one is given; a
    file that is not in the working directory is looked for in `beside`. Raises MissionError with
    all mistakes, also with what `run` refuses to fly."""
    flown, scenario = _read(mission, beside)
    refuse_too_close(flown, forecast(flown.plan))
    if scenario is not None and seed is not None:
        scenario = scenario.model_copy(update={"seed": seed})
    return flown, scenario


def _read(mission: Mission, beside: Path) -> tuple[LoadedMission, Scenario | None]:
    if isinstance(mission, LoadedMission):
        return mission, None
    if isinstance(mission, MissionFile):
        return loads(dumps(mission)), None
    if isinstance(mission, Scenario):
        mission = scenario_text(mission)
    if isinstance(mission, str) and "\n" in mission:
        if says_scenario(mission.encode()):
            scenario, flown = scenario_of(mission, str(beside / "scenario.yaml"))
            return flown, scenario
        return loads(mission), None
    path = Path(mission if Path(mission).exists() else beside / mission)
    if is_scenario(path):
        scenario, flown = load_scenario(path)
        return flown, scenario
    return load(path), None


Named: TypeAlias = "int | str"
"""An agent by its id, or agents by words: `@scouts`, a group of the mission; `@1,3-5`."""


class FlightError(SwarmError, AssertionError):
    """A flight did not start, did not come as far as was waited for, or refused an order. In a test
    it is a failure."""


_ROUNDING_S: Final = 1e-6


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FlightResult:
    """How a flight went."""

    outcomes: dict[int, str]
    """By agent: `completed`, `failed`, `aborted`; an agent that left no account is missing."""
    closest_m: float
    """Smallest horizontal distance [m] of two vehicles in the air, by the truth where there is one;
    infinite for one."""
    all_down: bool
    """Every vehicle has touched down again, by the truth or by their agents' last words."""
    events: tuple[Event, ...]
    """What agents logged: each has `agent`, `time_s`, `level` and `text`."""
    summary: Summary | None = None
    """The verdict, its findings and figures, as in `summary.json`."""
    truth: Truth | None = None
    """The simulator's true positions and touch-downs; None for real vehicles."""
    folder: Path | None = None
    """The run folder, with the report; None on the virtual clock."""
    digest: str = ""
    """On the virtual clock: of every message, the truth and the verdict, in hexadecimal. The same
    flight with the same seed has the same."""

    def __repr__(self) -> str:
        """`<flight: agents 1-6 completed; closest 9.90 m; all down; run folder runs/...>`."""
        by: dict[str, list[int]] = {}
        for agent, outcome in self.outcomes.items():
            by.setdefault(outcome, []).append(agent)
        told = [f"{agents_named(ids)} {outcome}" for outcome, ids in by.items()]
        told += [f"closest {self.closest_m:.2f} m"] if self.closest_m < math.inf else []
        told += ["all down" if self.all_down else "not all down"]
        told += [f"run folder {self.folder}"] if self.folder is not None else []
        return f"<flight: {'; '.join(told)}>"

    @property
    def texts(self) -> str:
        """The texts of all events, a line each."""
        return "\n".join(event.text for event in self.events)


class SwarmFlight(ABC):
    """A mission in the air. Times are mission seconds, lengths metres.

    Orders wait for the agents' answers: `accepted` is whether all that were meant accepted,
    `reasons` says by agent why not, `silent` has those that did not answer.
    """

    def __init__(self, plan: Plan, scenario: Scenario | None = None) -> None:
        self.plan = plan
        """What is flown: `agents`, `steps`, `law`, ..."""
        self.scenario = scenario
        """What befalls it; None: nothing but what the test does."""
        self._observers: list[Callable[[SwarmFlight], None]] = []

    @property
    def bound_s(self) -> float:
        """How long the flight takes at most [s]: the sum of all its time-outs."""
        return longest_s(self.plan, self.scenario)

    def watch(self, observer: Callable[[SwarmFlight], None]) -> None:
        """Call `observer` with this flight after each `turn`, however the test waits."""
        self._observers.append(observer)

    def observed(self) -> None:
        """A turn is over."""
        for observer in self._observers:
            observer(self)

    @property
    @abstractmethod
    def up(self) -> tuple[int, ...]:
        """The agents that have not ended."""

    @property
    @abstractmethod
    def now(self) -> float:
        """Mission time [s]."""

    @property
    @abstractmethod
    def over(self) -> bool:
        """The flight has ended."""

    @abstractmethod
    def turn(self) -> None:
        """Let a moment go by: a tick in lockstep and on the virtual clock, else 20 ms."""

    @abstractmethod
    def reached(self, step: int, agents: Collection[int] = ()) -> bool:
        """Every agent that flies the mission, of these where some are named, is in this step or
        beyond; who has left the formation, or waits on the ground, is not waited for."""

    @abstractmethod
    def view(self) -> SwarmView:
        """The swarm now, as a ground station knows it; it has heard nothing before the first
        call."""

    def wait_step(self, step: int | str, within_s: float = 300.0, *, group: str = "") -> None:
        """Wait until every agent that flies the mission, or each of a group, is in this step or
        beyond: its number from 1 (0: preparing), or its name as on screens, `form vee`, of the
        group's steps the first of that name. FlightError when that takes longer, or when the flight
        ends before; ValueError when there is no such step, InputError when there is no such group.
        """
        __tracebackhide__ = True
        for _ in turns_to_step(self, step, within_s, group):
            pass

    def wait_s(self, seconds: float) -> None:
        """Let the swarm fly for so long, or to its end."""
        for _ in turns_for(self, seconds):
            pass

    @abstractmethod
    def give(self, order: Order) -> SentCommand:
        """Give an order without waiting for the answers: they come into what is returned while the
        flight goes on. Several orders may be given in one tick."""

    @abstractmethod
    def order(self, order: Order) -> SentCommand:
        """Give any operator's order, as `swarm-ctl send` builds it."""

    def command(self, kind: str, agents: Sequence[Named] = ()) -> SentCommand:
        """Order hold, resume, next, land, return or kill; `agents`: only these, by id or by group
        (`"@scouts"`)."""
        return self.order(self._to(kind, *agents))

    def form(self, shape: str, *, group: str = "") -> SentCommand:
        """Order a shape of the mission, of the whole swarm or of a group."""
        return self.order(self._to("form", group, words=(shape,)))

    def move(
        self,
        north_m: float,
        east_m: float,
        speed_mps: float | None = None,
        *,
        by: bool = False,
        group: str = "",
    ) -> SentCommand:
        """Order the centre of the formation, or of a group's, to a point, in metres from the
        origin; or by so much."""
        numbers = [north_m, east_m, *([] if speed_mps is None else [speed_mps])]
        return self.order(self._to("move", group, words=tuple(map(str, numbers)), by=by))

    def goto(
        self, north_m: float, east_m: float, *agents: Named, speed_mps: float | None = None
    ) -> SentCommand:
        """Order these agents alone to a point, in metres from the origin, the others without them;
        `command("resume", agents)` joins them again."""
        numbers = [north_m, east_m, *([] if speed_mps is None else [speed_mps])]
        return self.order(self._to("goto", *agents, words=tuple(map(str, numbers))))

    def follow(
        self,
        target: str,
        north_m: float = 0.0,
        east_m: float = 0.0,
        *,
        in_course: bool = False,
        group: str = "",
    ) -> SentCommand:
        """Order the formation, or a group's, to keep so far from a target of the mission;
        `in_course`: ahead of it, and to its right."""
        words = (target, str(north_m), str(east_m), *(["course"] if in_course else []))
        return self.order(self._to("follow", group, words=words))

    def _to(self, kind: str, *who: Named, words: tuple[str, ...] = (), by: bool = False) -> Order:
        """An order to these, or to all; ValueError lists the mission's agents, InputError its
        groups, where one of them is none."""
        __tracebackhide__ = True
        for agent in who:
            if isinstance(agent, int):
                self.known(agent)
        agents, groups = addressed((each for each in who if each != ""), self.plan)
        return Order(kind, words, agents, by, groups=groups)

    @abstractmethod
    def kill_agent(self, agent: int) -> None:
        """End the agent at once; its vehicle is left to its own failsafe."""

    @abstractmethod
    def freeze_agent(self, agent: int) -> None:
        """Stop the agent without ending it: it says and hears nothing."""

    @abstractmethod
    def thaw_agent(self, agent: int) -> None:
        """Let a frozen agent work again."""

    @abstractmethod
    def kill_station(self) -> None:
        """End the ground station at once."""

    @abstractmethod
    def events(self) -> Sequence[Event]:
        """What agents have logged so far."""

    @abstractmethod
    def statuses(self) -> Mapping[int, AgentStatus]:
        """The last that is known of each agent, by id: its phase, its steps, its figures."""

    @property
    @abstractmethod
    def where(self) -> str:
        """Where the flight can be looked at: run folder and report."""

    @abstractmethod
    def finish(self, within_s: float | None = None) -> FlightResult:
        """Fly to the end; FlightError when that takes longer than so many seconds, or than
        `bound_s`."""

    @abstractmethod
    def land(self) -> None:
        """Land all agents where they are, and wait for it; nothing, where the flight is over."""

    @abstractmethod
    def close(self) -> None:
        """End all processes of the flight, in any state; the fixture calls it."""

    def known(self, agent: int) -> int:
        """The id; ValueError lists the mission's where it has no such agent."""
        __tracebackhide__ = True
        ids = [each.id for each in self.plan.agents]
        if agent not in ids:
            raise ValueError(f"no agent {agent}; allowed: {ranges(ids)}")
        return agent

    def members(self, group: str) -> tuple[int, ...]:
        """The agents of a group, `@scouts`; () of all. InputError lists the groups."""
        agents, names = addressed([group] if group else [], self.plan)
        flown = {i for each in self.plan.groups if each.name in names for i in each.ids}
        named = {i for each in self.plan.named if each.name in names for i in each.ids}
        return tuple(sorted(flown | named | {*agents}))

    def step_number(self, step: int | str, group: str = "") -> int:
        """The number of the first step of this name, in all or in a group; ValueError lists the
        names."""
        __tracebackhide__ = True
        _, whose = addressed([group] if group else [], self.plan)
        members = {*self.members(group)}
        own = [each for each in self.plan.groups if each.name in whose]
        groups = [*own, *(each for each in self.plan.groups if each.members >= members)]
        told = [(each.step_name(k), k) for each in groups for k in each.told_steps]
        names, last = dict(reversed(told)), self.plan.last_step
        if step not in (*names, *range(last + 1)):
            numbers = f"0 to {last}, or {', '.join(dict.fromkeys(name for name, _ in told))}"
            raise ValueError(f"no step {step!r}; allowed: {numbers}")
        return step if isinstance(step, int) else names[step]


def turn_before(flight: SwarmFlight, end_s: float, why: str) -> None:
    """Let a moment go by; FlightError with `why` where it is past `end_s`, or the flight is
    over."""
    __tracebackhide__ = True
    if flight.over:
        raise FlightError(f"{why}: the flight is over; {flight.where}")
    if flight.now > end_s:
        raise FlightError(f"{why}; {flight.where}")
    flight.turn()


def turns_to_step(
    flight: SwarmFlight, step: int | str, within_s: float, group: str
) -> Iterator[None]:
    """The turns of `wait_step`."""
    __tracebackhide__ = True
    number, end = flight.step_number(step, group), flight.now + within_s
    agents = flight.members(group)
    while not flight.reached(number, agents):
        turn_before(flight, end, f"step {step!r} was not reached within {within_s:g} s")
        yield


def turns_for(flight: SwarmFlight, seconds: float) -> Iterator[None]:
    """The turns of so long, or to the flight's end."""
    until = flight.now + seconds
    while flight.now < until - _ROUNDING_S and not flight.over:
        flight.turn()
        yield
