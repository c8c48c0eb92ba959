"""What each kind of step says of itself in a mission file and in forecasts, so that no other module
asks which kind it is. What agents fly of it is in `core/model/steps/`, under the same name."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeAlias, TypeVar

from swarm_ctl.core.model.autopilots import UpAndDown
from swarm_ctl.core.model.plan import Plan, PlannedStep, Point, Policy
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.step import Step
from swarm_ctl.mission.input.document import Findings, Place
from swarm_ctl.mission.sections.section import Action, Section

if TYPE_CHECKING:
    from swarm_ctl.mission.mission_file import MissionFile

    Mission: TypeAlias = MissionFile
else:
    Mission = Any


class StepSection(Section):
    """One step as it is written; `timeout_s` is each kind's own."""

    @property
    def climbs_to_m(self) -> float | None:
        """The height of a take-off; None: it is none."""
        return None

    @property
    def shape_formed(self) -> str | None:
        """The name of the shape that it forms."""
        return None


class TimedSection(StepSection):
    """A step that may go on to the next one when its time is over."""

    on_timeout: Action = Policy.LAND
    """What to do after `timeout_s`: land, return, hold, or continue with the next step."""


S = TypeVar("S", bound=StepSection)
P = TypeVar("P", bound=Step)


Checks: TypeAlias = tuple[tuple[str, Callable[[Any, Place, Mission], Findings]], ...]
"""Each check of a step as it is written, and the other sections of the file that it reads."""


class StepKind(ABC, Generic[S, P]):
    """One kind of step; the defaults are those of a step that nothing can be wrong with."""

    section: type[S]
    """Its fields in a mission file."""
    opens: ClassVar[bool] = False
    """It is the first step, and no other."""
    ends: ClassVar[bool] = False
    """It is the last step, and no other; it needs no field."""
    keeps_formation: ClassVar[bool] = False
    """It needs a formation that was formed."""
    checks: ClassVar[Checks] = ()
    """What one field alone cannot tell."""

    @abstractmethod
    def planned(self, written: S, mission: Mission, before: PlannedFormation) -> P:
        """The step of the plan; lengths in units."""

    def needed_s(self, written: S, mission: Mission) -> float:
        """No time-out may be shorter, by the file alone."""
        return 0.0

    def doubtful(self, written: S, place: Place) -> Findings:
        """What may be a slip."""
        yield from ()

    def wrong(self, step: P, at: PlannedStep, place: Place, mission: Mission) -> Findings:
        """What shows only in the plan."""
        yield from ()

    def words(self, step: P, plan: Plan) -> str:
        """What it does, for `validate`."""
        return step.title

    def ways_m(self, step: P, at: PlannedStep) -> list[tuple[Point, ...]]:
        """The way of each agent, as corners in the common frame; empty: all stay."""
        return step.ways_m(at.before)

    def least_s(self, step: P, at: PlannedStep) -> float:
        """How long it takes at its speed; a form step settles, a landing takes nothing."""
        return step.lasts_s or (step.settling.settle_s if step.settling else 0.0)

    def expected_s(self, step: P, at: PlannedStep, autopilot: UpAndDown) -> float:
        """How long it takes as vehicles fly it."""
        return self.least_s(step, at)


AnyKind: TypeAlias = StepKind[Any, Any]
