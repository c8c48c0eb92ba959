"""`land`."""

from __future__ import annotations

import math
from typing import ClassVar, Final

from swarm_ctl.core.law.formation import smallest_distance
from swarm_ctl.core.model.autopilots import UpAndDown
from swarm_ctl.core.model.plan import PlannedStep
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.land import LandStep
from swarm_ctl.mission.input.document import ROUNDING, Findings, Mistake, Place
from swarm_ctl.mission.input.units import said
from swarm_ctl.mission.sections.section import Timeout
from swarm_ctl.mission.steps.step_kind import Mission, StepKind, StepSection

_DISARM_S: Final = 60.0
_TOUCHDOWN_MPS: Final = 0.5
"""Autopilots touch down at this speed or less, whatever the descent before."""
_DOWN_MPS: Final = 1.5
"""No firmware as delivered comes down faster (WPNAV_SPEED_DN, MPC_Z_V_AUTO_DN)."""


class LandSection(StepSection):
    """Stop, land in place and disarm."""

    timeout_s: Timeout | None = None
    """Default: long enough for the height."""


class Land(StepKind[LandSection, LandStep]):
    """Down, where each vehicle is."""

    section = LandSection
    ends: ClassVar[bool] = True

    def planned(self, written: LandSection, mission: Mission, before: PlannedFormation) -> LandStep:
        return LandStep(written.timeout_s or generous_s(mission, before))

    def needed_s(self, written: LandSection, mission: Mission) -> float:
        return fastest_s(mission)

    def expected_s(self, step: LandStep, at: PlannedStep, autopilot: UpAndDown) -> float:
        """The autopilot's own landing."""
        return autopilot.landing_s(max(at.before.heights_m))

    def wrong(self, step: LandStep, at: PlannedStep, place: Place, mission: Mission) -> Findings:
        """None comes down through another one."""
        plan, before = at.plan, at.before
        apart = smallest_distance(before.offsets) if before.ups_m else math.inf
        if apart <= plan.law.r_out + ROUNDING:
            what = f"agents above each other would land {said(apart * plan.unit_m, mission)} apart"
            least = said(plan.law.r_out * plan.unit_m, mission)
            allowed = f"a form step before it with slots more than law.r_out = {least} apart"
            yield Mistake(place, what, allowed)


def generous_s(mission: Mission, before: PlannedFormation) -> float:
    """More than any landing takes."""
    slowest_mps = min(mission.vehicle.limits.planned().descent_mps, _TOUCHDOWN_MPS)
    return _DISARM_S + 1.5 * max(before.heights_m) / slowest_mps


def fastest_s(mission: Mission) -> float:
    """Less than any landing takes."""
    first = mission.steps[0].body
    return ((first and first.climbs_to_m) or 0.0) / _DOWN_MPS
