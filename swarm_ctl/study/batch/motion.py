"""How vehicles with a firmware move: the simulator's own kinematics (`swarm_sim.physics`), the one
thing that this side imports of it. They are pure, and with other vehicles a study would prove
nothing about runs. Ideal points and vehicles with a plain lag fly in `flight.py`.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from swarm_ctl.core.model.arrays import Bools, complex_of
from swarm_ctl.study.batch.batch import Batch
from swarm_ctl.study.batch.missions import Missions
from swarm_sim.physics import response as firmware
from swarm_sim.physics.kinematics import Demands, MotionState, VelocityResponse, advance

_SUBSTEPS: Final = 4
"""Physics steps a tick: the firmwares' fastest lags are 0.05 s."""


class FirmwareMotion:
    """The vehicles of a batch, (missions, agents)."""

    def __init__(self, batch: Batch, late_ticks: int) -> None:
        cell = batch.cell
        self._tick_s = cell.tick_s
        self._response: VelocityResponse = (
            firmware.Px4Response() if cell.vehicle == "px4" else firmware.ArdupilotResponse()
        )
        self._flying = np.arange(len(batch))
        place = np.zeros((len(batch), cell.n, 3))
        place[..., :2] = batch.starts.transpose(2, 1, 0) * cell.unit_m
        place[..., 2] = -10.0
        self._state = MotionState.at_rest(place, self._response)
        self._state.landed[:] = False
        self._state.ground[:] = 0.0
        from_rad = batch.wind_from_rad
        towards = np.stack((np.cos(from_rad), np.sin(from_rad))) * -batch.wind_mps
        self._state.wind[..., :2] = towards.T[:, None]
        self._commands = np.zeros((late_ticks + 1, len(batch), cell.n), dtype=np.complex128)
        """The last ones, newest last [m/s]."""

    def move(self, many: Missions) -> None:
        """Fly one tick, by the newest commands of the missions that are not over; tells places and
        velocities."""
        state, flying = self._state, self._flying
        self._commands[:-1] = self._commands[1:]
        self._commands[-1] = many.agent["command"][flying]
        ago = len(self._commands) - 1 - many.agent["late"][flying]
        acting = np.take_along_axis(self._commands, ago[None], axis=0)[0]
        demands = Demands.idle(state)
        demands.lift[:] = True
        demands.velocity[..., 0], demands.velocity[..., 1] = acting.real, acting.imag
        for _ in range(_SUBSTEPS):
            advance(state, demands, self._response, self._tick_s / _SUBSTEPS)
        many.agent["place_m"][flying] = complex_of(state.position)
        many.agent["velocity_mps"][flying] = complex_of(state.velocity)

    def only(self, flying: Bools) -> None:
        """Go on with those missions of all that still fly."""
        kept = flying[self._flying]
        for name in MotionState.__slots__:
            setattr(self._state, name, getattr(self._state, name)[kept])
        self._commands = np.ascontiguousarray(self._commands[:, kept])
        self._flying = self._flying[kept]
