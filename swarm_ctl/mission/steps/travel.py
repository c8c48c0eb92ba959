"""What `move`, `rotate` and `scale` have in common: they lead the formation on a way."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, NamedTuple, TypeVar

from pydantic import Field

from swarm_ctl.core.model.autopilots import UpAndDown
from swarm_ctl.core.model.plan import PlannedStep, Policy, Response
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.step import Path
from swarm_ctl.mission.input.document import Findings, Mistake, Place, too_short
from swarm_ctl.mission.sections.section import Timeout
from swarm_ctl.mission.steps.step_kind import Checks, Mission, StepKind, TimedSection


class TravelSection(TimedSection):
    """How fast, and how well it has to stand at the end."""

    speed_mps: float | None = Field(default=None, ge=0.1, le=20)
    """Of the fastest agent. Default: half of vehicle.limits.speed_mps."""
    tolerance_m: float = Field(default=0.5, ge=0.05, le=50)
    """The largest deviation from the shape, and of the pinned agent from its place, at which the
    formation counts as arrived."""
    settle_s: float = Field(default=2.0, ge=0, le=600)
    """How long the deviations must stay below `tolerance_m`."""
    timeout_s: Timeout | None = None
    """Default: 30 s and settle_s more than twice the time at speed_mps."""


class Pace(NamedTuple):
    """The fields that all of them have in a plan."""

    speed_mps: float
    tolerance_m: float
    settle_s: float
    timeout_s: float
    on_timeout: Policy


T = TypeVar("T", bound=TravelSection)
W = TypeVar("W", bound=Path)


def too_fast(written: TravelSection, place: Place, mission: Mission) -> Findings:
    """No faster than vehicles may fly."""
    limit, speed_mps = mission.vehicle.limits.planned().speed_mps, written.speed_mps or 0.0
    if speed_mps > limit:
        what = f"{speed_mps:g} m/s is faster than the vehicles may fly"
        yield Mistake((*place, "speed_mps"), what, f"at most vehicle.limits.speed_mps = {limit:g}")


class Travel(StepKind[T, W]):
    """The formation along a way, in its shape."""

    keeps_formation: ClassVar[bool] = True
    checks: ClassVar[Checks] = (("vehicle", too_fast),)

    @abstractmethod
    def led(self, written: T, mission: Mission, before: PlannedFormation, pace: Pace) -> W:
        """The step of the plan."""

    def planned(self, written: T, mission: Mission, before: PlannedFormation) -> W:
        speed_mps = written.speed_mps or mission.vehicle.limits.planned().speed_mps / 2
        pace = Pace(speed_mps, written.tolerance_m, written.settle_s, 0.0, written.on_timeout)
        way_m = sum(self.led(written, mission, before, pace).legs_m(before))
        timeout_s = written.timeout_s or 30 + written.settle_s + 2 * way_m / speed_mps
        return self.led(written, mission, before, pace._replace(timeout_s=timeout_s))

    def least_s(self, step: W, at: PlannedStep) -> float:
        return sum(step.legs_m(at.before)) / step.speed_mps + step.settle_s

    def expected_s(self, step: W, at: PlannedStep, autopilot: UpAndDown) -> float:
        """Vehicles follow their stop points by dead time and lag."""
        response, ways_m = at.plan.response, step.legs_m(at.before)
        legs_s = sum(_leg_s(response, step.speed_mps, way_m) for way_m in ways_m)
        late_s = response.dead_time_s + response.lag_s
        return legs_s + late_s + step.settle_s

    def wrong(self, step: W, at: PlannedStep, place: Place, mission: Mission) -> Findings:
        """Its time suffices."""
        yield from too_short(place, step.timeout_s, self.least_s(step, at))


def _leg_s(response: Response, speed_mps: float, way_m: float) -> float:
    """From standstill to standstill at half the vehicles' acceleration, as the shared frame moves
    (`core/control/reference.py`)."""
    a, v = 0.5 * response.acceleration_mps2, speed_mps
    return way_m / v + v / a if way_m > v * v / a else 2 * (way_m / a) ** 0.5
