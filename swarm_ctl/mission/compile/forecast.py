"""A mission's formations flown on paper: the law on ideal points, from the planned starts, before
anything flies.

Seen from its stop point a vehicle is a single integrator
(docs/pages/law.md#from-units-to-a-vehicle), so this is what the swarm does but for late states,
wind and model errors. With `compensation: none` real vehicles do worse than this.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.agent.return_to_launch import return_height_m
from swarm_ctl.core.law import formation_law, mean_error_feedback
from swarm_ctl.core.law.formation import centred, distances, formation_error
from swarm_ctl.core.model.plan import (
    FormStep,
    HoldStep,
    MoveStep,
    Plan,
    Point,
    ReturnStep,
    RotateStep,
    ScaleStep,
    Step,
    TakeoffStep,
)

Array: TypeAlias = npt.NDArray[np.float64]


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
    """The longest any link of the start graph gets on the way; 0 where there is none."""


@dataclass(frozen=True, slots=True)
class StepForecast:
    """What to expect of a step: from when the first agent begins it until the last one is done."""

    expected_s: float | None
    """None: not before its time-out."""
    form: FormForecast | None = None
    """Of a `form` step."""


def forecast(plan: Plan) -> list[StepForecast]:
    """Every step in order. Take-off and landing are the autopilots' own (ArduCopter's and PX4's
    default speeds)."""
    forms = iter(rehearse(plan))
    found: list[StepForecast] = []
    where = Whereabouts.at_start(plan)
    for step in plan.steps:
        if isinstance(step, FormStep):
            form = next(forms)
            found.append(StepForecast(form.formed_s, form))
        else:
            seconds = _seconds(plan, step, where)
            found.append(StepForecast(seconds if seconds <= step.timeout_s else None))
        where = where.after(step)
    return found


@dataclass(frozen=True, slots=True)
class Whereabouts:
    """Centre [m], slots [units], height [m] of the swarm between two steps of a plan."""

    plan: Plan
    centre_m: Point
    slots: tuple[Point, ...]
    angle_rad: float = 0.0
    scale: float = 1.0
    height_m: float = 0.0

    @classmethod
    def at_start(cls, plan: Plan) -> Whereabouts:
        """On the ground."""
        starts = np.array([agent.start for agent in plan.agents]) * plan.unit_m
        north, east = starts.mean(axis=0).tolist()
        return cls(plan, (north, east), tuple(agent.start for agent in plan.agents))

    @property
    def radius_m(self) -> float:
        """Of the outermost slot at scale 1."""
        return float(np.linalg.norm(centred(self.slots), axis=1).max()) * self.plan.unit_m

    def places_m(self) -> Array:
        """Where each agent is, (n, 2)."""
        c, s = np.cos(self.angle_rad), np.sin(self.angle_rad)
        turn = np.array([[c, -s], [s, c]])
        slots: Array = centred(self.slots) @ turn.T * self.scale * self.plan.unit_m + np.array(
            self.centre_m
        )
        return slots

    def after(self, step: Step) -> Whereabouts:
        """When the step is done."""
        if isinstance(step, FormStep):
            return replace(self, slots=step.slots, angle_rad=0.0, scale=1.0)
        if isinstance(step, TakeoffStep):
            return replace(self, height_m=step.height_m)
        if isinstance(step, MoveStep):
            return replace(self, centre_m=step.waypoints_m[-1])
        if isinstance(step, RotateStep):
            return replace(self, angle_rad=step.angle_rad)
        return replace(self, scale=step.factor) if isinstance(step, ScaleStep) else self


def _seconds(plan: Plan, step: Step, where: Whereabouts) -> float:
    late_s = plan.response.dead_time_s + plan.response.lag_s
    match step:
        case TakeoffStep():
            return _ARM_S + step.height_m / _CLIMB_MPS
        case HoldStep():
            return step.duration_s
        case MoveStep() | RotateStep() | ScaleStep():
            return (
                sum(_leg_s(plan, step, way_m) for way_m in _legs_m(step, where))
                + late_s
                + step.settle_s
            )
        case ReturnStep():
            return _return_s(plan, where)
        case _:
            return _landing_s(where.height_m)


def _legs_m(step: Step, where: Whereabouts) -> list[float]:
    """How far the outermost agent goes, leg by leg."""
    if isinstance(step, MoveStep):
        points = np.array([where.centre_m, *step.waypoints_m])
        return [float(way) for way in np.linalg.norm(np.diff(points, axis=0), axis=1)]
    if isinstance(step, RotateStep):
        return [abs(step.angle_rad - where.angle_rad) * where.radius_m * where.scale]
    return [abs(step.factor - where.scale) * where.radius_m] if isinstance(step, ScaleStep) else []


def _leg_s(plan: Plan, step: MoveStep | RotateStep | ScaleStep, way_m: float) -> float:
    """From standstill to standstill at half the vehicles' acceleration, as the frame does
    (`core/control/reference.py`)."""
    a, v = 0.5 * plan.response.acceleration_mps2, step.speed_mps
    return way_m / v + v / a if way_m > v * v / a else 2 * (way_m / a) ** 0.5


def _return_s(plan: Plan, where: Whereabouts) -> float:
    """One flies after the other; each lands while the next one flies."""
    speed, late_s, done_s = plan.policies.return_speed_mps, _TURN_S, 0.0
    starts = np.array([agent.start for agent in plan.agents]) * plan.unit_m
    ways = np.linalg.norm(where.places_m() - starts, axis=1)
    for agent, way_m in zip(plan.agents, ways, strict=True):
        up_m = return_height_m(plan, agent.id)
        late_s = (
            max(late_s, (up_m - where.height_m) / plan.limits.climb_mps)
            + float(way_m) / speed
            + _TURN_S
        )
        done_s = max(done_s, late_s + _landing_s(up_m))
    return done_s


def _landing_s(height_m: float) -> float:
    """Fast to 10 m, slowly from there, a moment to disarm."""
    return (
        max(0.0, height_m - 10.0) / _DESCENT_MPS + min(height_m, 10.0) / _TOUCHDOWN_MPS + _DISARM_S
    )


_ARM_S, _CLIMB_MPS = 6.0, 2.5
_DESCENT_MPS, _TOUCHDOWN_MPS, _DISARM_S = 1.5, 0.5, 4.0
_TURN_S = 4.0
"""From one agent's arrival to the next one's way: braking, settling, the news."""


def rehearse(plan: Plan) -> list[FormForecast]:
    """Every `form` step in order, each from where the one before ended."""
    points = np.array([agent.start for agent in plan.agents], dtype=np.float64)
    where, forecasts = Whereabouts.at_start(plan), []
    links = [agent.neighbours for agent in plan.agents]
    for step in plan.steps:
        if isinstance(step, FormStep):
            links = list(step.neighbours or links)
            points, found = _form(plan, step, points, links)
            forecasts.append(found)
        where = where.after(step)
        if isinstance(step, FormStep):
            where = replace(where, centre_m=tuple((points.mean(axis=0) * plan.unit_m).tolist()))
        elif isinstance(step, MoveStep | RotateStep | ScaleStep):
            points = where.places_m() / plan.unit_m
    return forecasts


def _form(
    plan: Plan, step: FormStep, points: Array, links: Sequence[tuple[int, ...]]
) -> tuple[Array, FormForecast]:
    slots = np.array(step.slots, dtype=np.float64)
    ids = [agent.id for agent in plan.agents]
    linked = np.array([[j in near for j in ids] for near in links])
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
    plan: Plan,
    points: Array,
    slots: Array,
    linked: npt.NDArray[np.bool_],
    pairs: npt.NDArray[np.bool_],
) -> Array:
    """One tick's displacement of all agents [units], (n, 2): the law, the pull to the average, then
    the speed limit."""
    count = len(points)
    others = np.broadcast_to(points, (count, count, 2))
    other_slots = np.broadcast_to(slots, (count, count, 2))
    lower = np.triu(np.ones((count, count), dtype=bool), 1)
    u = formation_law.evaluate(points, slots, others, other_slots, linked, pairs, lower, plan.law).u
    step = u * plan.kappa * plan.tick_s
    if plan.safety.align:
        errors = points - slots
        step += mean_error_feedback.RATE * plan.tick_s * (errors.mean(axis=0) - errors)
    most = plan.limits.speed_mps * plan.tick_s / plan.unit_m
    length = np.linalg.norm(step, axis=-1, keepdims=True)
    return np.asarray(step * (most / np.maximum(length, most)))
