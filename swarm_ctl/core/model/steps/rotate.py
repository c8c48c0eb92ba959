"""The formation about its centre."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Final, Literal

from swarm_ctl.core.model.planned_formation import STILL, Frame, Motion, PlannedFormation
from swarm_ctl.core.model.policies import Policy
from swarm_ctl.core.model.steps.step import Path, between, strayed

_CHORD_RAD: Final = math.radians(5.0)
"""An arc is at most a thousandth of its radius outside of such a chord."""


@dataclass(frozen=True, slots=True)
class RotateStep(Path):
    """Turn the formation about its centre to `angle_rad` from its last form step's slots (clockwise
    from above).

    `speed_mps` is the outermost slot's.
    """

    angle_rad: float
    speed_mps: float
    tolerance_m: float
    settle_s: float
    timeout_s: float
    on_timeout: Policy = Policy.LAND
    kind: Literal["rotate"] = "rotate"

    spins: ClassVar[bool] = True

    def after(self, formation: PlannedFormation) -> PlannedFormation:
        return replace(formation, angle_rad=self.angle_rad)

    def poses(self, before: PlannedFormation) -> list[PlannedFormation]:
        """By chords of 5 degrees at most."""
        turn = self.angle_rad - before.angle_rad
        count = max(1, math.ceil(abs(turn) / _CHORD_RAD))
        return [
            replace(before, angle_rad=before.angle_rad + turn * k / count) for k in range(count + 1)
        ]

    def legs_m(self, before: PlannedFormation) -> list[float]:
        return [abs(self.angle_rad - before.angle_rad) * before.radius_m]

    def left_m(self, frame: Frame, radius_m: float) -> float:
        return abs(self.angle_rad - frame.angle_rad) * radius_m * frame.scale

    def _moved(self, frame: Frame, share: float) -> Frame:
        angle_rad = frame.angle_rad + share * (self.angle_rad - frame.angle_rad)
        return replace(frame, angle_rad=angle_rad)

    def _motion(self, frame: Frame, speed_mps: float, radius_m: float) -> Motion:
        if frame.scale <= 0.0:
            return STILL
        turn = math.copysign(speed_mps / (radius_m * frame.scale), self.angle_rad - frame.angle_rad)
        return Motion(spin=complex(0.0, turn))

    def along(self, start: Frame, frame: Frame, radius_m: float) -> tuple[float, float]:
        apart_m, _, grown_m = strayed(start, frame, radius_m)
        at = between(start.angle_rad, frame.angle_rad, self.angle_rad)
        beside = abs(frame.angle_rad - at) * radius_m * start.scale
        return abs(at - start.angle_rad) * radius_m * start.scale, beside + apart_m + grown_m
