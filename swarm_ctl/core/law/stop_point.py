"""The stop point: where a vehicle would come to rest if it were told to stop now
(docs/understand/law.md#from-units-to-a-vehicle).

Seen from it, a vehicle with dead time and lag is a single integrator again: `ds/dt = v_cmd`, which
is what the paper's law assumes. Exact for dead time plus first-order lag; measured, not proven,
under the acceleration limit. `core/kernel/coast.py` has the formulas.
"""

from __future__ import annotations

from collections.abc import Iterable

from swarm_ctl.core.kernel.coast import coast_of, coasted, rest
from swarm_ctl.core.model.plan import Response


def stop_point(
    position: complex,
    velocity: complex,
    commands: Iterable[complex],
    tick_s: float,
    vehicle: Response,
) -> complex:
    """Where a vehicle ends up [m] if zero velocity is commanded from now on.

    Args:
        position: now [m].
        velocity: now [m/s].
        commands: those still in the dead time [m/s], oldest first, one per `tick_s`.
        tick_s: between two of them.
        vehicle: dead time, lag, acceleration limit.
    """
    coast = coast_of(vehicle, tick_s)
    for acting in commands:
        position, velocity = coasted(position, velocity, acting, 1.0, coast)
    return rest(position, velocity, coast)
