"""`follow`."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from swarm_ctl.core.model.autopilots import UpAndDown
from swarm_ctl.core.model.plan import Plan, PlannedStep, Policy
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.follow import BELOW_TOP_M, LOWEST_M, FollowStep
from swarm_ctl.mission.input.document import Findings, Mistake, Place
from swarm_ctl.mission.input.near_matches import did_you_mean
from swarm_ctl.mission.sections.section import Action, Name, NorthEast
from swarm_ctl.mission.steps.step_kind import Checks, Mission, StepKind, TimedSection
from swarm_ctl.mission.steps.travel import too_fast


class FollowSection(TimedSection):
    """Keep the formation with a target that moves, for a while."""

    target: Name
    """One of `targets`."""
    offset: NorthEast = (0.0, 0.0)
    """Of the formation's centre from the target: [north, east]; with `offset_in: course` [ahead of
    it, to its right]."""
    offset_in: Literal["world", "course"] = "world"
    """course: the offset turns with the target's course."""
    speed_mps: float | None = Field(default=None, ge=0.1, le=20)
    """The formation flies no faster after its target. Default: vehicle.limits.speed_mps."""
    duration_s: float = Field(gt=0, le=7200)
    """For how long; the order `next` ends it earlier."""
    above_m: float | None = Field(default=None, ge=2, le=200)
    """So high above the target, which then has to tell its height; inside the fence. The take-off
    points count as level with the origin. Default: at the flight height."""
    until: NorthEast | None = None
    """The step ends before its time when the target is here: [north, east]."""
    until_within_m: float = Field(default=10.0, ge=1, le=500)
    """So near to `until` it is there."""
    lost_after_s: float = Field(default=10.0, ge=2, le=600)
    """News of the target is carried on for 1 s; then the formation stands, and after so long
    `on_lost` is done."""
    on_lost: Action = Policy.HOLD
    """hold: the formation stands until the target is heard again; land, return; continue: with the
    next step."""
    timeout_s: Annotated[float, Field(gt=0, le=7300)] | None = None
    """Default: 30 s more than the duration."""


def _known(written: FollowSection, place: Place, mission: Mission) -> Findings:
    known = sorted(mission.targets)
    if written.target not in mission.targets:
        hint = did_you_mean(written.target, known)
        allowed = f"one of {', '.join(known)}" if known else "a target from the section targets"
        yield Mistake((*place, "target"), f"there is no target {written.target!r}{hint}", allowed)


def _at_hand(written: FollowSection, place: Place, mission: Mission) -> Findings:
    """An agent is followed while a pilot flies it: the others have to fly on then."""
    target, limits = mission.targets.get(written.target), mission.vehicle.limits.planned()
    lost = mission.policies.at_speed(limits.speed_mps).agent_lost
    known = target is not None and target.agent in [agent.id for agent in mission.agents]
    if target is not None and known and lost is not Policy.CONTINUE:
        what = (
            f"agent {target.agent} is followed while a pilot flies it, and then the others do as"
            f" policies.agent_lost says: {lost.value}"
        )
        yield Mistake((*place, "target"), what, "policies.agent_lost: continue")


def _above_the_fence(written: FollowSection, place: Place, mission: Mission) -> Findings:
    """Where the target's height is known."""
    target, top_m = mission.targets.get(written.target), mission.fence.height_m - BELOW_TOP_M
    if target is None or target.height_m is None or written.above_m is None:
        return
    lowest, most = max(2.0, LOWEST_M - target.height_m), top_m - target.height_m
    if not lowest <= written.above_m <= most:
        what = f"{written.above_m:g} m above a target at {target.height_m:g} m"
        what += " is over the fence's top" if written.above_m > most else " is too near the ground"
        allowed = f"from {lowest:g} to {most:g} m (fence.height_m = {mission.fence.height_m:g})"
        yield Mistake((*place, "above_m"), what, allowed)


def target_findings(mission: Mission) -> Findings:
    """Each target by itself: how it is heard, and that it is there."""
    ids = [agent.id for agent in mission.agents]
    for name, target in mission.targets.items():
        place: Place = ("targets", name)
        given = [word for word in ("adsb", "agent", "along") if getattr(target, word) is not None]
        if len(given) > 1:
            yield Mistake(place, f"has {' and '.join(given)}", "one of adsb, agent, along, or none")
        if target.agent is not None and target.agent not in ids:
            allowed = f"one of {', '.join(map(str, ids))}"
            yield Mistake((*place, "agent"), f"there is no agent {target.agent}", allowed)
        if target.adsb is not None and not int(target.adsb, 16):
            what = f"{target.adsb} is the address of no aircraft"
            yield Mistake((*place, "adsb"), what, "six hexadecimal digits, not all 0")
        if target.speed_mps is not None and target.along is None:
            yield Mistake((*place, "speed_mps"), "is of a target that is played", "with along")


class Follow(StepKind[FollowSection, FollowStep]):
    """The formation with its target."""

    section = FollowSection
    keeps_formation: ClassVar[bool] = True
    checks: ClassVar[Checks] = (
        ("targets", _known),
        ("targets policies agents vehicle", _at_hand),
        ("targets fence", _above_the_fence),
        ("vehicle", too_fast),
    )

    def planned(
        self, written: FollowSection, mission: Mission, before: PlannedFormation
    ) -> FollowStep:
        limit, unit = mission.vehicle.limits.planned().speed_mps, before.unit_m
        (north, east), until = written.offset, written.until
        return FollowStep(
            written.target,
            (north * unit, east * unit),
            in_course=written.offset_in == "course",
            speed_mps=written.speed_mps or limit,
            duration_s=written.duration_s,
            timeout_s=written.timeout_s or written.duration_s + 30,
            lost_after_s=written.lost_after_s,
            on_lost=written.on_lost,
            above_m=written.above_m,
            until_m=(until[0] * unit, until[1] * unit) if until is not None else None,
            until_within_m=written.until_within_m,
            on_timeout=written.on_timeout,
        )

    def needed_s(self, written: FollowSection, mission: Mission) -> float:
        return written.duration_s

    def words(self, step: FollowStep, plan: Plan) -> str:
        """With where the formation is to be."""
        north, east = step.offset_m
        of = "of its course" if step.in_course else "north, east"
        where = f", ({north:g}, {east:g}) m {of}" if math.hypot(north, east) else ""
        where += f", {step.above_m:g} m above it" if step.above_m is not None else ""
        if step.until_m is not None:
            end = f"({step.until_m[0]:g}, {step.until_m[1]:g}) m"
            where += f", until it is within {step.until_within_m:g} m of {end}"
        return f"follow {step.target}{where}, at most {step.speed_mps:g} m/s"

    def expected_s(self, step: FollowStep, at: PlannedStep, autopilot: UpAndDown) -> float:
        return step.duration_s
