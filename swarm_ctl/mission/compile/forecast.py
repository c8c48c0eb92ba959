"""A mission's forecast: how long each step takes, how close vehicles come, how long links get.

Form steps are flown, from the planned starts, by the law and the safety filter (`rehearsal.py`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.agent.return_to_launch import return_height_m
from swarm_ctl.core.law.formation import distances, formation_error
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.hold import HoldStep
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.steps.return_ import ReturnStep
from swarm_ctl.core.model.steps.rotate import RotateStep
from swarm_ctl.core.model.steps.scale import ScaleStep
from swarm_ctl.core.model.steps.step import Step
from swarm_ctl.core.model.steps.takeoff import TakeoffStep
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.safety.constraints import Margins
from swarm_ctl.errors import MissionError
from swarm_ctl.mission.compile.rehearsal import Rehearsal
from swarm_ctl.mission.input.units import said

if TYPE_CHECKING:
    from swarm_ctl.mission.compile.loader import LoadedMission

Array: TypeAlias = npt.NDArray[np.float64]
Links: TypeAlias = Sequence[tuple[int, ...]]
"""N_i by agent id, in the order of `Plan.agents`."""

_LOW_M = 10.0


@dataclass(frozen=True, slots=True)
class _UpAndDown:
    """How an autopilot takes off and lands by itself."""

    arm_s: float
    """From the order until it climbs, and from its height until it follows setpoints."""
    climb_mps: float
    descent_mps: float
    """To `_LOW_M`."""
    touchdown_mps: float
    """The mean from there."""
    disarm_s: float


_UP_AND_DOWN = {
    "ardupilot": _UpAndDown(5.6, 2.5, 1.2, 0.5, 3.0),
    "px4": _UpAndDown(6.4, 1.5, 0.87, 0.53, 2.6),
}
"""Measured on real ones with default parameters, at 10 and 20 m
(docs/pages/figures.md#real-autopilots)."""
_TURN_S = 4.0
"""Of the way back: settling at its height, braking, coming to rest over the start."""


@dataclass(frozen=True, slots=True)
class FormForecast:
    """What to expect of one `form` step. Lengths in metres, pairs and links by agent id."""

    shape: str
    formed_s: float | None
    """From the step's start until the shape stands, settling included; None: not before its
    time-out."""
    smallest_m: float
    smallest_pair: tuple[int, int] | None
    longest_link_m: float
    """The longest any neighbour link gets on the way; 0 where there is none."""


@dataclass(frozen=True, slots=True)
class StepForecast:
    """What to expect of a step: from when the first agent begins it until the last one is done."""

    expected_s: float | None
    """None: not before its time-out."""
    form: FormForecast | None = None
    """Of a `form` step."""
    needed_s: float | None = None
    """Of another step, also where that is over its time-out."""


def forecast(plan: Plan, autopilots: Iterable[str] = ("ardupilot",)) -> list[StepForecast]:
    """Every step in order; take-off and landing as the slowest of the `autopilots` does them."""
    kinds = [_UP_AND_DOWN[name] for name in sorted(set(autopilots))]
    forms = iter(forecast_forms(plan))
    found: list[StepForecast] = []
    for step, before in zip(plan.steps, plan.formations(), strict=False):
        if isinstance(step, FormStep):
            form = next(forms)
            found.append(StepForecast(form.formed_s, form))
        else:
            seconds = max(_seconds(plan, step, before, kind) for kind in kinds)
            in_time = seconds <= step.timeout_s
            found.append(StepForecast(seconds if in_time else None, needed_s=seconds))
    return found


def refuse_too_close(loaded: LoadedMission, forecasts: Iterable[StepForecast]) -> None:
    """Raises MissionError, with the form steps in which the forecast has a pair under r_in."""
    plan = loaded.plan
    r_in_m, problems = plan.law.r_in * plan.unit_m, []
    for k, step in enumerate(forecasts):
        form = step.form
        if form is None or form.smallest_pair is None or form.smallest_m >= r_in_m:
            continue
        what = f"{agents_named(form.smallest_pair)} are forecast {form.smallest_m:.2f} m apart"
        least = f"at least law.r_in = {said(r_in_m, loaded.file)}"
        allowed = f"{least}, by other starts or slots, or a lower speed"
        problems.append(loaded.document.problem(("steps", k, "form"), what, allowed))
    if problems:
        raise MissionError(tuple(problems))


def _seconds(plan: Plan, step: Step, before: PlannedFormation, kind: _UpAndDown) -> float:
    match step:
        case TakeoffStep():
            return kind.arm_s + step.height_m / kind.climb_mps
        case HoldStep():
            return step.duration_s
        case MoveStep() | RotateStep() | ScaleStep():
            legs_s = sum(_leg_s(plan, step.speed_mps, way_m) for way_m in step.legs_m(before))
            return legs_s + _late_s(plan) + step.settle_s
        case ReturnStep():
            return _return_s(plan, before, kind)
        case _:
            return _landing_s(before.height_m, kind)


def _late_s(plan: Plan) -> float:
    """Vehicles follow their stop points by dead time and lag."""
    return plan.response.dead_time_s + plan.response.lag_s


def _leg_s(plan: Plan, speed_mps: float, way_m: float) -> float:
    """From standstill to standstill at half the vehicles' acceleration, as the shared frame moves
    (`core/control/reference.py`)."""
    a, v = 0.5 * plan.response.acceleration_mps2, speed_mps
    return way_m / v + v / a if way_m > v * v / a else 2 * (way_m / a) ** 0.5


def _return_s(plan: Plan, before: PlannedFormation, kind: _UpAndDown) -> float:
    """All fly at once; who starts within the filter's distance of another waits until that one is
    down."""
    speed, limits = plan.policies.return_speed_mps, plan.limits
    apart_m = Margins.of(plan.law, plan.response, limits.speed_mps, plan.unit_m).keep_out
    starts = [(n * plan.unit_m, e * plan.unit_m) for n, e in (a.start for a in plan.agents)]
    ways = list(map(math.dist, before.places_m(), starts))
    heights = [return_height_m(plan, agent.id) for agent in plan.agents]
    home_s = [
        max(0.0, up_m - before.height_m) / limits.climb_mps + way_m / speed + _TURN_S
        for up_m, way_m in zip(heights, ways, strict=True)
    ]
    down_s: dict[int, float] = {}
    for k in sorted(range(len(starts)), key=home_s.__getitem__):
        near = [down_s[j] for j in down_s if math.dist(starts[j], starts[k]) < apart_m]
        down_s[k] = max([home_s[k], *near]) + _landing_s(heights[k], kind)
    return max(down_s.values())


def _landing_s(height_m: float, kind: _UpAndDown) -> float:
    """Fast to `_LOW_M`, slowly from there, then disarming."""
    fast_s = max(0.0, height_m - _LOW_M) / kind.descent_mps
    return fast_s + min(height_m, _LOW_M) / kind.touchdown_mps + kind.disarm_s


def forecast_forms(plan: Plan) -> list[FormForecast]:
    """Every `form` step in order, each from where the one before ended."""
    starts = [agent.start for agent in plan.agents]
    points, forecasts = np.array(starts, dtype=np.float64), list[FormForecast]()
    formation = PlannedFormation.at_start(starts, plan.unit_m)
    links: Links = [agent.neighbours for agent in plan.agents]
    for step in plan.steps:
        formation = step.after(formation)
        if isinstance(step, FormStep):
            links = step.neighbours or links
            points, found = _form(plan, step, points, links)
            forecasts.append(found)
            # The law lets the centre drift; the next steps go on from there.
            north, east = (points.mean(axis=0) * plan.unit_m).tolist()
            formation = replace(formation, centre_m=(north, east))
        elif isinstance(step, MoveStep | RotateStep | ScaleStep):
            points = np.array(formation.places)
    return forecasts


def _form(plan: Plan, step: FormStep, points: Array, links: Links) -> tuple[Array, FormForecast]:
    """The points [units] at the end of a form step that begins at `points`, and its forecast."""
    swarm = Rehearsal(plan, step, points, links)
    slots, ids = np.array(step.slots, dtype=np.float64), [agent.id for agent in plan.agents]
    formed_s, since_s = None, None
    nearest, farthest = np.full(swarm.linked.shape, np.inf), 0.0
    for tick in range(round(step.timeout_s / plan.tick_s)):
        now_s, points = tick * plan.tick_s, swarm.points
        between = distances(points)
        nearest = np.minimum(nearest, between)
        farthest = max(farthest, float(between[swarm.linked].max(initial=0.0)))
        formed = float(formation_error(points, slots)) * plan.unit_m < step.tolerance_m
        since_s = (now_s if since_s is None else since_s) if formed else None
        if since_s is not None and now_s - since_s >= step.settle_s:
            formed_s = now_s
            break
        swarm.tick()
    np.fill_diagonal(nearest, np.inf)
    i, j = np.unravel_index(int(np.argmin(nearest)), nearest.shape)
    pair = (ids[min(i, j)], ids[max(i, j)]) if len(ids) > 1 else None
    smallest_m = float(nearest[i, j]) * plan.unit_m
    return points, FormForecast(step.shape, formed_s, smallest_m, pair, farthest * plan.unit_m)
