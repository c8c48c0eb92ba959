"""From a checked mission, lengths in units, to its plan: defaults filled in, slots assigned."""

from __future__ import annotations

import numpy as np

from swarm_ctl import slot_assignment
from swarm_ctl.core.law import graph
from swarm_ctl.core.model import plan
from swarm_ctl.core.model.plan import Compensation, Plan, Point
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.table import AnyStep
from swarm_ctl.core.model.targets import TargetPlan
from swarm_ctl.law_loader import pinned
from swarm_ctl.mission.geometry.shapes import slot_count, slots_of, ups_of
from swarm_ctl.mission.mission_file import MissionFile
from swarm_ctl.mission.sections.mission_sections import SafetySection
from swarm_ctl.mission.sections.shape_sections import Shape
from swarm_ctl.mission.steps.among_zones import zones_of
from swarm_ctl.mission.steps.form import FormSection
from swarm_ctl.mission.steps.table import KINDS

_FENCE_MARGIN_M = 100.0
"""Around everything planned, where a mission draws no fence of its own."""
_RATE = 4.0
"""kappa * h where the mission gives no h [1/s]: forms two to three times as fast as 1. Without the
filter it brings pairs under r_in, without the release it blocks more of them (`swarm-ctl study
studies/ablation.yaml`)."""
_UNSAFE_RATE = 1.0


def plan_of(mission: MissionFile) -> Plan:
    """The plan of a mission that has passed `checks.check`; lengths in units."""
    starts = {agent.id: agent.start for agent in sorted(mission.agents, key=lambda agent: agent.id)}
    links = mission.neighbours
    near = (
        graph.neighbours(starts, mission.law.r)
        if links == "starts"
        else graph.of_links(starts, links)
    )
    kappa, limits = mission.law.kappa or 1 / mission.tick_s, mission.vehicle.limits.planned()
    flies_stop_points = mission.law.compensation is Compensation.STOP_POINT
    safety = mission.safety.planned(**dict.fromkeys(SafetySection.model_fields, flies_stop_points))
    steps = _steps(mission, PlannedFormation.at_start(list(starts.values()), mission.unit_m))
    agents = tuple(plan.AgentPlan(i, start, near[i]) for i, start in starts.items())
    return Plan(
        name=mission.name,
        origin=mission.origin.planned(),
        unit_m=mission.unit_m,
        tick_s=mission.tick_s,
        kappa=kappa,
        law=_law(mission, kappa, safety),
        compensation=mission.law.compensation,
        response=mission.vehicle.response.planned(),
        limits=limits,
        policies=mission.policies.at_speed(limits.speed_mps),
        prepare_timeout_s=mission.prepare_timeout_s,
        groups=(plan.GroupPlan(plan.EVERYONE, agents, steps),),
        shapes=_shapes(mission),
        fence=_fence(mission, list(starts.values()), steps),
        safety=safety,
        zones=zones_of(mission),
        wake=mission.wake.by_rotors() if _has_heights(mission, steps) else None,
        targets=_targets(mission, limits.speed_mps),
    )


def _targets(mission: MissionFile, speed_mps: float) -> tuple[TargetPlan, ...]:
    unit = mission.unit_m
    return tuple(
        TargetPlan(
            name,
            way_m=tuple((north * unit, east * unit) for north, east in written.along or ()),
            speed_mps=(written.speed_mps or speed_mps / 2) if written.along else 0.0,
            adsb=int(written.adsb or "0", 16),
            agent=written.agent or 0,
            height_m=written.height_m,
        )
        for name, written in sorted(mission.targets.items())
    )


def _has_heights(mission: MissionFile, steps: tuple[AnyStep, ...]) -> bool:
    formed = (step.new_shape for step in steps)
    shapes = any(shape.ups_m for shape in _shapes(mission))
    return shapes or any(form.ups_m for form in formed if form is not None)


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
        **pinned(law.own or "paper", law.parameters),
    )


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


def _shapes(mission: MissionFile) -> tuple[plan.ShapePlan, ...]:
    """Those with a slot for each agent, a warning tells the others; in the layers of the first step
    that forms them."""
    count, layer_m = len(mission.agents), mission.wake.spacing_m(mission.vehicle.limits)
    bodies = [step.body for step in mission.steps if isinstance(step.body, FormSection)]
    forms = {body.shape: body for body in reversed(bodies)}

    def ups_m(name: str, shape: Shape) -> tuple[float, ...]:
        ups = ups_of(shape, count)
        ups = forms[name].in_layers(ups, layer_m) if name in forms else ups
        return tuple(ups) if any(ups) else ()

    return tuple(
        plan.ShapePlan(name, slot_assignment.rounded(slots_of(shape, count)), ups_m(name, shape))
        for name, shape in sorted(mission.shapes.items())
        if slot_count(shape, count) == count
    )


def _steps(mission: MissionFile, start: PlannedFormation) -> tuple[AnyStep, ...]:
    """Each step from where the one before leaves the formation."""
    steps, formation = list[AnyStep](), start
    for written in mission.steps:
        steps.append(KINDS[written.kind].planned(written.body, mission, formation))
        formation = steps[-1].after(formation)
    return tuple(steps)
