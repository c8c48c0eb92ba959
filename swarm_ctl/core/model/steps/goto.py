"""Each of some agents to a place of its own, by an operator's order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.policies import Policy
from swarm_ctl.core.model.steps.step import Step


@dataclass(frozen=True, slots=True)
class GotoStep(Step):
    """Fly there and stay, until the operator commands to join the others again."""

    flies_formation: ClassVar[bool] = False

    places_m: tuple[tuple[int, Point], ...]
    """(agent, its place), in the common frame."""
    speed_mps: float
    timeout_s: float
    on_timeout: Policy = Policy.LAND
    kind: Literal["goto"] = "goto"

    def place_m(self, agent: int) -> Point | None:
        """Where this agent is sent; None: it is not meant."""
        return dict(self.places_m).get(agent)

    @property
    def sends(self) -> GotoStep | None:
        return self
