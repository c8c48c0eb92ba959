"""Where groups wait for each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from swarm_ctl.core.model.policies import Policy
from swarm_ctl.core.model.steps.step import Step

JOIN: Final = "join "


@dataclass(frozen=True, slots=True)
class BarrierStep(Step):
    """Keep the formation until all groups that have a barrier of this name have come to it
    (`core/model/route.py`)."""

    name: str
    """Of one at which groups join: `join 1`, which no mission file can name."""
    timeout_s: float
    on_timeout: Policy = Policy.LAND
    kind: Literal["barrier"] = "barrier"

    @property
    def title(self) -> str:
        return self.name if self.joins else f"{self.kind} {self.name}"

    @property
    def joins(self) -> bool:
        """The groups are one after it."""
        return self.name.startswith(JOIN)

    @property
    def barrier(self) -> str:
        return self.name

    @property
    def lasts_s(self) -> float | None:
        return 0.0
