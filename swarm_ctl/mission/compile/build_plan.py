"""From a checked mission, lengths in units, to its plan: defaults filled in, slots assigned."""

from __future__ import annotations

import math

import numpy as np

from swarm_ctl.core.law import graph
from swarm_ctl.core.law.laws import pinned
from swarm_ctl.core.model import plan
from swarm_ctl.core.model.plan import Compensation, Plan, Point
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.hold import HoldStep
from swarm_ctl.core.model.steps.land import LandStep
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.steps.return_ import ReturnStep
from swarm_ctl.core.model.steps.rotate import RotateStep
from swarm_ctl.core.model.steps.scale import ScaleStep
from swarm_ctl.core.model.steps.table import AnyStep
from swarm_ctl.core.model.steps.takeoff import TakeoffStep
from swarm_ctl.mission.geometry import slot_assignment
from swarm_ctl.mission.geometry.shapes import slots_of
from swarm_ctl.mission.sections.mission_file import MissionFile
from swarm_ctl.mission.sections.step_sections import (
    FormSection,
    HoldSection,
    MoveSection,
    ReturnSection,
    RotateSection,
    ScaleSection,
    StepEntry,
    TakeoffSection,
)

_FENCE_MARGIN_M = 100.0
"""Around everything planned, where a mission draws no fence of its own."""
_RATE = 4.0
"""kappa * h where the mission gives no h [1/s]: forms two to three times as fast as 1. Without the
filter it brings pairs under r_in, without the release it blocks more of them (`swarm-ctl study
studies/ablation.yaml`)."""
_UNSAFE_RATE = 1.0
_SPOOL_UP_S, _DISARM_S = 30.0, 60.0
_TOUCHDOWN_MPS = 0.5
"""Autopilots touch down at this speed or less, whatever the descent before."""


def plan_of(mission: MissionFile) -> Plan:
    """The plan of a mission that has passed `checks.check`; lengths in units."""
    starts = {agent.id: agent.start for agent in sorted(mission.agents, key=lambda agent: agent.id)}
    links = mission.neighbours
    near = (
        graph.neighbours(starts, mission.law.r)
        if links == "starts"
        else graph.of_links(starts, links)
    )
    kappa, safety = mission.law.kappa or 1 / mission.tick_s, _safety(mission)
    steps = _steps(mission, starts)
    return Plan(
        name=mission.name,
        origin=plan.Geodetic(**mission.origin.model_dump()),
        unit_m=mission.unit_m,
        tick_s=mission.tick_s,
        kappa=kappa,
        law=_law(mission, kappa, safety),
        compensation=mission.law.compensation,
        response=plan.Response(**mission.vehicle.response.model_dump()),
        limits=plan.Limits(**mission.vehicle.limits.model_dump()),
        policies=_policies(mission),
        prepare_timeout_s=mission.prepare_timeout_s,
        agents=tuple(plan.AgentPlan(i, start, near[i]) for i, start in starts.items()),
        steps=steps,
        fence=_fence(mission, list(starts.values()), steps),
        safety=safety,
    )


def _law(mission: MissionFile, kappa: float, safety: plan.Safety) -> plan.LawParameters:
    law, h = mission.law, plan.LawParameters().h
    if law.compensation is not Compensation.NONE:
        h = min(1.0, (_RATE if safety.filter and safety.release else _UNSAFE_RATE) / kappa)
    return plan.LawParameters(
        r=law.r,
        r_out=law.r_out,
        r_in=law.r_in,
        h=law.h or h,
        delta_l=law.delta_l,
        delta_a=law.delta_a,
        own=pinned(law.own) if law.own else "",
    )


def _safety(mission: MissionFile) -> plan.Safety:
    default = mission.law.compensation is Compensation.STOP_POINT
    given = mission.safety.model_dump()
    return plan.Safety(
        **{name: default if choice is None else choice for name, choice in given.items()}
    )


def _policies(mission: MissionFile) -> plan.Policies:
    speed_mps = mission.vehicle.limits.speed_mps
    given = mission.policies.model_dump()
    given["max_speed_mps"] = given["max_speed_mps"] or 2 * speed_mps
    given["return_speed_mps"] = given["return_speed_mps"] or speed_mps / 2
    return plan.Policies(**given)


def _fence(mission: MissionFile, starts: list[Point], steps: tuple[AnyStep, ...]) -> plan.Fence:
    drawn, unit = mission.fence.polygon, mission.unit_m
    corners = (
        tuple((n * unit, e * unit) for n, e in drawn)
        if drawn
        else _box(PlannedFormation.at_start(starts, unit), steps)
    )
    return plan.Fence(corners, mission.fence.height_m)


def _box(start: PlannedFormation, steps: tuple[AnyStep, ...]) -> tuple[Point, ...]:
    """A rectangle around everything planned, `_FENCE_MARGIN_M` away from it [m]."""
    points, before = start.places_m(), start
    for step in steps:
        after = step.after(before)
        reach = max(before.radius_m, after.radius_m)
        way = step.way_m
        for north, east in (before.centre_m, *way):
            points += [(north - reach, east - reach), (north + reach, east + reach)]
        before = after
    # Rounded first, so that the last bits of a machine do not move the fence by a metre.
    extent = np.round(points, 6)
    low = np.floor(extent.min(axis=0) - _FENCE_MARGIN_M).tolist()
    high = np.ceil(extent.max(axis=0) + _FENCE_MARGIN_M).tolist()
    return ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]))


# --- steps ---


def _steps(mission: MissionFile, starts: dict[int, Point]) -> tuple[AnyStep, ...]:
    """Each step from where the one before leaves the formation."""
    steps: list[AnyStep] = []
    formation = PlannedFormation.at_start(list(starts.values()), mission.unit_m)
    for written in mission.steps:
        steps.append(_step(mission, written, list(starts), formation))
        formation = steps[-1].after(formation)
    return tuple(steps)


def _step(
    mission: MissionFile, step: StepEntry, ids: list[int], before: PlannedFormation
) -> AnyStep:
    limits = mission.vehicle.limits
    landing_s = _DISARM_S + 1.5 * before.height_m / min(limits.descent_mps, _TOUCHDOWN_MPS)
    match step.body:
        case TakeoffSection() as takeoff:
            generous_s = _SPOOL_UP_S + 2 * takeoff.height_m / limits.climb_mps
            return TakeoffStep(
                takeoff.height_m, takeoff.timeout_s or generous_s, takeoff.on_timeout
            )
        case FormSection() as form:
            return _form(mission, form, ids, before)
        case HoldSection() as hold:
            timeout_s = hold.timeout_s or hold.duration_s + 30
            return HoldStep(hold.duration_s, timeout_s, hold.on_timeout)
        case MoveSection() | RotateSection() | ScaleSection() as travel:
            return _travel(mission, travel, before)
        case ReturnSection() as back:
            generous_s = landing_s * (len(ids) + 1) + 2 * _ways_s(mission, before)
            return ReturnStep(back.timeout_s or generous_s, back.on_timeout)
        case land:
            return LandStep((land and land.timeout_s) or landing_s)


def _ways_s(mission: MissionFile, before: PlannedFormation) -> float:
    """What the ways to the starts take one after the other, at the speed of the return."""
    agents = sorted(mission.agents, key=lambda agent: agent.id)
    starts = [(n * mission.unit_m, e * mission.unit_m) for n, e in (a.start for a in agents)]
    ways_m = sum(map(math.dist, before.places_m(), starts))
    speed_mps = mission.policies.return_speed_mps or mission.vehicle.limits.speed_mps / 2
    return ways_m / speed_mps


def _form(
    mission: MissionFile, form: FormSection, ids: list[int], before: PlannedFormation
) -> FormStep:
    slots = slots_of(mission.shapes[form.shape], len(ids))
    if form.slots == "nearest":
        slots = slot_assignment.nearest(before.offsets, slots)
    links: dict[int, tuple[int, ...]] | None = None
    if form.neighbours == "rechoose":
        places = dict(zip(ids, before.offsets, strict=True))
        links = graph.neighbours(places, mission.law.r)
    elif form.neighbours != "keep":
        links = graph.of_links(ids, form.neighbours)
    exchange = form.exchange
    if exchange is None:
        flies_stop_points = mission.law.compensation is Compensation.STOP_POINT
        exchange = form.slots == "nearest" and flies_stop_points
    return FormStep(
        shape=form.shape,
        # Rounded (and -0 made 0) so that the plan's hash does not hang on a machine's last bits.
        slots=tuple((float(north), float(east)) for north, east in np.round(slots, 9) + 0.0),
        tolerance_m=form.tolerance_m,
        settle_s=form.settle_s,
        timeout_s=form.timeout_s,
        neighbours=None if links is None else tuple(links[i] for i in ids),
        on_timeout=form.on_timeout,
        exchange=exchange,
    )


def _travel(
    mission: MissionFile,
    travel: MoveSection | RotateSection | ScaleSection,
    before: PlannedFormation,
) -> AnyStep:
    speed_mps = travel.speed_mps or mission.vehicle.limits.speed_mps / 2

    def planned(timeout_s: float) -> MoveStep | RotateStep | ScaleStep:
        rest = (speed_mps, travel.tolerance_m, travel.settle_s, timeout_s, travel.on_timeout)
        match travel:
            case MoveSection():
                return MoveStep(_waypoints_m(travel, before), *rest)
            case RotateSection():
                return RotateStep(before.angle_rad + math.radians(travel.angle_deg), *rest)
            case ScaleSection():
                return ScaleStep(before.scale * travel.factor, *rest)

    way_m = sum(planned(0.0).legs_m(before))
    return planned(travel.timeout_s or 30 + travel.settle_s + 2 * way_m / speed_mps)


def _waypoints_m(move: MoveSection, before: PlannedFormation) -> tuple[Point, ...]:
    unit = before.unit_m
    if move.by is not None:
        north, east = before.centre_m
        return ((north + move.by[0] * unit, east + move.by[1] * unit),)
    way = move.along or ((move.to,) if move.to else ())
    return tuple((north * unit, east * unit) for north, east in way)
