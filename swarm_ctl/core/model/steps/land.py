"""Down, where each vehicle is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from swarm_ctl.core.model.policies import Policy
from swarm_ctl.core.model.steps.step import Step


@dataclass(frozen=True, slots=True)
class LandStep(Step):
    """Stop, land in place, disarm."""

    timeout_s: float
    on_timeout: Policy = Policy.LAND
    kind: Literal["land"] = "land"

    flies_formation: ClassVar[bool] = False
    lands_in_place: ClassVar[bool] = True
