"""Where a formation is planned to stand between two steps of its group (`GroupPlan.formations`),
and the frame that all its agents share in flight.

The agents' shared frame, the plan's checks, the forecast and the figures all ask here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from swarm_ctl.core.model.geometry import Point, centred, mean_of, turned
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


@dataclass(frozen=True, slots=True)
class PlannedFormation:
    """The formation between two steps; the law alone keeps its centre only roughly."""

    slots: tuple[Point, ...]
    """The newest form step's, in the order of the group's agents [units]; at first the starts."""
    unit_m: float
    centre_m: Point
    """In the common frame."""
    angle_rad: float = 0.0
    """Clockwise from `slots`."""
    scale: float = 1.0
    """Relative to `slots`."""
    height_m: float = 0.0
    formed: bool = False
    """A form step is done."""
    ups_m: tuple[float, ...] = ()
    """How far above `height_m` each slot is; (): all are at it."""

    @classmethod
    def at_start(
        cls,
        starts: Sequence[Point],
        unit_m: float,
        height_m: float = 0.0,
        ups_m: tuple[float, ...] = (),
    ) -> PlannedFormation:
        """No shape yet; `starts` in units, in the order of the group's agents."""
        north, east = mean_of(starts)
        centre_m = north * unit_m, east * unit_m
        return cls(tuple(starts), unit_m, centre_m, height_m=height_m, ups_m=ups_m)

    @property
    def offsets(self) -> tuple[Point, ...]:
        """The slots as they stand now [units]: turned, scaled, their mean at zero."""
        return tuple(turned(slot, self.angle_rad, self.scale) for slot in centred(self.slots))

    @property
    def places(self) -> list[Point]:
        """Each agent's place in the common frame [units]."""
        north, east = self.centre_m[0] / self.unit_m, self.centre_m[1] / self.unit_m
        return [(north + n, east + e) for n, e in self.offsets]

    def places_m(self, centre_m: Point | None = None) -> list[Point]:
        """Each agent's place in the common frame, with the centre here or at `centre_m`."""
        (north, east), unit = centre_m or self.centre_m, self.unit_m
        return [(north + n * unit, east + e * unit) for n, e in self.offsets]

    @property
    def heights_m(self) -> list[float]:
        """Of each agent's place, above its take-off point."""
        return [self.height_m + up_m for up_m in self.ups_m or (0.0,) * len(self.slots)]

    @property
    def span_m(self) -> tuple[float, float]:
        """Its lowest and its highest place."""
        return min(self.heights_m), max(self.heights_m)

    @property
    def radius_m(self) -> float:
        """From the centre to the outermost agent."""
        return max(math.hypot(*offset) for offset in self.offsets) * self.unit_m
