"""Groups that are to stand so near to each other that one may not get there."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from swarm_ctl.core.model.plan import Plan, PlannedStep, Point
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
    other, or where one comes to another that stays. Who is where while both fly on is not looked
    at."""
    parts: dict[tuple[int, str], list[PlannedStep]] = {}
    for at in plan.all_steps():
        if not at.waits_on:
            parts.setdefault((at.group.before, at.group.name), []).append(at)
    for (one, steps), (other, others) in itertools.combinations(parts.items(), 2):
        if one[0] != other[0]:
            continue
        for a, b in zip(_stretches(steps, others), _stretches(others, steps), strict=False):
            yield from sorted(_close(plan, a, b), key=lambda each: each.apart_m)[:1]


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
    near_m = _HELD_OFF * plan.law.r_out * plan.unit_m - ROUNDING
    for at, stays in comes:
        for (i, place, up_m), (j, taken, level_m) in itertools.product(_places(at), _places(stays)):
            apart_m = math.dist(place, taken)
            if apart_m < near_m and abs(up_m - level_m) < plan.slot_layer_m:
                yield Crowded(at, i, j, apart_m)


def _places(at: PlannedStep) -> list[tuple[int, Point, float]]:
    """Of each agent after a step: where it is [m], and how high."""
    return list(zip(at.group.ids, at.after.places_m(), at.after.heights_m, strict=True))
