"""The frame that all agents of a formation share."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.rows import row


@row
class Frame:
    """Where the formation as a whole is to be: its centre [m], and how the slots of the last form
    step are turned and scaled."""

    point_m: Point
    angle_rad: float = 0.0
    scale: float = 1.0
    leg: int = 0
    """Waypoints passed."""
    rate: float = 0.0
    """Speed now, as a share of the step's."""
    velocity_mps: Point = (0.0, 0.0)
    """Of the centre, where a target leads it: no step tells that."""

    def stopped(self) -> Frame:
        """The same, standing."""
        return replace(self, rate=0.0, velocity_mps=(0.0, 0.0))

    def flown_on(self, seconds: float) -> Frame:
        """So much later, where a target leads it."""
        if self.velocity_mps == (0.0, 0.0):
            return self
        (north, east), (v_north, v_east) = self.point_m, self.velocity_mps
        return replace(self, point_m=(north + v_north * seconds, east + v_east * seconds))


class Motion(NamedTuple):
    """How a frame moves now; horizontal vectors are north + 1j * east."""

    velocity: complex = 0j
    """Of its centre [m/s]."""
    spin: complex = 0j
    """How it grows and turns about its centre [1/s]."""

    def of(self, place: complex) -> complex:
        """The velocity of a place so far from the centre."""
        return self.velocity + self.spin * place


STILL: Final = Motion()
