"""The formation wider or narrower."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

from swarm_ctl.core.model.planned_formation import STILL, Frame, Motion, PlannedFormation
from swarm_ctl.core.model.policies import Policy
from swarm_ctl.core.model.steps.step import Path, between, strayed


@dataclass(frozen=True, slots=True)
class ScaleStep(Path):
    """Widen or narrow the formation to `factor` times its last form step's slots; `speed_mps` is
    the outermost's."""

    factor: float
    speed_mps: float
    tolerance_m: float
    settle_s: float
    timeout_s: float
    on_timeout: Policy = Policy.LAND
    kind: Literal["scale"] = "scale"

    spins: ClassVar[bool] = True

    def after(self, formation: PlannedFormation) -> PlannedFormation:
        return replace(formation, scale=self.factor)

    def poses(self, before: PlannedFormation) -> list[PlannedFormation]:
        """Both ends: each agent goes straight."""
        return [before, self.after(before)]

    def legs_m(self, before: PlannedFormation) -> list[float]:
        return [abs(self.factor / before.scale - 1.0) * before.radius_m]

    def left_m(self, frame: Frame, radius_m: float) -> float:
        return abs(self.factor - frame.scale) * radius_m

    def _moved(self, frame: Frame, share: float) -> Frame:
        return replace(frame, scale=frame.scale + share * (self.factor - frame.scale))

    def _motion(self, frame: Frame, speed_mps: float, radius_m: float) -> Motion:
        if frame.scale <= 0.0:
            return STILL
        grow = math.copysign(speed_mps / (radius_m * frame.scale), self.factor - frame.scale)
        return Motion(spin=complex(grow, 0.0))

    def along(self, start: Frame, frame: Frame, radius_m: float) -> tuple[float, float]:
        apart_m, turned_m, _ = strayed(start, frame, radius_m)
        at = between(start.scale, frame.scale, self.factor)
        beside = abs(frame.scale - at) * radius_m
        return abs(at - start.scale) * radius_m, beside + apart_m + turned_m
