"""From a checked mission, lengths in units, to its plan: defaults filled in, slots assigned."""

from __future__ import annotations

import itertools
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from swarm_ctl import slot_assignment
from swarm_ctl.core.law import graph
from swarm_ctl.core.model import plan
from swarm_ctl.core.model.plan import Compensation, GroupPlan, Plan, Point
from swarm_ctl.core.model.steps.barrier import JOIN, BarrierStep
from swarm_ctl.core.model.steps.table import AnyStep
from swarm_ctl.core.model.targets import TargetPlan
from swarm_ctl.law_loader import pinned
from swarm_ctl.mission.geometry.shapes import slot_count, slots_of, ups_of
from swarm_ctl.mission.mission_file import MissionFile
from swarm_ctl.mission.sections.mission_sections import SafetySection
from swarm_ctl.mission.sections.shape_sections import Shape
from swarm_ctl.mission.steps.form import FormSection
from swarm_ctl.mission.steps.move import zones_of
from swarm_ctl.mission.steps.table import KINDS
from swarm_ctl.mission.written_steps import WrittenGroup, split_up, written_steps

_FENCE_MARGIN_M = 100.0
"""Around everything planned, where a mission draws no fence of its own."""
_RATE = 4.0
"""kappa * h where the mission gives no h [1/s]: forms two to three times as fast as 1. Without the
filter it brings pairs under r_in, without the release it blocks more of them (`swarm-ctl study
studies/ablation.yaml`)."""
_UNSAFE_RATE = 1.0
_JOIN_S = 60.0
"""A group waits for the others of its split for so much longer than they may take."""
_ROUNDING = 1e-9


def plan_of(mission: MissionFile) -> Plan:
    """The plan of a mission that has passed `checks.check`; lengths in units."""
    starts = {agent.id: agent.start for agent in sorted(mission.agents, key=lambda agent: agent.id)}
    kappa, limits = mission.law.kappa or 1 / mission.tick_s, mission.vehicle.limits.planned()
    flies_stop_points = mission.law.compensation is Compensation.STOP_POINT
    safety = mission.safety.planned(**dict.fromkeys(SafetySection.model_fields, flies_stop_points))
    groups = _Groups(mission, starts).made
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
        groups=groups,
        shapes=_shapes(mission, {len(group.agents) for group in groups}),
        fence=_fence(mission, groups),
        safety=safety,
        zones=zones_of(mission),
        wake=mission.wake.by_rotors() if _has_heights(mission, groups) else None,
        targets=_targets(mission, limits.speed_mps),
        named=tuple(
            plan.NamedAgents(name, tuple(sorted(ids))) for name, ids in mission.groups.items()
        ),
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


def _has_heights(mission: MissionFile, groups: tuple[GroupPlan, ...]) -> bool:
    formed = (step.new_shape for group in groups for step in group.steps)
    sizes = {len(group.agents) for group in groups}
    shapes = any(shape.ups_m for shape in _shapes(mission, sizes))
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


def _fence(mission: MissionFile, groups: tuple[GroupPlan, ...]) -> plan.Fence:
    drawn, unit = mission.fence.polygon, mission.unit_m
    corners = tuple((n * unit, e * unit) for n, e in drawn) if drawn else _box(groups, unit)
    return plan.Fence(corners, mission.fence.height_m)


def _box(groups: tuple[GroupPlan, ...], unit_m: float) -> tuple[Point, ...]:
    """A rectangle around everything planned, `_FENCE_MARGIN_M` away from it [m]."""
    points = list[Point]()
    for group in groups:
        formations = group.formations(unit_m)
        points += formations[0].places_m()
        for step, (before, after) in zip(group.steps, itertools.pairwise(formations), strict=True):
            reach = max(before.radius_m, after.radius_m)
            for north, east in (before.centre_m, *step.way_m):
                points += [(north - reach, east - reach), (north + reach, east + reach)]
    # Rounded first, so that the last bits of a machine do not move the fence by a metre.
    extent = np.round(points, 6)
    low = np.floor(extent.min(axis=0) - _FENCE_MARGIN_M).tolist()
    high = np.ceil(extent.max(axis=0) + _FENCE_MARGIN_M).tolist()
    return ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]))


def _shapes(mission: MissionFile, sizes: Collection[int]) -> tuple[plan.ShapePlan, ...]:
    """Those with a slot for each agent of the swarm or of a group, a warning tells the others; in
    the layers of the first step that forms them. Of several sizes the largest first."""
    layer_m = mission.wake.spacing_m(mission.vehicle.limits)
    bodies = [entry.body for _, _, entry in written_steps(mission)]
    forms = {body.shape: body for body in reversed(bodies) if isinstance(body, FormSection)}

    def ups_m(name: str, shape: Shape, count: int) -> tuple[float, ...]:
        ups = ups_of(shape, count)
        ups = forms[name].in_layers(ups, layer_m) if name in forms else ups
        return tuple(ups) if any(ups) else ()

    return tuple(
        plan.ShapePlan(
            name, slot_assignment.rounded(slots_of(shape, count)), ups_m(name, shape, count)
        )
        for name, shape in sorted(mission.shapes.items())
        for count in sorted(sizes, reverse=True)
        if slot_count(shape, count) == count
    )


class _Groups:
    """The groups of a plan, each from where those before it leave its agents."""

    def __init__(self, mission: MissionFile, starts: dict[int, Point]) -> None:
        self._mission, self._unit_m = mission, mission.unit_m
        self._at = {i: (start, 0.0) for i, start in starts.items()}
        """Where each agent is planned to be, and how far above the flight height."""
        self._waiting = {agent.id for agent in mission.agents if agent.waits}
        self._height_m, self._formed = 0.0, False
        made, before, splits = list[GroupPlan](), 0, 0
        for split in split_up(mission):
            groups = [self._group(written, before) for written in split]
            if len(split) > 1:
                longest = max(len(group.steps) for group in groups) + 1
                wait_s = max(sum(s.timeout_s for s in group.steps) for group in groups)
                splits += 1
                join = BarrierStep(f"{JOIN}{splits}", wait_s + _JOIN_S)
                groups = [
                    replace(group, steps=(*group.steps, *[join] * (longest - len(group.steps))))
                    if written.joins
                    else group
                    for group, written in zip(groups, split, strict=True)
                ]
            ends = [group.formations(self._unit_m)[-1] for group in groups]
            for group, end in zip(groups, ends, strict=True):
                ups_m = end.ups_m or (0.0,) * len(group.ids)
                self._at |= dict(zip(group.ids, zip(end.places, ups_m, strict=True), strict=True))
            self._height_m = max(end.height_m for end in ends)
            self._formed = len(split) == 1 and ends[0].formed
            made, before = [*made, *groups], max(group.last for group in groups)
        self.made = tuple(made)

    def _group(self, written: WrittenGroup, before: int) -> GroupPlan:
        mission, ids = written.seen_by(self._mission), written.ids
        places = {i: self._at[i][0] for i in ids}
        ups_m = tuple(self._at[i][1] for i in ids)
        near = self._near(places, first=not before)
        group = GroupPlan(
            written.name,
            agents=tuple(
                plan.AgentPlan(i, place, near[i], waits=i in self._waiting)
                for i, place in places.items()
            ),
            steps=(),
            before=before,
            flies_m=self._height_m,
            ups_m=ups_m if any(ups_m) else (),
            formed=self._formed,
        )
        (formation,) = group.formations(self._unit_m)
        steps = list[AnyStep]()
        for _, entry in written.steps:
            steps.append(KINDS[entry.kind].planned(entry.body, mission, formation))
            formation = steps[-1].after(formation)
        return replace(group, steps=tuple(steps))

    def _near(self, places: dict[int, Point], *, first: bool) -> dict[int, tuple[int, ...]]:
        """Who is whose neighbour as a group begins: as the mission says, later those that are
        within r, or as much farther as connects all."""
        r, links = self._mission.law.r, self._mission.neighbours
        if not first:
            wide = graph.connecting_range(places)[0] if len(places) > 1 else 0.0
            return graph.neighbours(places, max(r, wide * (1.0 + _ROUNDING)))
        return graph.neighbours(places, r) if links == "starts" else graph.of_links(places, links)
