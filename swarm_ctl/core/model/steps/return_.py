"""Home, all at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from swarm_ctl.core.model.policies import Policy
from swarm_ctl.core.model.steps.step import Step


@dataclass(frozen=True, slots=True)
class ReturnStep(Step):
    """All at once, in layers of height, back to the own start; land there, disarm."""

    timeout_s: float
    on_timeout: Policy = Policy.LAND
    kind: Literal["return"] = "return"

    flies_formation: ClassVar[bool] = False
    goes_home: ClassVar[bool] = True
