"""The formation as it is, for a while."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from swarm_ctl.core.model.policies import Policy
from swarm_ctl.core.model.steps.step import Step


@dataclass(frozen=True, slots=True)
class HoldStep(Step):
    """Keep the last formation for `duration_s`."""

    duration_s: float
    timeout_s: float
    on_timeout: Policy = Policy.LAND
    kind: Literal["hold"] = "hold"

    @property
    def lasts_s(self) -> float | None:
        return self.duration_s
