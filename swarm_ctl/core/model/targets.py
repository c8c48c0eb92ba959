"""Targets that a formation follows: where news of them comes from, and what is known of one."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from swarm_ctl.core.model.geometry import Point

PREDICTED_S: Final = 1.0
"""After the last word of a target its motion is carried on for so long; after that of a receiver
that speaks seldom, half as long again as from one word to the next. Then the formation brakes, and
stands."""
SELDOM_S: Final = 1.2
"""A receiver that speaks less often than this is not waited for."""
STANDS_MPS: Final = 0.5
"""A target that is slower has no course."""
LATE_S: Final = 1.0
"""A word that was older when it came counts as so old."""
CLEAR_M: Final = 5.0
"""A target whose height is known is kept clear of within so much of the own height."""


@dataclass(frozen=True, slots=True)
class TargetPlan:
    """A target of a mission. Without `way_m`, `adsb` and `agent`, only words on the mesh tell of it
    (`swarm-ctl target`)."""

    name: str
    way_m: tuple[Point, ...] = ()
    """A target that the swarm itself plays, for tests: along these points of the common frame."""
    speed_mps: float = 0.0
    """Of a target that is played."""
    adsb: int = 0
    """The ICAO address under which the vehicles' own receivers hear it; 0: none."""
    agent: int = 0
    """The agent of the plan that it is; 0: none."""
    height_m: float | None = None
    """Above the origin; None: as it is told."""

    def played(self, seconds: float) -> tuple[Point, Point]:
        """Where a played target is after so long, and its velocity; at the end it stands."""
        left_m = max(0.0, seconds) * self.speed_mps
        for a, b in itertools.pairwise(self.way_m):
            leg_m = math.dist(a, b)
            if left_m < leg_m:
                north, east = (b[0] - a[0]) / leg_m, (b[1] - a[1]) / leg_m
                at = (a[0] + north * left_m, a[1] + east * left_m)
                return at, (north * self.speed_mps, east * self.speed_mps)
            left_m -= leg_m
        return self.way_m[-1], (0.0, 0.0)


class TargetNow(NamedTuple):
    """What is known of a target at one moment; a point is north + 1j * east in the common frame."""

    at: complex
    """Where it is now, by all that was told [m]."""
    velocity: complex
    """[m/s]"""
    turns: float
    """How fast its course turns, to the east [rad/s]."""
    course: complex
    """The unit vector of its course; of one that stands, the last one."""
    age_s: float
    """Of the newest word that was believed."""
    late_s: float
    """So old that word was when it came, `LATE_S` at most."""
    lasts_s: float
    """Its motion is carried on for so long after that."""
    accuracy_m: float
    height_m: float | None
    """Above the origin; None: not known."""
    on_ground: bool = False
    """It flies, and stands on the ground now."""

    @property
    def fresh(self) -> bool:
        """It was heard a moment ago: the formation flies after it."""
        return self.age_s - self.late_s <= self.lasts_s

    def ahead(self, seconds: float) -> tuple[complex, complex, complex]:
        """Place, velocity and course so much later, in a circle at constant speed."""
        turn = complex(math.cos(self.turns * seconds), math.sin(self.turns * seconds))
        if abs(self.turns) < 1e-3:
            return self.at + self.velocity * seconds, self.velocity * turn, self.course * turn
        way = self.velocity * (turn - 1.0) / complex(0.0, self.turns)
        return self.at + way, self.velocity * turn, self.course * turn
