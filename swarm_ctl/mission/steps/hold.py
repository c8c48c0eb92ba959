"""`hold`."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.hold import HoldStep
from swarm_ctl.mission.steps.step_kind import Mission, StepKind, TimedSection


class HoldSection(TimedSection):
    """Keep the formation for a while."""

    duration_s: float = Field(gt=0, le=3600)
    timeout_s: Annotated[float, Field(gt=0, le=7200)] | None = None
    """Default: 30 s more than the duration."""


class Hold(StepKind[HoldSection, HoldStep]):
    """The formation as it is, for a while."""

    section = HoldSection
    keeps_formation: ClassVar[bool] = True

    def planned(self, written: HoldSection, mission: Mission, before: PlannedFormation) -> HoldStep:
        timeout_s = written.timeout_s or written.duration_s + 30
        return HoldStep(written.duration_s, timeout_s, written.on_timeout)

    def needed_s(self, written: HoldSection, mission: Mission) -> float:
        return written.duration_s
