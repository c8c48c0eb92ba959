"""`scale`."""

from __future__ import annotations

from pydantic import Field

from swarm_ctl.core.law.formation import smallest_distance
from swarm_ctl.core.model.plan import Plan, PlannedStep
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.scale import ScaleStep
from swarm_ctl.mission.input.document import ROUNDING, Findings, Mistake, Place
from swarm_ctl.mission.input.units import enough, said
from swarm_ctl.mission.steps.step_kind import Mission
from swarm_ctl.mission.steps.travel import Pace, Travel, TravelSection


class ScaleSection(TravelSection):
    """Widen or narrow the formation about its centre."""

    factor: float = Field(ge=0.05, le=20)
    """Relative to the shape's present size."""


class Scale(Travel[ScaleSection, ScaleStep]):
    """The formation wider or narrower."""

    section = ScaleSection

    def led(
        self, written: ScaleSection, mission: Mission, before: PlannedFormation, pace: Pace
    ) -> ScaleStep:
        return ScaleStep(before.scale * written.factor, *pace)

    def words(self, step: ScaleStep, plan: Plan) -> str:
        return f"scale to {step.factor:g} at {step.speed_mps:g} m/s"

    def wrong(self, step: ScaleStep, at: PlannedStep, place: Place, mission: Mission) -> Findings:
        """No two slots come too close."""
        plan = at.plan
        r_out, apart = (
            plan.law.r_out,
            smallest_distance(step.after(at.before).offsets, at.before.ups_m, plan.slot_layer_m),
        )
        if apart <= r_out + ROUNDING:
            narrowing = step.factor / at.before.scale
            what = f"{narrowing:g} brings slots to {said(apart * plan.unit_m, mission)}"
            wide = f"above {enough(narrowing * r_out / apart)}"
            least = said(r_out * plan.unit_m, mission)
            allowed = f"{wide}: more than law.r_out = {least} between slots"
            yield Mistake((*place, "factor"), what, allowed)
        yield from super().wrong(step, at, place, mission)
