"""One interface to a flight under test, with real processes or on a virtual clock."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from swarm_ctl.commands.parse import Order
from swarm_ctl.commands.send import SentCommand
from swarm_ctl.core.agent.progress import step_name
from swarm_ctl.core.model.messages import Event
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.mission.compile.loader import LoadedMission, dumps, load, loads
from swarm_ctl.mission.input.schema import MissionFile
from swarm_ctl.report.folder.truth import Truth
from swarm_ctl.report.judge.summary import Summary

Mission: TypeAlias = "str | Path | MissionFile | LoadedMission"
"""A file, its text (more than one line), or what is built in Python."""


def loaded(mission: Mission) -> LoadedMission:
    """The checked mission. Raises MissionError with all mistakes."""
    if isinstance(mission, LoadedMission):
        return mission
    if isinstance(mission, MissionFile):
        return loads(dumps(mission))
    return loads(mission) if isinstance(mission, str) and "\n" in mission else load(mission)


@dataclass(frozen=True, slots=True, eq=False)
class FlightResult:
    """How a flight went. Summary, truth and folder are those of a flight with processes."""

    outcomes: dict[int, str]
    """By agent: `completed`, `failed`, `aborted`; an agent that left no account is missing."""
    closest_m: float
    """Smallest horizontal distance [m] of two vehicles in the air, by the truth where there is one;
    infinite for one."""
    all_down: bool
    """Every vehicle has touched down again, by the truth or by their agents' last words."""
    events: tuple[Event, ...]
    summary: Summary | None = None
    truth: Truth | None = None
    folder: Path | None = None

    @property
    def texts(self) -> str:
        """All events, a line each."""
        return "\n".join(event.text for event in self.events)


class SwarmFlight(ABC):
    """A mission in the air. Times are mission seconds."""

    plan: Plan

    @abstractmethod
    def wait_step(self, step: int | str, within_s: float = 300.0) -> None:
        """Until every live agent is in this step (number, or name as on screens: `form vee`) or
        beyond; AssertionError when that takes longer, or when the flight ends before.
        """

    @abstractmethod
    def wait_s(self, seconds: float) -> None:
        """Let the swarm fly for so long."""

    @abstractmethod
    def order(self, order: Order) -> SentCommand:
        """Give an operator's order, and wait for the agents' answers."""

    def command(self, kind: str, agents: Sequence[int] = ()) -> SentCommand:
        """Order hold, resume, next, land, return or kill."""
        return self.order(Order(kind, (), tuple(agents)))

    def form(self, shape: str) -> SentCommand:
        """Order a shape of the mission."""
        return self.order(Order("form", (shape,)))

    def move(self, north_m: float, east_m: float, speed_mps: float | None = None) -> SentCommand:
        """Order the formation's centre to a point of the common frame."""
        speed = [] if speed_mps is None else [speed_mps]
        return self.order(Order("move", tuple(map(str, [north_m, east_m, *speed]))))

    @abstractmethod
    def kill_agent(self, agent: int) -> None:
        """End the agent's process at once; its vehicle flies on without it."""

    @abstractmethod
    def freeze_agent(self, agent: int) -> None:
        """Stop the agent's process without ending it."""

    @abstractmethod
    def thaw_agent(self, agent: int) -> None:
        """Let a frozen agent work again."""

    @abstractmethod
    def kill_station(self) -> None:
        """End the ground station's process at once."""

    @abstractmethod
    def finish(self, within_s: float = 900.0) -> FlightResult:
        """Fly to the end."""

    @abstractmethod
    def close(self) -> None:
        """End all processes of the flight, in any state; the fixture calls it."""

    def step_number(self, step: int | str) -> int:
        """The number of the first step of this name; ValueError lists the names."""
        if isinstance(step, int):
            return step
        names = [step_name(self.plan, k) for k in range(len(self.plan.steps) + 1)]
        if step not in names:
            raise ValueError(f"no step {step!r}; allowed: {', '.join(names)}")
        return names.index(step)
