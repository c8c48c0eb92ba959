"""How the model of a vehicle flies setpoints and comes to rest: a first-order lag with bounded
acceleration (docs/understand/law.md#from-units-to-a-vehicle). Metres and seconds."""

from __future__ import annotations

import math
from typing import NamedTuple

from swarm_ctl.core.model.plan import Response


class Coast(NamedTuple):
    """A vehicle's lag and limit, and what follows for one tick."""

    lag_s: float
    acceleration_mps2: float
    tick_s: float
    share: float
    """Of a difference in velocity that one tick makes up."""
    bound: float
    """[m/s] that the velocity changes in one tick, at most."""


def coast_of(vehicle: Response, tick_s: float) -> Coast:
    """For one setpoint a tick."""
    return Coast(
        vehicle.lag_s,
        vehicle.acceleration_mps2,
        tick_s,
        -math.expm1(-tick_s / vehicle.lag_s),
        vehicle.acceleration_mps2 * tick_s,
    )


def pending(vehicle: Response, tick_s: float) -> int:
    """How many setpoints, one per `tick_s`, are inside the dead time."""
    return round(vehicle.dead_time_s / tick_s)


def coasted(
    x: complex, v: complex, acting: complex, part: float, model: Coast
) -> tuple[complex, complex]:
    """Place and velocity after this part of a tick, once the setpoint `acting` acts."""
    dv = (acting - v) * model.share
    dv = dv * (part * model.bound / max(abs(dv), model.bound))
    return x + part * model.tick_s * (v + 0.5 * dv), v + dv


def rest(x: complex, v: complex, model: Coast) -> complex:
    """Where it comes to rest once zero velocity acts on it: full braking, then the lag."""
    speed = abs(v)
    return x + v * (stop_distance(speed, model) / max(speed, 1e-12))


def stop_distance(speed: float, vehicle: Coast | Response) -> float:
    """How far a vehicle still goes once zero velocity acts on it."""
    a, tau = vehicle.acceleration_mps2, vehicle.lag_s
    over = max(speed - a * tau, 0.0)
    # under the knee a tau it is tau w; above it (w^2 + (a tau)^2) / (2 a), which is tau w + (w - a
    # tau)^2 / (2 a)
    return tau * speed + over * over / (2 * a)
