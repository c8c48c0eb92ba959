"""The stop point: where a vehicle would come to rest if it were told to stop now
(docs/pages/law.md#from-units-to-a-vehicle).

Seen from it, a vehicle with dead time and lag is a single integrator again: `ds/dt = v_cmd`, which
is what the paper's law assumes. Exact for dead time plus first-order lag; measured, not proven,
under the acceleration limit.

Written once for one vehicle (Python's complex numbers: a tenth of numpy's cost, this runs every
tick) and for arrays of them: a horizontal vector is the complex number north + 1j * east.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, Final

import numpy as np

from swarm_ctl.core.model.arrays import Floats, complex_of_last
from swarm_ctl.core.model.plan import Response

TYPICAL: Final = {
    "ardupilot": Response(dead_time_s=0.4, lag_s=0.62, acceleration_mps2=2.8),
    "px4": Response(dead_time_s=0.0, lag_s=0.8, acceleration_mps2=8.0),
}
"""By autopilot, at its own default parameters, by what was measured on real ones and what keeps
simulated ones apart (docs/pages/figures.md#real-autopilots). The PX4 follows a velocity unshaped,
so it starts at once; ArduCopter bounds jerk and acceleration, which acts like a dead time."""


def stop_points(
    position_m: Floats, velocity_mps: Floats, commands_mps: Floats, dt_s: float, vehicle: Response
) -> Floats:
    """Where vehicles end up if zero velocity is commanded from now on.

    Args:
        position_m: (..., 2), now.
        velocity_mps: (..., 2), now.
        commands_mps: (..., k, 2), the commands still in the dead time, oldest first, one per
        `dt_s`; k is
            `pending(vehicle, dt_s)`.
        dt_s: time between commands.
        vehicle: dead time, lag, acceleration limit.

    Returns:
        (..., 2) in metres.
    """
    commands = complex_of_last(commands_mps)
    acting = (commands[..., k] for k in range(commands.shape[-1]))
    coast = Coast(vehicle, dt_s, np.maximum)
    x = coast.rest(complex_of_last(position_m), complex_of_last(velocity_mps), acting)
    return np.stack((x.real, x.imag), axis=-1)


def stop_distance(speed_mps: Any, vehicle: Response, most: Callable[[Any, Any], Any] = max) -> Any:
    """How far a vehicle at `speed_mps` still goes once zero velocity acts on it [m]: full braking,
    then the lag.

    A float, or an array with `most=np.maximum`.
    """
    a, tau = vehicle.acceleration_mps2, vehicle.lag_s
    over = most(speed_mps - a * tau, 0.0)
    # under the knee a tau it is tau w; above it (w^2 + (a tau)^2) / (2 a), which is tau w + (w - a
    # tau)^2 / (2 a)
    return tau * speed_mps + over * over / (2 * a)


def pending(vehicle: Response, dt_s: float) -> int:
    """How many commands, one per `dt_s`, are inside the dead time."""
    return round(vehicle.dead_time_s / dt_s)


class Coast:
    """How the model flies setpoints and comes to rest. Complex scalars with `max`, arrays with
    `np.maximum`."""

    def __init__(
        self, vehicle: Response, dt_s: float, most: Callable[[Any, Any], Any] = max
    ) -> None:
        self._vehicle, self._dt_s, self._most = vehicle, dt_s, most
        self._share = -math.expm1(-dt_s / vehicle.lag_s)
        self._bound = vehicle.acceleration_mps2 * dt_s

    def tick(self, x: Any, v: Any, acting: Any, part: Any = 1.0) -> tuple[Any, Any]:
        """Place and velocity after `dt_s`, or a part of it, once `acting` acts."""
        dv = (acting - v) * self._share
        dv = dv * (part * self._bound / self._most(abs(dv), self._bound))
        return x + part * self._dt_s * (v + 0.5 * dv), v + dv

    def rest(self, x: Any, v: Any, under_way: Iterable[Any] = ()) -> Any:
        """Where it rests after the setpoints that are under way, oldest first."""
        for acting in under_way:
            x, v = self.tick(x, v, acting)
        speed = abs(v)
        distance = stop_distance(speed, self._vehicle, self._most)
        return x + v * (distance / self._most(speed, 1e-12))
