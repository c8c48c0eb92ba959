"""`takeoff`."""

from __future__ import annotations

from typing import ClassVar, Final

from pydantic import Field

from swarm_ctl.core.model.autopilots import UpAndDown
from swarm_ctl.core.model.plan import Plan, PlannedStep
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.takeoff import TakeoffStep
from swarm_ctl.mission.input.document import Findings, Mistake, Place
from swarm_ctl.mission.sections.section import Timeout
from swarm_ctl.mission.steps.step_kind import Mission, StepKind, TimedSection

_SPOOL_UP_S: Final = 30.0


class TakeoffSection(TimedSection):
    """Set the autopilot's mode, arm and climb. Who is not up in time never goes on: it lands."""

    height_m: float = Field(ge=1, le=120)
    """Above each vehicle's own take-off point."""
    timeout_s: Timeout | None = None
    """Default: 30 s more than twice the climb at vehicle.limits.climb_mps."""

    @property
    def climbs_to_m(self) -> float | None:
        return self.height_m


class Takeoff(StepKind[TakeoffSection, TakeoffStep]):
    """Up: the first step of each mission."""

    section = TakeoffSection
    opens: ClassVar[bool] = True

    def planned(
        self, written: TakeoffSection, mission: Mission, before: PlannedFormation
    ) -> TakeoffStep:
        generous_s = _SPOOL_UP_S + 2 * self.needed_s(written, mission)
        return TakeoffStep(written.height_m, written.timeout_s or generous_s, written.on_timeout)

    def words(self, step: TakeoffStep, plan: Plan) -> str:
        return f"takeoff to {step.height_m:g} m"

    def needed_s(self, written: TakeoffSection, mission: Mission) -> float:
        return written.height_m / mission.vehicle.limits.planned().climb_mps

    def least_s(self, step: TakeoffStep, at: PlannedStep) -> float:
        return step.height_m / at.plan.limits.climb_mps

    def expected_s(self, step: TakeoffStep, at: PlannedStep, autopilot: UpAndDown) -> float:
        """The autopilot's own climb."""
        return autopilot.arm_s + step.height_m / autopilot.climb_mps

    def wrong(self, step: TakeoffStep, at: PlannedStep, place: Place, mission: Mission) -> Findings:
        """The geofence has a ceiling."""
        if at.plan.fence is not None and step.height_m > at.plan.fence.height_m:
            what = f"{step.height_m:g} m is above the geofence"
            allowed = f"at most fence.height_m = {at.plan.fence.height_m:g}"
            yield Mistake((*place, "height_m"), what, allowed)
