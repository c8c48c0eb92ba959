"""One interface to a flight under test, whether its swarm is made of processes or flies on a
virtual clock."""

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
    """Whatever a test has, as a checked mission."""
    if isinstance(mission, LoadedMission):
        return mission
    if isinstance(mission, MissionFile):
        return loads(dumps(mission))
    return loads(mission) if isinstance(mission, str) and "\n" in mission else load(mission)


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """How a flight went."""

    outcomes: dict[int, str]
    """By agent: `completed`, `failed`, `aborted`; agents that left no account are missing."""
    closest_m: float
    """Smallest true horizontal distance of any two vehicles in the air; infinite for one
    vehicle."""
    all_down: bool
    """Every vehicle has touched down again."""
    events: tuple[Event, ...]
    summary: Summary | None = None
    """With real processes only, as are the next two."""
    truth: Truth | None = None
    folder: Path | None = None

    @property
    def texts(self) -> str:
        """All events, a line each."""
        return "\n".join(event.text for event in self.events)


class Flight(ABC):
    """A mission in the air. Times are mission seconds."""

    plan: Plan

    @abstractmethod
    def wait_step(self, step: int | str, within_s: float = 300.0) -> None:
        """Until every live agent is in this step (its number, or its name as screens show it: `form
        vee`) or beyond.

        AssertionError when that takes longer, or when the flight ends before.
        """

    @abstractmethod
    def wait_s(self, seconds: float) -> None:
        """Let it fly for so long."""

    @abstractmethod
    def order(self, order: Order) -> SentCommand:
        """Give an operator's order, and wait for the answers."""

    def command(self, kind: str, agents: Sequence[int] = ()) -> SentCommand:
        """An operator's hold, resume, next, land, return or kill; waits for the answers."""
        return self.order(Order(kind, (), tuple(agents)))

    def form(self, shape: str) -> SentCommand:
        """The operator commands a shape of the mission."""
        return self.order(Order("form", (shape,)))

    def move(self, north_m: float, east_m: float, speed_mps: float | None = None) -> SentCommand:
        """The operator sends the formation's centre to a point of the common frame."""
        speed = [] if speed_mps is None else [speed_mps]
        return self.order(Order("move", tuple(map(str, [north_m, east_m, *speed]))))

    @abstractmethod
    def kill_agent(self, agent: int) -> None:
        """The agent's process is gone at once; its vehicle is left to itself."""

    @abstractmethod
    def freeze_agent(self, agent: int) -> None:
        """The agent's process stops working without ending."""

    @abstractmethod
    def thaw_agent(self, agent: int) -> None:
        """It works again."""

    @abstractmethod
    def kill_station(self) -> None:
        """No ground station any more."""

    @abstractmethod
    def finish(self, within_s: float = 900.0) -> Flown:
        """Fly on to the end, and tell how it went."""

    @abstractmethod
    def close(self) -> None:
        """Leave nothing behind, whatever the state (the fixture does this)."""

    def step_number(self, step: int | str) -> int:
        """`form vee` as the number of the first step of that name."""
        if isinstance(step, int):
            return step
        names = [step_name(self.plan, k) for k in range(len(self.plan.steps) + 1)]
        if step not in names:
            raise ValueError(f"no step {step!r}; allowed: {', '.join(names)}")
        return names.index(step)
