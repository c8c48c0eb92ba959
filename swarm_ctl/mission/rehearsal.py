"""A mission's formations flown on paper: the law on ideal points, from the planned starts, before anything flies.

Seen from its stop point a vehicle is a single integrator (SAFETY.md section 1), so this is what the swarm does but for
late news, wind and model errors. With `compensation: none` real vehicles do worse than this.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from swarm_ctl.core import law
from swarm_ctl.core.formation import distances, formation_error
from swarm_ctl.core.plan import FormStep, Plan

Array: TypeAlias = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FormForecast:
    """What to expect of one `form` step. Lengths in metres, pairs and links by agent id."""

    shape: str
    formed_s: float | None
    """From the step's start until the shape stands, settling included; None: not before its time-out."""
    smallest_m: float
    smallest_pair: tuple[int, int] | None
    longest_link_m: float
    """The longest any link of the start graph gets on the way; 0 where there is none."""


def rehearse(plan: Plan) -> list[FormForecast]:
    """Every `form` step in order, each from where the one before ended."""
    points = np.array([agent.start for agent in plan.agents], dtype=np.float64)
    forecasts = []
    for step in plan.steps:
        if isinstance(step, FormStep):
            points, forecast = _form(plan, step, points)
            forecasts.append(forecast)
    return forecasts


def _form(plan: Plan, step: FormStep, points: Array) -> tuple[Array, FormForecast]:
    slots = np.array(step.slots, dtype=np.float64)
    ids = [agent.id for agent in plan.agents]
    linked = np.array([[j in agent.neighbours for j in ids] for agent in plan.agents])
    pairs = ~np.eye(len(ids), dtype=bool)
    # Vehicles follow their stop points by dead time and lag; the shape stands that much later.
    formed_s, since_s, late_s = None, None, plan.response.dead_time_s + plan.response.lag_s
    nearest, farthest = np.full(linked.shape, np.inf), 0.0
    for tick in range(round(step.timeout_s / plan.tick_s)):
        now_s = tick * plan.tick_s + late_s
        between = distances(points)
        nearest = np.where(pairs, np.minimum(nearest, between), np.inf)
        farthest = max(farthest, float(between[linked].max(initial=0.0)))
        formed = float(formation_error(points, slots)) * plan.unit_m < step.tolerance_m
        since_s = (now_s if since_s is None else since_s) if formed else None
        if since_s is not None and now_s - since_s >= step.settle_s:
            formed_s = now_s
            break
        points = points + _move(plan, points, slots, linked, pairs)
    i, j = np.unravel_index(int(np.argmin(nearest)), nearest.shape)
    pair = (ids[min(i, j)], ids[max(i, j)]) if len(ids) > 1 else None
    smallest_m = float(nearest[i, j]) * plan.unit_m
    return points, FormForecast(step.shape, formed_s, smallest_m, pair, farthest * plan.unit_m)


def _move(
    plan: Plan, points: Array, slots: Array, linked: npt.NDArray[np.bool_], pairs: npt.NDArray[np.bool_]
) -> Array:
    """One tick's displacement of all agents [units], (n, 2): the law, then the speed limit."""
    count = len(points)
    others = np.broadcast_to(points, (count, count, 2))
    other_slots = np.broadcast_to(slots, (count, count, 2))
    lower = np.triu(np.ones((count, count), dtype=bool), 1)
    u = law.evaluate(points, slots, others, other_slots, linked, pairs, lower, plan.law).u
    step = u * plan.kappa * plan.tick_s
    most = plan.limits.speed_mps * plan.tick_s / plan.unit_m
    length = np.linalg.norm(step, axis=-1, keepdims=True)
    return np.asarray(step * (most / np.maximum(length, most)))
