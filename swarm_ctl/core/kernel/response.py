"""How late a vehicle answers, estimated in flight, and its stop point with that.

The model (`Coast`, docs/understand/law.md#from-units-to-a-vehicle; metres and seconds) is flown
beside the vehicle by the same setpoints. A vehicle that
answers `late_s` later than the model falls behind it by `late_s` times its velocity. So `late_s` is
a regression of the one on the other, with what is slow (wind, a position that wanders) taken out of
both:

    late_s = sum(behind . v) / (sum(|v|^2) + 0.1 m^2/s), behind = x_model - x

It counts as dead time: the vehicle has yet to fly setpoints that the model takes for flown, and
comes to rest after all of these, its limit of acceleration counted. Where that would be less than
no dead time, the rest is taken from the lag. A dead time is found to 0.1 s. A lag that differs from
the model's is found only as far as it acts like a dead time, in long legs.

`doubt_s` is by how much the response may still be off. It starts with the model's own doubt and
falls as the vehicle moves, so an agent that has not flown yet is careful near others
(`core/kernel/constraints.py`).

`sent` is a ring of the newest setpoints: the k-th since the start stands at k modulo its length.
Metres, seconds.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence, Sequence
from typing import Final, NamedTuple

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
    size = abs(dv)
    if size > model.bound or part != 1.0:  # mostly not, and a quotient is slow
        dv = dv * (part * model.bound / max(size, model.bound))
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


LATEST_S: Final = 1.0
"""A vehicle that answers later than its model by more than this is not compensated for more."""
SLOW_S: Final = 1.0
"""Changes that take longer than this are not the response's. At 3 s, a real PX4 whose integrator
creeps for seconds was taken for 1 s late in a long leg."""
_UNTRUSTED_M2PS: Final = 0.1
"""So much motion [m^2/s] halves the doubt: 1 m/s for a tenth of a second. With 0.5, two that flew
at each other and answered 0.5 s late were too near before either knew (`studies/late-pair.yaml`:
0.38 units instead of 0.60)."""
_KEPT_M2PS: Final = 30.0
"""Older motion than this is forgotten in its favour."""
_LEAST_DOUBT_S: Final = 0.05
_JUMP_M: Final = 1.0
"""A position that moves so far in one tick was corrected, not flown."""


class ResponseModel(NamedTuple):
    """What is believed of a vehicle at first."""

    dead_time_s: float
    lag_s: float
    doubt_s: float
    coast: Coast
    pending: int
    """Setpoints inside the dead time."""
    remembered: int
    """Length of the ring of setpoints."""


class Estimate(NamedTuple):
    """What is believed of it now."""

    late_s: float
    """It answers later than the model by this; less than 0: earlier."""
    doubt_s: float
    """By how much model and `late_s` may still be off."""
    moved: float
    agreed: float
    sent: int
    """Setpoints since the start."""
    begun: bool
    """The model flies beside it."""
    place: complex
    """Of the model, as the next."""
    velocity: complex
    slow_velocity: complex
    behind: complex
    slow_behind: complex


def model_of(vehicle: Response, tick_s: float) -> ResponseModel:
    """For one setpoint a tick."""
    under_way = pending(vehicle, tick_s)
    latest = math.ceil((vehicle.dead_time_s + LATEST_S) / tick_s)
    remembered = max(under_way, latest) + 1
    coast = coast_of(vehicle, tick_s)
    return ResponseModel(
        vehicle.dead_time_s, vehicle.lag_s, vehicle.doubt_s, coast, under_way, remembered
    )


def unknown(model: ResponseModel) -> Estimate:
    """Nothing of it was seen yet."""
    return Estimate(
        late_s=0.0,
        doubt_s=model.doubt_s,
        moved=0.0,
        agreed=0.0,
        sent=0,
        begun=False,
        place=0j,
        velocity=0j,
        slow_velocity=0j,
        behind=0j,
        slow_behind=0j,
    )


def response_s(estimate: Estimate, model: ResponseModel) -> float:
    """From a setpoint to the flown velocity: dead time and lag together."""
    return model.dead_time_s + model.lag_s + estimate.late_s


def afresh(estimate: Estimate) -> Estimate:
    """The model flies from where the vehicle is at the next look."""
    late_s, doubt_s, moved, agreed, sent, _, _, _, _, _, _ = estimate
    return Estimate(
        late_s=late_s,
        doubt_s=doubt_s,
        moved=moved,
        agreed=agreed,
        sent=sent,
        begun=False,
        place=0j,
        velocity=0j,
        slow_velocity=0j,
        behind=0j,
        slow_behind=0j,
    )


def steered(
    estimate: Estimate, setpoint: complex, sent: MutableSequence[complex], model: ResponseModel
) -> Estimate:
    """A setpoint [m/s] was sent, and goes into the ring: the model flies one tick."""
    late_s, doubt_s, moved, agreed, count, begun, place, velocity, slow, behind, slow_behind = (
        estimate
    )
    sent[count % model.remembered] = setpoint
    if begun:
        acting = sent[(count - model.pending) % model.remembered]
        place, velocity = coasted(place, velocity, acting, 1.0, model.coast)
    count += 1
    return Estimate(
        late_s=late_s,
        doubt_s=doubt_s,
        moved=moved,
        agreed=agreed,
        sent=count,
        begun=begun,
        place=place,
        velocity=velocity,
        slow_velocity=slow,
        behind=behind,
        slow_behind=slow_behind,
    )


def compared(
    estimate: Estimate, position: complex, velocity: complex, model: ResponseModel
) -> Estimate:
    """Take one tick in: where the vehicle is now, and how it moves. Call it once a tick."""
    _, _, moved, agreed, count, begun, place, flown, slow_velocity, before, slow_behind = estimate
    if not begun:
        place, flown, slow_velocity = position, velocity, velocity
    behind = place - position
    moving = 0.5 * (velocity + flown)
    if abs(behind - before) > _JUMP_M:
        # a jump moves the level that it starts from as well
        slow_behind = slow_behind + (behind - before)
    off, moves = behind - slow_behind, moving - slow_velocity
    tick_s = model.coast.tick_s
    share = tick_s / SLOW_S
    slow_behind = slow_behind + off * share
    slow_velocity = slow_velocity + moves * share
    moved = moved + (moves * moves.conjugate()).real * tick_s
    agreed = agreed + (off * moves.conjugate()).real * tick_s
    kept = _KEPT_M2PS / max(moved, _KEPT_M2PS)
    moved, agreed = moved * kept, agreed * kept
    sure = 1.0 / (moved + _UNTRUSTED_M2PS)
    late_s = min(LATEST_S, max(-LATEST_S, agreed * sure))
    least = min(_LEAST_DOUBT_S, model.doubt_s)
    doubt_s = least + (model.doubt_s - least) * _UNTRUSTED_M2PS * sure
    begun = True
    return Estimate(
        late_s=late_s,
        doubt_s=doubt_s,
        moved=moved,
        agreed=agreed,
        sent=count,
        begun=begun,
        place=place,
        velocity=flown,
        slow_velocity=slow_velocity,
        behind=behind,
        slow_behind=slow_behind,
    )


def stop_point(
    estimate: Estimate,
    position: complex,
    velocity: complex,
    sent: Sequence[complex],
    model: ResponseModel,
) -> complex:
    """Where the vehicle would come to rest [m], from where it is now [m], [m/s]."""
    late_s = estimate.late_s + model.dead_time_s
    dead_s = max(0.0, late_s)
    ticks = dead_s / model.coast.tick_s
    x, v = position, velocity
    # the setpoints that have yet to act, oldest first; of a number with a fraction, the oldest acts
    # for that
    most = math.ceil(ticks)
    k = (estimate.sent - most) % model.remembered
    for ago in range(most, 0, -1):
        part = 1.0
        if ago > ticks:
            part = max(0.0, min(1.0, ticks - (ago - 1)))
        x, v = coasted(x, v, sent[k], part, model.coast)
        k += 1
        if k == model.remembered:
            k = 0
    quicker_s = late_s - dead_s
    return rest(x, v, model.coast) + quicker_s * velocity
