"""How the swarms of a batch move: the ideal points of the paper, or simulated vehicles.

The vehicles' kinematics are the simulator's own (`swarm_sim.physics`), the one thing that this side
imports of it: they are pure, and with other vehicles a study would prove nothing about runs.
"""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np

from swarm_ctl.core.law.response_estimate import ResponseEstimate
from swarm_ctl.core.model.arrays import MANY, Bools, Floats, Indices, complex_of_last, keep_missions
from swarm_ctl.core.model.plan import Compensation
from swarm_ctl.study.batch.batch import Batch
from swarm_sim.physics import response as firmware
from swarm_sim.physics.kinematics import Array, Demands, MotionState, VelocityResponse, advance

_SUBSTEPS: Final = {"lag": 1, "ardupilot": 4, "px4": 4}
"""Physics steps a tick: the firmwares' fastest lags are 0.05 s."""


class BatchMotion(Protocol):
    """Where the swarms are, and how a commanded velocity moves them. Lengths in units, (2, n,
    m)."""

    @property
    def position(self) -> Floats:
        """True positions."""

    @property
    def velocity(self) -> Floats:
        """The setpoints that agents tell [units/s]."""

    @property
    def doubt_s(self) -> Floats:
        """Each agent's of its own vehicle's response (n, m)."""

    @property
    def response_s(self) -> Floats:
        """What each agent believes and tells of it (n, m)."""

    def points(self) -> Floats:
        """What the law is fed with; call it once a tick."""

    def move(self, wish: Floats) -> None:
        """Fly one tick at `wish` [units/s]."""

    def only(self, missions: Bools) -> None:
        """Go on with some of the missions."""


class IdealMotion:
    """Single integrators: p <- p + tick * v. With v = kappa * u and kappa * tick = 1 that is
    (9)."""

    def __init__(self, batch: Batch) -> None:
        self.position = batch.starts.copy()
        self.velocity = np.zeros_like(self.position)
        self._tick_s = batch.cell.tick_s

        self.doubt_s = self.response_s = np.zeros(self.position.shape[1:])

    def points(self) -> Floats:
        """The positions."""
        return self.position

    def move(self, wish: Floats) -> None:
        self.velocity = wish
        self.position = self.position + wish * self._tick_s

    def only(self, missions: Bools) -> None:
        keep_missions(self, missions, "position", "velocity", "doubt_s", "response_s")


class LagResponse:
    """A first-order lag with bounded acceleration, (m, n) each: the model behind the stop point."""

    memory_rows = 0

    def __init__(self, lag_s: Floats, acceleration_mps2: Floats, dt: float) -> None:
        self._per_s = (-np.expm1(-dt / np.maximum(lag_s, 1e-6)) / dt)[..., None]
        self._bound = acceleration_mps2

    def acceleration(
        self, memory: Array, velocity: Array, target: Array, wind: Array, dt: float
    ) -> Array:
        """See `swarm_sim.physics.kinematics.VelocityResponse`; knows no wind, and one `dt`."""
        del memory, wind, dt
        wanted = (target - velocity) * self._per_s
        size = np.sqrt(wanted[..., 0] ** 2 + wanted[..., 1] ** 2)
        return np.asarray(wanted * (self._bound / np.maximum(size, self._bound))[..., None])

    def only(self, missions: Bools) -> None:
        """Go on with some of the missions."""
        self._per_s, self._bound = self._per_s[missions], self._bound[missions]


class VehicleMotion:
    """Simulated vehicles behind a dead time, the agents' speed limit and, if asked for, the stop
    point."""

    def __init__(self, batch: Batch) -> None:
        cell = batch.cell
        self._cell, self._unit_m, self._tick_s = cell, cell.unit_m, cell.tick_s
        self._response: VelocityResponse = _response(batch)
        place = np.zeros((len(batch), cell.n, 3))
        place[..., :2] = batch.starts.transpose(2, 1, 0) * cell.unit_m
        place[..., 2] = -10.0
        self._state = MotionState.at_rest(place, self._response)
        self._state.landed[:] = False
        self._state.ground[:] = 0.0
        self._state.wind[..., :2] = (_direction(batch.wind_from_rad) * -batch.wind_mps).T[:, None]
        dead = batch.true_dead_time_s if cell.vehicle == "lag" else batch.late_s.clip(0.0)
        self._late = np.rint(dead.T / cell.tick_s).astype(np.intp)
        self._commands = np.zeros((int(self._late.max()) + 1, len(batch), cell.n, 2))
        """The last ones, newest last [m/s]."""
        self._acting = self._places()
        blank = np.zeros((len(batch), cell.n), dtype=np.complex128)
        self.estimate = ResponseEstimate(cell.model, cell.tick_s, blank, MANY)
        """What each agent believes of its own vehicle."""

    @property
    def position(self) -> Floats:
        return self._units(self._state.position[..., :2])

    @property
    def velocity(self) -> Floats:
        return self._units(self._commands[-1])

    @property
    def doubt_s(self) -> Floats:
        return np.asarray(self.estimate.doubt_s).T

    @property
    def response_s(self) -> Floats:
        return np.asarray(self.estimate.response_s).T

    def points(self) -> Floats:
        """Stop points, or positions without compensation."""
        if self._cell.compensation is Compensation.NONE:
            return self.position
        state = self._state
        found = self.estimate.stop_point(
            complex_of_last(state.position), complex_of_last(state.velocity)
        )
        return np.stack((found.real.T, found.imag.T)) / self._unit_m

    def move(self, wish: Floats) -> None:
        wanted = (wish * self._unit_m).transpose(2, 1, 0)
        speed = np.sqrt(wanted[..., 0] ** 2 + wanted[..., 1] ** 2)
        limit = self._cell.speed_mps
        self._commands[:-1] = self._commands[1:]
        self._commands[-1] = wanted * (limit / np.maximum(speed, limit))[..., None]
        self.estimate.sent(complex_of_last(self._commands[-1]))
        demands = Demands.idle(self._state)
        demands.lift[:] = True
        demands.velocity[..., :2] = self._commands.reshape(-1, 2).take(self._acting, axis=0)
        steps = _SUBSTEPS[self._cell.vehicle]
        for _ in range(steps):
            advance(self._state, demands, self._response, self._tick_s / steps)

    def only(self, missions: Bools) -> None:
        state = self._state
        for name in MotionState.__slots__:
            setattr(state, name, getattr(state, name)[missions])
        self._late = self._late[missions]
        self._commands = np.ascontiguousarray(self._commands[:, missions])
        self._acting = self._places()
        self.estimate.only(missions)
        if isinstance(self._response, LagResponse):
            self._response.only(missions)

    def _places(self) -> Indices:
        """Where in `_commands` the command is that now acts on each vehicle, (m, n)."""
        ago = (len(self._commands) - 1 - self._late) * self._late.size
        return ago + np.arange(self._late.size).reshape(self._late.shape)

    def _units(self, metres: Floats) -> Floats:
        return np.ascontiguousarray(metres.transpose(2, 1, 0)) / self._unit_m


def motion_of(batch: Batch) -> BatchMotion:
    """The motion that the batch's cell asks for."""
    return IdealMotion(batch) if batch.cell.vehicle == "ideal" else VehicleMotion(batch)


def _response(batch: Batch) -> VelocityResponse:
    match batch.cell.vehicle:
        case "ardupilot":
            return firmware.ArdupilotResponse()
        case "px4":
            return firmware.Px4Response()
        case _:
            return LagResponse(batch.true_lag_s.T, batch.acceleration_mps2.T, batch.cell.tick_s)


def _direction(angle_rad: Floats) -> Floats:
    return np.stack((np.cos(angle_rad), np.sin(angle_rad)))
