"""One interface to a flight under test, with real processes or on a virtual clock."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

from swarm_ctl.commands.parse import Order
from swarm_ctl.commands.send import SentCommand
from swarm_ctl.core.agent.progress import step_name
from swarm_ctl.core.model.messages import AgentStatus, Event
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.text import agents_named, ranges
from swarm_ctl.errors import SwarmError
from swarm_ctl.mission.compile.loader import LoadedMission, dumps, load, loads
from swarm_ctl.mission.sections.mission_file import MissionFile
from swarm_ctl.report.folder.truth import Truth
from swarm_ctl.report.judge.summary import Summary
from swarm_ctl.station.picture.view import SwarmView

Mission: TypeAlias = "str | Path | MissionFile | LoadedMission"
"""A file, its text (more than one line), or what is built in Python."""


def loaded(mission: Mission, beside: Path) -> LoadedMission:
    """The checked mission; a file that is not in the working directory is looked for in `beside`.
    Raises MissionError with all mistakes."""
    if isinstance(mission, LoadedMission):
        return mission
    if isinstance(mission, MissionFile):
        return loads(dumps(mission))
    if isinstance(mission, str) and "\n" in mission:
        return loads(mission)
    return load(mission if Path(mission).exists() else beside / mission)


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
    """The figures of `summary.json`; None on the virtual clock."""
    truth: Truth | None = None
    """The simulator's true positions and touch-downs; None on the virtual clock, and for real
    vehicles."""
    folder: Path | None = None
    """The run folder, with the report; None on the virtual clock."""

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

    plan: Plan
    """What is flown: `agents`, `steps`, `law`, ..."""

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
    def reached(self, step: int) -> bool:
        """Every live agent is in this step or beyond."""

    @abstractmethod
    def view(self) -> SwarmView:
        """The swarm now, as a ground station knows it; it has heard nothing before the first
        call."""

    def wait_step(self, step: int | str, within_s: float = 300.0) -> None:
        """Wait until every live agent is in this step or beyond: its number from 1 (0: preparing),
        or its name as on screens, `form vee`. FlightError when that takes longer, or when the
        flight ends before; ValueError when there is no such step.
        """
        __tracebackhide__ = True
        number, until = self.step_number(step), self.now + within_s
        while not self.reached(number):
            if self.now > until or self.over:
                raise FlightError(
                    f"step {step!r} was not reached within {within_s:g} s; {self.where}"
                )
            self.turn()

    def wait_s(self, seconds: float) -> None:
        """Let the swarm fly for so long, or to its end."""
        until = self.now + seconds
        while self.now < until - _ROUNDING_S and not self.over:
            self.turn()

    @abstractmethod
    def order(self, order: Order) -> SentCommand:
        """Give any operator's order, as `swarm-ctl send` builds it."""

    def command(self, kind: str, agents: Sequence[int] = ()) -> SentCommand:
        """Order hold, resume, next, land, return or kill; `agents`: only these."""
        return self.order(Order(kind, (), tuple(agents)))

    def form(self, shape: str) -> SentCommand:
        """Order a shape of the mission."""
        return self.order(Order("form", (shape,)))

    def move(self, north_m: float, east_m: float, speed_mps: float | None = None) -> SentCommand:
        """Order the formation's centre to a point, in metres from the origin."""
        speed = [] if speed_mps is None else [speed_mps]
        return self.order(Order("move", tuple(map(str, [north_m, east_m, *speed]))))

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
    def finish(self, within_s: float = 900.0) -> FlightResult:
        """Fly to the end; FlightError when that takes longer."""

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

    def step_number(self, step: int | str) -> int:
        """The number of the first step of this name; ValueError lists the names."""
        __tracebackhide__ = True
        names = [step_name(self.plan, k) for k in range(len(self.plan.steps) + 1)]
        if step not in (*names, *range(len(names))):
            numbers = f"0 to {len(names) - 1}, or {', '.join(dict.fromkeys(names))}"
            raise ValueError(f"no step {step!r}; allowed: {numbers}")
        return step if isinstance(step, int) else names.index(step)
