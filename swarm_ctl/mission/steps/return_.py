"""`return`."""

from __future__ import annotations

import math
from typing import ClassVar, Final

from swarm_ctl.core.agent.return_to_launch import return_height_m
from swarm_ctl.core.kernel.constraints import margins_of
from swarm_ctl.core.model.autopilots import UpAndDown
from swarm_ctl.core.model.plan import Plan, PlannedStep, Point
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.return_ import ReturnStep
from swarm_ctl.mission.sections.section import Timeout
from swarm_ctl.mission.steps.land import fastest_s, generous_s
from swarm_ctl.mission.steps.step_kind import Mission, StepKind, TimedSection

_TURN_S: Final = 4.0
"""Of the way back: settling at its height, braking, coming to rest over the start."""


class ReturnSection(TimedSection):
    """Return to the starts, all at once, in three layers of height; land there and disarm."""

    timeout_s: Timeout | None = None
    """Default: long enough for the number of agents, the height and the ways to the starts."""


class Return(StepKind[ReturnSection, ReturnStep]):
    """Home, all at once."""

    section = ReturnSection
    ends: ClassVar[bool] = True

    def planned(
        self, written: ReturnSection, mission: Mission, before: PlannedFormation
    ) -> ReturnStep:
        agents = sorted(mission.agents, key=lambda agent: agent.id)
        starts = [(n * mission.unit_m, e * mission.unit_m) for n, e in (a.start for a in agents)]
        ways_m = sum(map(math.dist, before.places_m(), starts))
        limits = mission.vehicle.limits.planned()
        speed_mps = mission.policies.at_speed(limits.speed_mps).return_speed_mps
        timeout_s = generous_s(mission, before) * (len(agents) + 1) + 2 * (ways_m / speed_mps)
        return ReturnStep(written.timeout_s or timeout_s, written.on_timeout)

    def words(self, step: ReturnStep, plan: Plan) -> str:
        first, last = (return_height_m(plan, plan.agents[k].id) for k in (0, -1))
        return f"return at {first:g} to {last:g} m"

    def needed_s(self, written: ReturnSection, mission: Mission) -> float:
        return fastest_s(mission)

    def least_s(self, step: ReturnStep, at: PlannedStep) -> float:
        ways_m = sum(math.dist(*way) for way in self.ways_m(step, at))
        return ways_m / at.plan.policies.return_speed_mps

    def expected_s(self, step: ReturnStep, at: PlannedStep, autopilot: UpAndDown) -> float:
        """All fly at once; who starts within the filter's distance of another waits until that one
        is down."""
        plan, limits, speed = at.plan, at.plan.limits, at.plan.policies.return_speed_mps
        apart_m = margins_of(plan.law, plan.response, limits.speed_mps, plan.unit_m).keep_out
        heights = [return_height_m(plan, agent) for agent in at.group.ids]
        places, starts = zip(*self.ways_m(step, at), strict=True)
        home_s = [
            max(0.0, up_m - at.before.height_m) / limits.climb_mps + way_m / speed + _TURN_S
            for up_m, way_m in zip(heights, map(math.dist, places, starts), strict=True)
        ]
        down_s: dict[int, float] = {}
        for k in sorted(range(len(starts)), key=home_s.__getitem__):
            near = [down_s[j] for j in down_s if math.dist(starts[j], starts[k]) < apart_m]
            down_s[k] = max([home_s[k], *near]) + autopilot.landing_s(heights[k])
        return max(down_s.values())

    def ways_m(self, step: ReturnStep, at: PlannedStep) -> list[tuple[Point, ...]]:
        """To the own start."""
        unit = at.plan.unit_m
        starts = [(n * unit, e * unit) for n, e in (at.plan.agent(i).start for i in at.group.ids)]
        return list(zip(at.before.places_m(), starts, strict=True))
