"""Into a shape, by the law alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.policies import Policy
from swarm_ctl.core.model.steps.step import Settling, Step


@dataclass(frozen=True, slots=True)
class FormStep(Step):
    """Fly the law until the largest |e_i - mean e| stays under `tolerance_m` for `settle_s`.

    `slots` has one (north, east) offset in units per agent, in the order of the group's.
    """

    shape: str
    slots: tuple[Point, ...]
    tolerance_m: float
    settle_s: float
    timeout_s: float
    neighbours: tuple[tuple[int, ...], ...] | None = None
    """N_i from this step on, in the order of the group's agents; None: as before."""
    on_timeout: Policy = Policy.LAND
    exchange: bool = False
    """Agents that are in each other's way may take each other's slots
    (`core/kernel/exchange.py`)."""
    ups_m: tuple[float, ...] = ()
    """How far above the flight height each slot is, in the slots' order; (): all are at it."""
    closed: tuple[tuple[Point, ...], ...] = ()
    """The shape of one agent less, of two less, and so on: what those that are left fly to where
    some leave or are lost. (): their slots stay free."""
    kind: Literal["form"] = "form"

    @property
    def title(self) -> str:
        return f"{self.kind} {self.shape}"

    @property
    def new_shape(self) -> FormStep | None:
        return self

    @property
    def exchanges(self) -> bool:
        return self.exchange

    @property
    def settling(self) -> Settling | None:
        return Settling(self.tolerance_m, self.settle_s)

    def after(self, formation: PlannedFormation) -> PlannedFormation:
        formed = replace(formation, slots=self.slots, angle_rad=0.0, scale=1.0, formed=True)
        return replace(formed, ups_m=self.ups_m)

    def poses(self, before: PlannedFormation) -> list[PlannedFormation]:
        """Where the shape will stand: the way there is the law's."""
        return [self.after(before)]
