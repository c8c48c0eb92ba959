"""Where a formation is planned to stand between two steps of its group (`GroupPlan.formations`).

The agents' shared frame, the plan's checks, the forecast and the figures all ask here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from swarm_ctl.core.model.geometry import Point, centred, mean_of, turned


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
