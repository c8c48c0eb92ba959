"""Velocity responses: how each firmware's velocity controller, and the airframe behind it, follow a
target. Pure.

Their numbers are the firmware's default parameters; what those don't give (attitude lag, drag) was
fitted to recorded step responses. Arrays have any leading axes and a last axis (north, east, down).
Horizontal limits act on the length of the horizontal vector, as in the firmwares.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from swarm_sim.physics.kinematics import GRAVITY_MPS2, Array, Mask, some

Gains = tuple[float, float]
"""Horizontal, vertical."""


@functools.lru_cache(maxsize=64)
def _axes(gains: Gains) -> Array:
    """The same for north, east, down."""
    horizontal, vertical = gains
    return np.array([horizontal, horizontal, vertical])


@dataclass(frozen=True)
class IdealResponse:
    """The paper's single integrator: the velocity is the target's, at once."""

    memory_rows: int = 0
    path_row: None = None

    def acceleration(
        self, memory: Array, velocity: Array, target: Array, wind: Array, dt: float
    ) -> Array:
        del memory, wind
        return (target - velocity) / dt


@dataclass(frozen=True)
class LagResponse:
    """A dead time, then a first-order lag with bounded acceleration: the agents' own model of a
    vehicle, here what it truly does. Vertically it answers at once."""

    lag_s: float
    acceleration_mps2: float
    dead_steps: int = 0
    """The dead time, in steps."""
    climb_lag_s: float = 0.2
    climb_mps2: float = 3.0
    path_row: None = None

    @property
    def memory_rows(self) -> int:
        return self.dead_steps + 1

    def acceleration(
        self, memory: Array, velocity: Array, target: Array, wind: Array, dt: float
    ) -> Array:
        """Memory: the targets in the dead time, oldest first, and the acceleration. No wind."""
        del wind
        acting = target.copy()
        if self.dead_steps:
            acting[..., :2] = memory[..., 0, :2]
            memory[..., :-2, :] = memory[..., 1:-1, :]
            memory[..., -2, :] = target
        result = (acting - velocity) * _shares((self.lag_s, self.climb_lag_s), dt) / dt
        _bound(result, self.acceleration_mps2, self.climb_mps2)
        memory[..., -1, :] = result
        return result


@dataclass(frozen=True)
class ArdupilotResponse:
    """ArduCopter in GUIDED: `input_vel_accel` shapes the target, AC_PosControl's P-P-I follows the
    shaped one.

    Shaping (AP_Math `shape_vel_accel_xy`): acceleration towards the target proportional to the
    velocity error with gain jerk / acceleration, bounded by WPNAV_ACCEL (2.5), its change by
    PSC_JERK_XY (5). Following: PSC_POSXY_P 1 on the distance to where the shaped velocity would
    have led, PSC_VELXY_P 2, PSC_VELXY_I 1, lean angle at most 30 deg; at that limit nothing winds
    up (`update_pos_vel_accel_xy`, AC_PID_2D). No speed is refused; vertical ones over
    WPNAV_SPEED_UP and _DN (2.5, 1.5) are shaped faster (`calculate_overspeed_gain`). Airframe:
    linear drag of the rotors, quadratic drag of the frame so that 15 m/s needs 45 deg, as the SITL
    quad has; the lag of attitude and motors (two of 0.07 s) and the vertical gains are fitted to
    recorded steps.
    """

    memory_rows: int = 6
    path_row: int = 0
    acceleration_mps2: float = 2.5
    jerk_mps3: float = 5.0
    climb_mps2: float = 0.91
    climb_jerk_mps3: float = 5.0
    climb_mps: float = 2.5
    descent_mps: float = 1.5
    lean_mps2: float = GRAVITY_MPS2 * math.tan(math.radians(30.0))
    lift_mps2: float = 5.0
    lag_s: Gains = (0.07, 0.06)
    position_per_s: Gains = (1.0, 1.04)
    velocity_per_s: Gains = (2.0, 1.67)
    integral_per_s2: Gains = (1.0, 0.0)
    drag_per_s: Gains = (0.29, 0.0)
    drag_per_m: Gains = (0.024, 0.0)

    def acceleration(
        self, memory: Array, velocity: Array, target: Array, wind: Array, dt: float
    ) -> Array:
        """Memory: path error, shaped velocity and acceleration, integral, two lags."""
        self._shape(memory[..., 1, :], memory[..., 2, :], target, dt)
        # P on the distance to where the shaped velocity leads, then PI on the velocity
        error = memory[..., 1, :] - velocity
        memory[..., 0, :] += error * dt
        error += _axes(self.position_per_s) * memory[..., 0, :]
        integral = memory[..., 3, :]
        integral += _axes(self.integral_per_s2) * error * dt
        command = error * _axes(self.velocity_per_s)
        command += memory[..., 2, :]
        command += integral
        if (leaning := _bound(command, self.lean_mps2, self.lift_mps2)) is not None:
            self._unwind(memory[..., :2], error[..., :2], command[..., :2], leaning, dt)
        # attitude and motors lag behind; the air brakes
        force = _lag(memory[..., 4, :], memory[..., 5, :], command, _shares(self.lag_s, dt))
        air = velocity - wind
        speed = np.sqrt(np.einsum("...i,...i->...", air, air))[..., None]
        result: Array = force - air * (_axes(self.drag_per_s) + _axes(self.drag_per_m) * speed)
        return result

    def _unwind(
        self, memory: Array, error: Array, command: Array, leaning: Mask, dt: float
    ) -> None:
        """Takes back what this step added horizontally where the vehicle can't lean more."""
        path, shaped, acceleration, integral = (memory[..., row, :] for row in range(4))
        # the path error shrinks by what the shaped velocity has just added in that direction
        short = leaning & (_along(error, command) > 0.0)
        ahead = short & (_along(shaped, command) > 0.0) & (_along(path, command) > 0.0)
        path -= ahead[..., None] * shaped * dt
        # the same for the shaped velocity and its acceleration
        grown = short & (_along(acceleration, command) > 0.0) & (_along(shaped, command) >= 0.0)
        shaped -= grown[..., None] * acceleration * dt
        integral -= short[..., None] * (self.integral_per_s2[0] * dt) * error

    def _shape(self, velocity: Array, acceleration: Array, target: Array, dt: float) -> None:
        # acceleration proportional to the error, bounded, and its change bounded by the jerk
        faster = self._overspeed(velocity[..., 2])
        gain = (self.jerk_mps3 / self.acceleration_mps2, self.climb_jerk_mps3 / self.climb_mps2)
        wanted = (target - velocity) * _axes(gain)
        _bound(wanted, self.acceleration_mps2, self.climb_mps2 * faster)
        wanted -= acceleration
        _bound(wanted, self.jerk_mps3 * dt, self.climb_jerk_mps3 * faster * dt)
        acceleration += wanted
        velocity += acceleration * dt

    def _overspeed(self, down: Array) -> Array | float:
        """Factor on vertical acceleration and jerk: 1 within the speed limits, at most what the
        rotors lift."""
        if np.vdot(down, down) <= min(self.descent_mps, self.climb_mps) ** 2:
            return 1.0  # by one cheap sum, as nearly always
        over = np.maximum(down / self.descent_mps, -down / self.climb_mps)
        faster: Array = np.where(
            over > 1.0, np.minimum(2.0 * over, 0.7 * self.lift_mps2 / self.climb_mps2), 1.0
        )
        return faster


@dataclass(frozen=True)
class Px4Response:
    """PX4 in OFFBOARD: the velocity target goes to the PI controller unshaped, so the vehicle
    starts fast and ends slowly.

    MPC_XY_VEL_P_ACC 1.8, _I_ACC 0.4; MPC_Z_VEL_P_ACC 4, _I_ACC 2; tilt at most MPC_TILTMAX_AIR 45
    deg; target bounded by MPC_XY_VEL_MAX 12, MPC_Z_VEL_MAX_UP 3, _DN 1.5. Airframe: linear drag 1
    /s, as the SIH quadrotor has. Its attitude swings (14 rad/s, damping 0.65), and a target acts
    three steps later (0.06 s in the simulator, 0.04 s in a study's shorter ones): fitted to a real
    PX4 under sines of 0.2, 0.5, 1 and 1.6 Hz (gain 0.61, 0.45, 0.30, 0.19; phase -38, -76, -122,
    -188 deg). The vertical lag is fitted to steps.
    """

    memory_rows: int = 6
    path_row: None = None
    speed_mps: float = 12.0
    climb_mps: float = 3.0
    descent_mps: float = 1.5
    tilt_mps2: float = GRAVITY_MPS2
    lift_mps2: float = 6.0
    swing_radps: float = 14.0
    damping: float = 0.65
    lift_lag_s: float = 0.05
    velocity_per_s: Gains = (1.8, 4.0)
    integral_per_s2: Gains = (0.4, 2.0)
    drag_per_s: float = 1.0

    def acceleration(
        self, memory: Array, velocity: Array, target: Array, wind: Array, dt: float
    ) -> Array:
        """Memory: integral, the horizontal targets of three steps, lag or swing, force."""
        # the bounded target, minus the velocity, goes through a PI controller with bounded tilt
        error = target.copy()
        error[..., :2] = memory[..., 1, :2]
        memory[..., 1:3, :2] = memory[..., 2:4, :2]
        memory[..., 3, :2] = target[..., :2]
        _bound(error, self.speed_mps, self.climb_mps)
        np.minimum(error[..., 2], self.descent_mps, out=error[..., 2])
        error -= velocity
        integral = memory[..., 0, :]
        integral += _axes(self.integral_per_s2) * error * dt
        _bound(integral, self.tilt_mps2, self.lift_mps2)
        error *= _axes(self.velocity_per_s)
        error += integral
        _bound(error, self.tilt_mps2, self.lift_mps2)
        rate, force = memory[..., 4, :], memory[..., 5, :]
        share = -math.expm1(-dt / self.lift_lag_s)
        _lag(rate[..., 2], force[..., 2], error[..., 2], share)
        self._swing(rate[..., :2], force[..., :2], error[..., :2], dt)
        return force - self.drag_per_s * (velocity - wind)

    def _swing(self, rate: Array, force: Array, command: Array, dt: float) -> None:
        """The tilt as a second-order system, in place; two steps of it in `dt` (0.02 s)."""
        for _ in range(2):
            pull = command - force - 2.0 * self.damping * rate
            rate += 0.5 * dt * self.swing_radps * pull
            force += 0.5 * dt * self.swing_radps * rate


def _along(vectors: Array, way: Array) -> Array:
    products: Array = np.einsum("...i,...i->...", vectors, way)
    return products


def _bound(vector: Array, horizontal: float, vertical: Array | float) -> Mask | None:
    """Shortens `vector` (..., 3) in place to a horizontal length and a vertical size.

    Returns a mask of those that were too long horizontally, or None.
    """
    least = vertical.min() if isinstance(vertical, np.ndarray) else vertical
    if np.vdot(vector, vector) <= min(horizontal, least) ** 2:
        return None  # one cheap sum shows that no vector is near its bound: the usual case
    length = np.hypot(vector[..., 0], vector[..., 1])
    long: Mask = length > horizontal
    any_long = some(long)
    if any_long:
        np.maximum(length, horizontal, out=length)
        vector[..., :2] *= (horizontal / length)[..., None]
    down = vector[..., 2]
    np.minimum(down, vertical, out=down)
    np.maximum(down, -vertical, out=down)
    return long if any_long else None


@functools.lru_cache(maxsize=64)
def _shares(lag_s: Gains, dt: float) -> Array:
    """The share of the way to a constant input that a first-order lag goes in `dt`."""
    return -np.expm1(-dt / _axes(lag_s))


def _lag(first: Array, second: Array, command: Array, share: Array | float) -> Array:
    """Two first-order lags in a row, changed in place; exact for a constant command."""
    first += share * (command - first)
    second += share * (first - second)
    return second
