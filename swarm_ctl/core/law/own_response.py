"""How the own vehicle answers, as its agent believes it in flight (`core/kernel/response.py`)."""

from __future__ import annotations

from swarm_ctl.core.kernel.response import (
    afresh,
    compared,
    model_of,
    response_s,
    steered,
    stop_point,
    unknown,
)
from swarm_ctl.core.model.plan import Response


class OwnResponse:
    """Of one vehicle.

    Args:
        vehicle: what is believed at first.
        tick_s: between two setpoints.
    """

    def __init__(self, vehicle: Response, tick_s: float) -> None:
        self._model = model_of(vehicle, tick_s)
        self.estimate = unknown(self._model)
        self.restart()

    @property
    def late_s(self) -> float:
        """The vehicle answers later than the model by this; less than 0: earlier."""
        return self.estimate.late_s

    @property
    def doubt_s(self) -> float:
        """By how much model and `late_s` may still be off."""
        return self.estimate.doubt_s

    @property
    def response_s(self) -> float:
        """From a setpoint to the flown velocity: dead time and lag together."""
        return response_s(self.estimate, self._model)

    def restart(self) -> None:
        """The vehicle stands still or flies on its own: no setpoint is under way. The estimate
        stays."""
        self._sent = [0j] * self._model.remembered
        self.estimate = afresh(self.estimate)

    def rest(self) -> None:
        """In this tick no setpoint of ours steers the vehicle; those under way still act."""
        self.estimate = afresh(self.estimate)
        self.sent(0j)

    def sent(self, setpoint: complex) -> None:
        """A setpoint [m/s] was sent."""
        self.estimate = steered(self.estimate, setpoint, self._sent, self._model)

    def stop_point(self, position: complex, velocity: complex) -> complex:
        """Where the vehicle would come to rest [m], from where it is now [m], [m/s].

        Takes the tick into the estimate, so call it once a tick.
        """
        self.estimate = compared(self.estimate, position, velocity, self._model)
        return stop_point(self.estimate, position, velocity, self._sent, self._model)
