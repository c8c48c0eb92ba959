"""What is wrong with a plan: where the formation will be, and how long it takes to get there."""

from __future__ import annotations

import itertools

from swarm_ctl.core.model.plan import Plan, PlannedStep
from swarm_ctl.core.safety.fence import inside, leaves
from swarm_ctl.mission.checks import zone_checks
from swarm_ctl.mission.input.document import Findings, Mistake, Place
from swarm_ctl.mission.mission_file import MissionFile
from swarm_ctl.mission.steps.table import kind_of, place_of


def check_plan(plan: Plan, mission: MissionFile) -> list[Mistake]:
    """Every mistake that shows only in the plan; its words are those of the mission's file."""
    found: list[Mistake] = []
    for at in plan.all_steps():
        place = place_of(at)
        found += kind_of(at.step).wrong(at.step, at, place, mission)
        near = zone_checks.on_its_way(at, place)
        found += [*_beyond(at, place, led=not near), *near]
    return [*found, *zone_checks.filtered(plan), *zone_checks.starts(plan)]


def _beyond(at: PlannedStep, place: Place, *, led: bool) -> Findings:
    """The first agent whose planned place after a step, or whose way there, is outside the fence;
    after a return, its way home. Not `led`: a zone is in its way, and where else it would go is not
    known."""
    if at.plan.fence is None:
        return
    polygon = at.plan.fence.polygon_m
    ways = kind_of(at.step).ways_m(at.step, at)
    ends = [way[-1] for way in ways]
    if at.step.file is not None:  # all fly the one way, and each to its own place at its end
        ways = [(at.before.centre_m, *at.step.way_m)] * len(ways)
    for agent, way, end in zip(at.group.agents, ways, ends, strict=bool(ways)):
        out = next((corner for corner in (*way, end) if not inside(polygon, corner)), None)
        if out is None and led:
            crossing = (b for a, b in itertools.pairwise(way) if leaves(polygon, a, b))
            out = next(crossing, None)
            where = "on its way to"
        else:
            where = "at"
        if out is not None:
            point = f"{out[0]:.1f} m north, {out[1]:.1f} m east of the origin"
            what = f"agent {agent.id} would be outside the geofence {where} {point}"
            yield Mistake(place, what, "places and ways inside fence.polygon")
            return
