"""Up: the first step of each mission."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.policies import Policy
from swarm_ctl.core.model.steps.step import Step


@dataclass(frozen=True, slots=True)
class TakeoffStep(Step):
    """Set the mode, arm, climb to `height_m` above the vehicle's own take-off point."""

    height_m: float
    timeout_s: float
    on_timeout: Policy = Policy.LAND
    kind: Literal["takeoff"] = "takeoff"

    flies_formation: ClassVar[bool] = False

    @property
    def climbs_to_m(self) -> float | None:
        return self.height_m

    def after(self, formation: PlannedFormation) -> PlannedFormation:
        return replace(formation, height_m=self.height_m)
