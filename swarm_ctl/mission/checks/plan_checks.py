"""What is wrong with a plan: where the formation will be, and how long it takes to get there."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from swarm_ctl.core.law import graph
from swarm_ctl.core.law.formation import smallest_distance
from swarm_ctl.core.model.plan import Plan, Point
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.hold import HoldStep
from swarm_ctl.core.model.steps.land import LandStep
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.steps.return_ import ReturnStep
from swarm_ctl.core.model.steps.rotate import RotateStep
from swarm_ctl.core.model.steps.scale import ScaleStep
from swarm_ctl.core.model.steps.step import Step
from swarm_ctl.core.model.steps.takeoff import TakeoffStep
from swarm_ctl.core.safety.fence import inside, leaves
from swarm_ctl.mission.checks.mission_checks import MAX_DISTANCE_M
from swarm_ctl.mission.input.document import Finding, Place
from swarm_ctl.mission.input.findings import ROUNDING, Findings, named_parts, too_short
from swarm_ctl.mission.input.units import enough, said
from swarm_ctl.mission.sections.mission_file import MissionFile


def check_plan(plan: Plan, mission: MissionFile) -> list[Finding]:
    """Every mistake that shows only in the plan; its words are those of the mission's file."""

    found: list[Finding] = []
    formations = plan.formations()
    for k, (step, before, after) in enumerate(
        zip(plan.steps, formations[:-1], formations[1:], strict=True)
    ):
        place: Place = ("steps", k, step.kind)
        found += _connected(plan, step, before, place, mission)
        found += _spacing(plan, step, before, after, place, mission)
        found += _fenced(plan, step, before, place)
        found += _timeout(step, before, place)
    return found


def _connected(
    plan: Plan, step: Step, before: PlannedFormation, place: Place, mission: MissionFile
) -> Findings:
    if isinstance(step, FormStep) and step.neighbours:
        ids = [agent.id for agent in plan.agents]
        parts = graph.components(dict(zip(ids, step.neighbours, strict=True)))
        if len(parts) > 1:
            needed, i, j = graph.connecting_range(dict(zip(ids, before.offsets, strict=True)))
            r = said(plan.law.r * plan.unit_m, mission)
            falls = f"with law.r = {r} it falls into {named_parts(parts)}"
            wide = said(needed * plan.unit_m, mission, least=True)
            allowed = f"law.r of {wide} or more (agents {i} and {j}), or neighbours: keep"
            what = f"the shape before is not connected: {falls}"
            yield Finding((*place, "neighbours"), what, allowed)


def _spacing(
    plan: Plan,
    step: Step,
    before: PlannedFormation,
    after: PlannedFormation,
    place: Place,
    mission: MissionFile,
) -> Findings:
    if not isinstance(step, ScaleStep):
        return
    r_out, apart = plan.law.r_out, smallest_distance(after.offsets)
    if apart <= r_out + ROUNDING:
        narrowing = step.factor / before.scale
        what = f"{narrowing:g} brings slots to {said(apart * plan.unit_m, mission)}"
        wide = f"above {enough(narrowing * r_out / apart)}"
        least = said(r_out * plan.unit_m, mission)
        allowed = f"{wide}: more than law.r_out = {least} between slots"
        yield Finding((*place, "factor"), what, allowed)


def _fenced(plan: Plan, step: Step, before: PlannedFormation, place: Place) -> Findings:
    if plan.fence is None:
        return
    ceiling_m = plan.fence.height_m
    if isinstance(step, TakeoffStep) and step.height_m > ceiling_m:
        what = f"{step.height_m:g} m is above the geofence"
        yield Finding((*place, "height_m"), what, f"at most fence.height_m = {ceiling_m:g}")
    yield from _beyond(plan, step, before, place)
    for centre in step.waypoints_m if isinstance(step, MoveStep) else ():
        if math.hypot(*centre) > MAX_DISTANCE_M:
            what = f"goes {math.hypot(*centre):.0f} m from the origin"
            yield Finding(place, what, f"at most {MAX_DISTANCE_M:g} m")


def _beyond(plan: Plan, step: Step, before: PlannedFormation, place: Place) -> Findings:
    """The first agent whose planned place after a step, or whose way there, is outside the fence;
    after a return, its way home."""
    if plan.fence is None or isinstance(step, TakeoffStep | HoldStep | LandStep):
        return
    if isinstance(step, ReturnStep):
        starts = [(n * plan.unit_m, e * plan.unit_m) for n, e in (a.start for a in plan.agents)]
        ways: Sequence[tuple[Point, ...]] = list(zip(before.places_m(), starts, strict=True))
    else:
        ways = step.ways_m(before)
    polygon = plan.fence.polygon_m
    for agent, way in zip(plan.agents, ways, strict=True):
        out = next((at for at in way if not inside(polygon, at)), None)
        if out is None:
            crossing = (b for a, b in itertools.pairwise(way) if leaves(polygon, a, b))
            out = next(crossing, None)
            where = "on its way to"
        else:
            where = "at"
        if out is not None:
            at = f"{out[0]:.1f} m north, {out[1]:.1f} m east of the origin"
            what = f"agent {agent.id} would be outside the geofence {where} {at}"
            yield Finding(place, what, "places and ways inside fence.polygon")
            return


def _timeout(step: Step, before: PlannedFormation, place: Place) -> Findings:
    if isinstance(step, MoveStep | RotateStep | ScaleStep):
        needed_s = sum(step.legs_m(before)) / step.speed_mps + step.settle_s
        yield from too_short(place, step.timeout_s, needed_s)
