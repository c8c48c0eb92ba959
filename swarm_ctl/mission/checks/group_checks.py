"""Groups that are to stand so near to each other that one may not get there."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from swarm_ctl.core.model.plan import HEIGHT_DOUBT_M, Plan, PlannedStep, Point
from swarm_ctl.core.model.vehicle import OVER_M
from swarm_ctl.mission.input.document import ROUNDING

_HELD_OFF: Final = 0.8
"""Of `law.r_out`: a vehicle came to a place 0.73 of it from one that stayed, and not to one at 0.70
(`tests/scenarios/found/a-group-beside-one-that-stays.yaml`)."""


class Crowded(NamedTuple):
    """An agent that the law holds off its place, for another one stays beside it."""

    at: PlannedStep
    """The step that takes it there."""
    agent: int
    other: int
    apart_m: float


def crowded(plan: Plan) -> Iterator[Crowded]:
    """Of each two groups of a split the nearest two that are too near where both wait for each
    other, where one comes to another that stays, or where one flies low beside another that has
    come down. Who is where while both fly on is not looked at."""
    parts: dict[tuple[int, str], list[PlannedStep]] = {}
    for at in plan.all_steps():
        if not at.waits_on:
            parts.setdefault((at.group.before, at.group.name), []).append(at)
    for (one, steps), (other, others) in itertools.combinations(parts.items(), 2):
        if one[0] != other[0]:
            continue
        for a, b in zip(_stretches(steps, others), _stretches(others, steps), strict=False):
            yield from sorted(_close(plan, a, b), key=lambda each: each.apart_m)[:1]
        for flown, down in ((steps, others), (others, steps)):
            yield from sorted(_beside_landed(plan, flown, down), key=lambda each: each.apart_m)[:1]


def _stretches(own: Sequence[PlannedStep], other: Sequence[PlannedStep]) -> list[list[PlannedStep]]:
    """The own steps from one barrier that both have to the next."""
    shared = {at.step.barrier for at in other} - {""}
    found: list[list[PlannedStep]] = [[]]
    for at in own:
        found[-1].append(at)
        if at.step.barrier in shared:
            found.append([])
    return [steps for steps in found if steps]


def _close(plan: Plan, a: list[PlannedStep], b: list[PlannedStep]) -> Iterator[Crowded]:
    """All that are too near in one stretch of two groups."""
    if any(at.step.goes_down or at.step.follows or at.step.sends for at in (*a, *b)):
        return
    flown, others = ([at for at in each if at.step.settling] for each in (a, b))
    if flown and others:  # where both have come
        comes = [(flown[-1], b[-1])]
    else:
        comes = [*((at, b[-1]) for at in flown), *((at, a[-1]) for at in others)]
    near_m = _near_m(plan)
    for at, stays in comes:
        for (i, place, up_m), (j, taken, level_m) in itertools.product(_places(at), _places(stays)):
            apart_m = math.dist(place, taken)
            if apart_m < near_m and abs(up_m - level_m) < plan.slot_layer_m:
                yield Crowded(at, i, j, apart_m)


def _beside_landed(
    plan: Plan, flown: Sequence[PlannedStep], others: Sequence[PlannedStep]
) -> Iterator[Crowded]:
    """All that come to a place beside one of another group that has landed there, or on their way
    past two at once, and lower than they are flown over."""
    last = others[-1]
    if not last.step.goes_down:
        return
    at_m = last.before.places_m()
    if last.step.goes_home:
        starts = (plan.agent(i).start for i in last.group.ids)
        at_m = [(north * plan.unit_m, east * plan.unit_m) for north, east in starts]
    for at in flown:
        ways_m = at.step.ways_m(at.before)
        for k, (i, place, up_m) in enumerate(_places(at) if at.step.settling else ()):
            if up_m >= OVER_M + HEIGHT_DOUBT_M:
                continue
            beside = [math.dist(place, taken) for taken in at_m]
            past = [_from_way_m(ways_m[k], taken) for taken in at_m] if ways_m else beside
            between = sum(apart_m < _near_m(plan) for apart_m in past) > 1
            for j, apart_m in zip(last.group.ids, past if between else beside, strict=True):
                if apart_m < _near_m(plan):
                    yield Crowded(at, i, j, apart_m)


def _from_way_m(corners: Sequence[Point], point: Point) -> float:
    """How far a point is from a way [m]."""
    found = math.dist(corners[0], point)
    for a, b in itertools.pairwise(complex(*corner) for corner in corners):
        leg, to = b - a, complex(*point) - a
        share = (to * leg.conjugate()).real / max(abs(leg) ** 2, 1e-12)
        found = min(found, abs(to - leg * min(1.0, max(0.0, share))))
    return found


def _near_m(plan: Plan) -> float:
    """Nearer than this [m] the law may hold an agent off its place."""
    return _HELD_OFF * plan.law.r_out * plan.unit_m - ROUNDING


def _places(at: PlannedStep) -> list[tuple[int, Point, float]]:
    """Of each agent after a step: where it is [m], and how high."""
    return list(zip(at.group.ids, at.after.places_m(), at.after.heights_m, strict=True))
