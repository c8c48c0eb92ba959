"""A mission's forecast: how long each step takes, how close vehicles come, how long links get.

Form steps are flown, from the planned starts, by the law and the safety filter (`rehearsal.py`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.law.formation import distances, formation_error
from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.core.model.plan import GroupPlan, Plan
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.errors import MissionError
from swarm_ctl.mission.compile.rehearsal import Rehearsal
from swarm_ctl.mission.input.units import said
from swarm_ctl.mission.steps.table import kind_of, place_of

if TYPE_CHECKING:
    from swarm_ctl.mission.compile.loader import LoadedMission

Array: TypeAlias = npt.NDArray[np.float64]
Links: TypeAlias = Sequence[tuple[int, ...]]
"""N_i by agent id, in the order of the group's agents."""


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
    """Of `Plan.all_steps`; take-off and landing as the slowest of the `autopilots` does them."""
    kinds = [AUTOPILOT_KINDS[name].up_and_down for name in sorted(set(autopilots))]
    forms = iter([form for group in plan.groups for form in forecast_forms(plan, group)])
    found: list[StepForecast] = []
    for at in plan.all_steps():
        if at.step.new_shape is not None:
            form = next(forms)
            found.append(StepForecast(form.formed_s, form))
        else:
            seconds = max(kind_of(at.step).expected_s(at.step, at, kind) for kind in kinds)
            in_time = seconds <= at.step.timeout_s
            found.append(StepForecast(seconds if in_time else None, needed_s=seconds))
    return found


def refuse_too_close(loaded: LoadedMission, forecasts: Iterable[StepForecast]) -> None:
    """Raises MissionError, with the form steps in which the forecast has a pair under r_in."""
    plan = loaded.plan
    r_in_m, problems = plan.law.r_in * plan.unit_m, []
    for at, expected in zip(plan.all_steps(), forecasts, strict=True):
        form = expected.form
        if form is None or form.smallest_pair is None or form.smallest_m >= r_in_m:
            continue
        what = f"{agents_named(form.smallest_pair)} are forecast {form.smallest_m:.2f} m apart"
        least = f"at least law.r_in = {said(r_in_m, loaded.file)}"
        allowed = f"{least}, by other starts or slots, or a lower speed"
        problems.append(loaded.document.problem(place_of(at), what, allowed))
    if problems:
        raise MissionError(tuple(problems))


def forecast_forms(plan: Plan, group: GroupPlan) -> list[FormForecast]:
    """Every `form` step of a group in order, each from where the one before ended. The other groups
    are not in its way."""
    formation = group.formations(plan.unit_m)[0]
    points, forecasts = np.array(formation.places), list[FormForecast]()
    links: Links = [agent.neighbours for agent in group.agents]
    for step in group.steps:
        before, formation = formation, step.after(formation)
        if (form := step.new_shape) is not None:
            links = form.neighbours or links
            rest = formation.height_m, before.heights_m
            points, found = _form(plan, group.ids, form, points, links, *rest)
            forecasts.append(found)
            # The law lets the centre drift; the next steps go on from there.
            north, east = (points.mean(axis=0) * plan.unit_m).tolist()
            formation = replace(formation, centre_m=(north, east))
        elif step.path is not None:
            points = np.array(formation.places)
    return forecasts


def _form(
    plan: Plan,
    ids: Sequence[int],
    step: FormStep,
    points: Array,
    links: Links,
    height_m: float,
    begin_m: Sequence[float],
) -> tuple[Array, FormForecast]:
    """The points [units] at the end of a form step that begins at `points`, and its forecast."""
    end_m = [height_m + up_m for up_m in step.ups_m or (0.0,) * len(ids)]
    climb = list(zip(begin_m, end_m, strict=True)) if plan.wake is not None else ()
    swarm = Rehearsal(plan, ids, step, points, links, height_m, climb=climb)
    slots = np.array(step.slots, dtype=np.float64)
    formed_s, since_s = None, None
    nearest, farthest = np.full(swarm.linked.shape, np.inf), 0.0
    for tick in range(round(step.timeout_s / plan.tick_s)):
        now_s, points = tick * plan.tick_s, swarm.points
        between = distances(points)
        nearest = np.where(swarm.beside, np.minimum(nearest, between), nearest)
        farthest = max(farthest, float(between[swarm.linked].max(initial=0.0)))
        formed = float(formation_error(points, slots)) * plan.unit_m < step.tolerance_m
        formed = formed and swarm.at_height
        since_s = (now_s if since_s is None else since_s) if formed else None
        if since_s is not None and now_s - since_s >= step.settle_s:
            formed_s = now_s
            break
        swarm.tick()
    np.fill_diagonal(nearest, np.inf)
    i, j = np.unravel_index(int(np.argmin(nearest)), nearest.shape)
    pair = (ids[int(min(i, j))], ids[int(max(i, j))]) if len(ids) > 1 else None
    smallest_m = float(nearest[i, j]) * plan.unit_m
    return points, FormForecast(step.shape, formed_s, smallest_m, pair, farthest * plan.unit_m)
