"""What `form` and `move` from an operator carry: steps as a mission has them, decided by the sender
once."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from swarm_ctl.core.law.formation import smallest_distance
from swarm_ctl.core.model.plan import FormStep, MoveStep, Plan, Point
from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.mission.geometry import slot_assignment
from swarm_ctl.mission.geometry.shapes import slots_of
from swarm_ctl.mission.input.schema import Shape
from swarm_ctl.mission.input.units import in_units

_TOLERANCE_M, _SETTLE_S, _NO_END_S = 0.5, 5.0, 1e9


def form(mission: Path, plan: Plan, shape: str, points_m: Mapping[int, Point]) -> FormStep:
    """A shape of the mission's file, its slots given out to whoever is nearest. `points_m`: where
    each agent is."""
    return form_step(in_units(load(mission).file).shapes, plan, shape, points_m, str(mission))


def form_step(
    shapes: Mapping[str, Shape], plan: Plan, shape: str, points_m: Mapping[int, Point], where: str
) -> FormStep:
    """The same from the shapes themselves (lengths in units); InputError where there is no such
    shape in `where`."""
    if shape not in shapes:
        close = difflib.get_close_matches(shape, shapes, n=1)
        hint = f"; did you mean {close[0]}?" if close else ""
        raise InputError(
            f"there is no shape {shape!r} in {where}{hint}; allowed: {', '.join(sorted(shapes))}"
        )
    points = [
        (points_m[a.id][0] / plan.unit_m, points_m[a.id][1] / plan.unit_m) for a in plan.agents
    ]
    targets = slots_of(shapes[shape], len(points))
    if len(targets) != len(points):
        raise InputError(f"{shape} has {len(targets)} slots for {len(points)} agents")
    chosen = np.round(slot_assignment.nearest(points, targets), 9) + 0.0
    if smallest_distance(chosen) <= plan.law.r_out:
        raise InputError(
            f"slots of {shape} are closer than r_out, {plan.law.r_out * plan.unit_m:g} m"
        )
    return FormStep(
        shape, tuple((float(n), float(e)) for n, e in chosen), _TOLERANCE_M, _SETTLE_S, _NO_END_S
    )


def move(plan: Plan, to_m: Point, speed_mps: float | None = None) -> MoveStep:
    """The formation's centre to a point, in metres north and east of the origin; InputError where
    that can't be."""
    if not all(map(math.isfinite, to_m)):
        raise InputError(
            f"move to ({to_m[0]:g}, {to_m[1]:g}) m; allowed: finite numbers of metres, north and east"
        )
    speed = plan.limits.speed_mps / 2 if speed_mps is None else speed_mps
    if not 0 < speed <= plan.limits.speed_mps:
        raise InputError(
            f"move at {speed:g} m/s; allowed: above 0, at most {plan.limits.speed_mps:g} m/s"
        )
    return MoveStep((to_m,), speed, _TOLERANCE_M, _SETTLE_S, _NO_END_S)
