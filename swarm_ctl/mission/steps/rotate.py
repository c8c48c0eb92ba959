"""`rotate`."""

from __future__ import annotations

import math
from typing import Final

from pydantic import Field

from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.rotate import RotateStep
from swarm_ctl.mission.input.document import Findings, Mistake, Place
from swarm_ctl.mission.steps.step_kind import Mission
from swarm_ctl.mission.steps.travel import Pace, Travel, TravelSection

_RADIANS: Final = 0.02
"""So near, in twelfths of pi, an angle in degrees looks like one in radians."""


class RotateSection(TravelSection):
    """Turn the formation about its centre and keep the shape."""

    angle_deg: float = Field(ge=-3600, le=3600)
    """Clockwise as seen from above."""


class Rotate(Travel[RotateSection, RotateStep]):
    """The formation about its centre."""

    section = RotateSection

    def led(
        self, written: RotateSection, mission: Mission, before: PlannedFormation, pace: Pace
    ) -> RotateStep:
        return RotateStep(before.angle_rad + math.radians(written.angle_deg), *pace)

    def words(self, step: RotateStep, plan: Plan) -> str:
        return f"rotate to {math.degrees(step.angle_rad):g} degrees at {step.speed_mps:g} m/s"

    def doubtful(self, written: RotateSection, place: Place) -> Findings:
        """Radians."""
        angle = written.angle_deg
        twelfths = abs(angle) / math.pi * 12
        if 0.5 < twelfths < 24.5 and abs(twelfths - round(twelfths)) < _RADIANS:
            what = f"{angle:g} degrees; if radians were meant: {math.degrees(angle):.0f}"
            yield Mistake((*place, "angle_deg"), what, "")
