"""What an estimator says after its GPS has jumped, timed on a real ArduCopter 4.7 (4.4 m). Pure."""

from __future__ import annotations

import math

from swarm_sim.firmware.parameters.parameter_set import Parameters
from swarm_sim.physics.geodesy import Vector3

RATIO_PER_M = 0.265
"""Of the horizontal test ratio: over 1 (3.8 m) the estimator refuses the GPS."""
_REFUSES_S, _FLAGGED_S = 7.0, (1.5, 17.0)
"""Until it takes the new place after all; from when until when it flags a glitch."""


class GpsJump:
    """The last jump of one vehicle's GPS (SIM_GPS_JUMP_*)."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._place = self._read()
        self._since_s, self._ratio = -math.inf, 0.0

    def ratio(self, now: float) -> float:
        """The horizontal position's test ratio; a small jump is taken at once."""
        place = self._read()
        if place != self._place:
            self._since_s, self._ratio = now, RATIO_PER_M * math.dist(place, self._place)
            self._place = place
        lasts_s = _REFUSES_S if self._ratio > 1.0 else 0.5
        return max(0.01, self._ratio) if now - self._since_s < lasts_s else 0.01

    def flagged(self, now: float) -> bool:
        """Whether it says that there is a glitch."""
        return self._ratio > 1.0 and _FLAGGED_S[0] <= now - self._since_s < _FLAGGED_S[1]

    def _read(self) -> Vector3:
        north, east, down = (self._parameters[f"SIM_GPS_JUMP_{axis}"] for axis in "NED")
        return north, east, down
