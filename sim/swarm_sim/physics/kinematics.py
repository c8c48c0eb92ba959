"""How a multirotor moves: pure numpy, batched over leading axes (missions, vehicles; at least one);
last axis NED.

`advance` moves a `MotionState` by one time step towards `Demands`. What lies between a velocity
target and the acceleration that follows is the *velocity response*, one replaceable object
(`swarm_sim.physics.response`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

GRAVITY_MPS2 = 9.80665


class VelocityResponse(Protocol):
    """From velocity target to acceleration.

    `memory` (..., memory_rows, 3) is the controller's own state, zero for a vehicle at rest;
    changed in place.
    """

    @property
    def memory_rows(self) -> int:
        """Rows of `memory`."""

    @property
    def path_row(self) -> int | None:
        """The row of `memory` with the way to where the velocities lead, by the estimated place:
        it bounds how far a wrong velocity carries; None: the velocity alone is followed."""

    def acceleration(
        self, memory: Array, velocity: Array, target: Array, wind: Array, dt: float
    ) -> Array:
        """Acceleration [m/s2] (..., 3) during the next `dt`, for velocities [m/s] (..., 3)."""


@dataclass(slots=True)
class MotionState:
    """Kinematics of a batch. NED in metres from one common origin; arrays (..., 3) or (...)."""

    position: Array
    velocity: Array
    acceleration: Array
    heading: Array
    """[rad] clockwise from north."""
    landed: Mask
    ground: Array
    """Down coordinate [m] of the ground under each vehicle."""
    memory: Array
    wind: Array
    drift: Array
    """Error [m/s] of the velocity estimate that the controller follows: true minus estimated."""
    impact: Array
    """Speed [m/s] at the last touch-down."""

    @staticmethod
    def at_rest(
        position: Array, response: VelocityResponse, heading: Array | None = None
    ) -> MotionState:
        """A batch that stands on the ground at `position` (..., 3)."""
        position = np.array(position, dtype=np.float64)
        batch = position.shape[:-1]
        return MotionState(
            position=position,
            velocity=np.zeros_like(position),
            acceleration=np.zeros_like(position),
            heading=np.zeros(batch) if heading is None else np.array(heading, dtype=np.float64),
            landed=np.ones(batch, dtype=np.bool_),
            ground=position[..., 2].copy(),
            memory=np.zeros((*batch, response.memory_rows, 3)),
            wind=np.zeros_like(position),
            drift=np.zeros_like(position),
            impact=np.zeros(batch),
        )


@dataclass(slots=True)
class Demands:
    """What the firmware wants of each vehicle of a batch; arrays (..., 3) or (...)."""

    velocity: Array
    """[m/s]; feed-forward where the axis is held."""
    position: Array
    """[m]; only where `hold` is 1."""
    hold: Array
    """1 where the axis has a position target, else 0."""
    speed: Array
    """Bounds [m/s] on the velocity that a position target asks for: horizontal, climb, descent."""
    climb: Array
    descent: Array
    heading: Array
    lift: Mask
    """Motors carry the vehicle, which takes off when asked to climb; without, it falls."""

    @staticmethod
    def idle(state: MotionState) -> Demands:
        """Motors off, for the batch of `state`."""
        batch = state.landed.shape
        return Demands(
            velocity=np.zeros_like(state.position),
            position=np.zeros_like(state.position),
            hold=np.zeros_like(state.position),
            speed=np.full(batch, 5.0),
            climb=np.full(batch, 2.5),
            descent=np.full(batch, 1.5),
            heading=state.heading.copy(),
            lift=np.zeros(batch, dtype=np.bool_),
        )


def some(mask: Mask) -> bool:
    """`mask.any()`, in a tenth of the time for a few vehicles."""
    return 1 in mask.tobytes()


def advance(state: MotionState, demands: Demands, response: VelocityResponse, dt: float) -> None:
    """Moves `state` by `dt` [s] in place, by semi-implicit Euler steps."""
    target = velocity_target(state, demands)
    # a vehicle lifts off once it is asked to climb
    state.landed &= ~(demands.lift & (target[..., 2] < -_LIFT_OFF_MPS))
    standing = np.count_nonzero(state.landed)
    if standing == state.landed.size:
        return
    velocity, wind = state.velocity, state.wind
    if np.count_nonzero(state.drift):
        if response.path_row is None:
            target = target + state.drift
        else:  # in all that the controller knows, air too, but the place
            velocity, wind = velocity - state.drift, wind - state.drift
            state.memory[..., response.path_row, :] -= state.drift * dt
    acceleration = response.acceleration(state.memory, velocity, target, wind, dt)
    _fall(state, demands, acceleration)
    if standing:
        _stand(state, acceleration)
    state.acceleration = acceleration
    state.velocity = state.velocity + acceleration * dt
    state.position = state.position + state.velocity * dt
    _turn(state, demands, dt)
    _touch_down(state)


def velocity_target(state: MotionState, demands: Demands) -> Array:
    """The velocity [m/s] (..., 3) that brings held axes to their positions, to stop there."""
    if not np.count_nonzero(demands.hold):
        return demands.velocity
    # horizontally along the straight line, never faster than the demand's speed
    gap = demands.hold * (demands.position - state.position)
    target = demands.velocity.copy()
    distance = np.hypot(gap[..., 0], gap[..., 1])
    speed = np.minimum(_approach(distance, _HOLD_XY_PER_S, _HOLD_XY_MPS2), demands.speed)
    target[..., :2] += gap[..., :2] * (speed / np.maximum(distance, 1e-9))[..., None]
    # vertically within the rates of climb and descent
    height = gap[..., 2]
    rate = _approach(np.abs(height), _HOLD_Z_PER_S, _HOLD_Z_MPS2)
    target[..., 2] += np.clip(np.copysign(rate, height), -demands.climb, demands.descent)
    return target


# Outer position loop: gains so low that the slowest response follows almost without overshoot.
_HOLD_XY_PER_S, _HOLD_XY_MPS2 = 0.5, 1.0
_HOLD_Z_PER_S, _HOLD_Z_MPS2 = 0.7, 0.45
_LIFT_OFF_MPS = 0.01
_TURN_RADPS = math.radians(60.0)
_FALL_DRAG_PER_S = 0.3


def _approach(distance: Array, gain: float, deceleration: float) -> Array:
    """Speed at `distance` from the goal: linear near it, constant deceleration farther away."""
    return np.minimum(gain * distance, np.sqrt(2.0 * deceleration * distance))


def _fall(state: MotionState, demands: Demands, acceleration: Array) -> None:
    falling = ~(demands.lift | state.landed)
    if some(falling):
        # gravity and the drag of the air; the controller starts afresh
        acceleration[falling] = -_FALL_DRAG_PER_S * (state.velocity - state.wind)[falling]
        acceleration[falling, 2] += GRAVITY_MPS2
        state.memory[falling] = 0.0


def _stand(state: MotionState, acceleration: Array) -> None:
    acceleration[state.landed] = 0.0
    state.velocity[state.landed] = 0.0
    state.memory[state.landed] = 0.0


def _turn(state: MotionState, demands: Demands, dt: float) -> None:
    if some(state.heading != demands.heading):
        # the shorter way round, at the turn rate; a vehicle on the ground keeps its heading
        error = np.remainder(demands.heading - state.heading + math.pi, 2 * math.pi) - math.pi
        step = np.clip(error, -_TURN_RADPS * dt, _TURN_RADPS * dt)
        state.heading = state.heading + np.where(state.landed, 0.0, step)


def _touch_down(state: MotionState) -> None:
    touched = (
        (state.position[..., 2] >= state.ground) & (state.velocity[..., 2] >= 0.0) & ~state.landed
    )
    if some(touched):
        # stands at the height of its ground, at rest
        state.landed |= touched
        state.impact[touched] = np.linalg.norm(state.velocity[touched], axis=-1)
        state.position[..., 2] = np.where(touched, state.ground, state.position[..., 2])
        state.velocity[touched] = 0.0
        state.acceleration[touched] = 0.0
        state.memory[touched] = 0.0
