"""What a vehicle that has just left the ground has to fly against.

A PX4 that is flown by velocities meets the wind with an integrator that is still empty (and has to
be, on the ground). It fills slowly, `MPC_XY_VEL_I_ACC / MPC_XY_VEL_P_ACC` = 0.22 1/s as delivered.
Until then the wind takes the vehicle with it, by metres. So setpoints to it are more by what it
lacks, and less of that as its own integrator takes over.
"""

from __future__ import annotations

from typing import Final

from swarm_ctl.core.model.plan import Response

_PER_S: Final = 2.0
"""How fast what is missing is added [1/s]."""
_TAKES_OVER_S: Final = 4.5
"""The vehicle's integrator fills in this time by what is added: P over I of a PX4 as delivered."""
_MOST_MPS: Final = 3.0
"""More than this is no wind in which a swarm takes off."""


class Headwind:
    """The velocity that is added to the setpoints of one vehicle. Complex numbers north + 1j * east
    [m/s]."""

    def __init__(self, vehicle: Response, tick_s: float) -> None:
        self._tick_s = tick_s
        self._share = tick_s / (vehicle.dead_time_s + vehicle.lag_s + tick_s)
        self._expected = 0j
        self.added = 0j

    def rest(self) -> None:
        """The vehicle stands on the ground, or flies by itself."""
        self._expected = self.added = 0j

    def meet(self, setpoint: complex, flown: complex) -> complex:
        """What is added in this tick of a climb: the vehicle was told to fly `setpoint`, and is
        `flown`."""
        self._expected += self._share * (setpoint - self._expected)
        self.added += _PER_S * self._tick_s * (self._expected - flown)
        self.added *= _MOST_MPS / max(_MOST_MPS, abs(self.added))
        return self.added

    def fade(self) -> complex:
        """What is added in this tick of a flight after it."""
        self.added *= 1.0 - self._tick_s / _TAKES_OVER_S
        return self.added
