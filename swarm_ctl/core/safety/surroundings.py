"""The walls around one vehicle: of the zones that are in its way, and of the fence. A point is the
complex number north + 1j * east in the common frame."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Final

from swarm_ctl.core.kernel.decide import NearWall
from swarm_ctl.core.kernel.walls import FENCE, Edge, Wall, faced, wall_margins_of
from swarm_ctl.core.model.plan import Fence, Plan, Response
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.safety.fence import inside

FENCE_NAME: Final = "the fence"
_NONE: Final[list[NearWall]] = []


class Outline:
    """The edges of one zone, or of the fence (`within`). `corners`: of a circle its middle."""

    def __init__(self, corners: Sequence[complex], radius: float, *, within: bool = False) -> None:
        self._corners = tuple((corner.real, corner.imag) for corner in corners)
        ends = (*corners[1:], *corners[:1])
        self._edges = tuple(
            Edge(first, last, radius) for first, last in zip(corners, ends, strict=True)
        )
        self._within = within
        self._middle = sum(corners) / len(corners)
        around = max(abs(corner - self._middle) for corner in corners)
        self._radius = around + radius

    def least(self, point: complex) -> float:
        """It is no nearer to the point than this, by a quick look."""
        if self._within:
            return -math.inf
        return abs(point - self._middle) - self._radius

    def walls(self, point: complex, about: int) -> list[Wall]:
        """What each edge is to the point; from the wrong side, the nearest alone."""
        found = [Wall(*faced(edge, point), about) for edge in self._edges]
        if len(found) < 3:
            return found
        if inside(self._corners, (point.real, point.imag)) is not self._within:
            normal, gap, _ = min(found, key=lambda wall: wall.gap)
            return [Wall(-normal, -gap, about)]
        # two edges that meet have their corner in common
        apart = {_millimetres(point - wall.normal * wall.gap): wall for wall in found}
        return list(apart.values())


_margins_of = functools.lru_cache(maxsize=64)(wall_margins_of)
"""They take a millisecond, and all checks and agents of a plan ask for the same."""


class Surroundings:
    """All walls of a plan. `response` and `speed_mps` are those of the vehicle that keeps off;
    points and distances are in units of `scale_m`, heights in metres."""

    def __init__(
        self,
        zones: Sequence[Zone],
        fence: Fence | None,
        response: Response,
        speed_mps: float,
        scale_m: float = 1.0,
    ) -> None:
        self._zones = tuple(zones)
        found = [(FENCE, fence.polygon_m, 0.0, 0.0)] if fence and fence.polygon_m else []
        found += [(k, z.corners_m, z.radius_m, z.clearance_m) for k, z in enumerate(zones)]
        margins = {
            clearance: _margins_of(clearance, response, speed_mps, scale_m)
            for clearance in {each[-1] for each in found}
        }
        self._walls = [
            (
                about,
                Outline(
                    [complex(*corner) / scale_m for corner in corners],
                    radius / scale_m,
                    within=about == FENCE,
                ),
                margins[clearance],
            )
            for about, corners, radius, clearance in found
        ]
        self._at, self._free = 0j, -1.0
        """Around this point, nothing is within reach so far."""

    @classmethod
    def of(cls, plan: Plan) -> Surroundings:
        """For vehicles that answer as the plan says."""
        return cls(plan.zones, plan.fence, plan.response, plan.limits.speed_mps)

    def near(self, point: complex, low_m: float, high_m: float) -> list[NearWall]:
        """The walls that may ask for something of what is at `point`, and between these heights
        above the origin."""
        if abs(point - self._at) < self._free:
            return _NONE
        found, free = list[NearWall](), math.inf
        for about, outline, margins in self._walls:
            least = outline.least(point) - margins.reach
            if least < 0.0:
                walls = outline.walls(point, about)
                least = min(wall.gap for wall in walls) - margins.reach
                if about == FENCE or self._zones[about].blocks(low_m, high_m):
                    found += [NearWall(w, margins) for w in walls if w.gap < margins.reach]
            free = min(free, least)
        self._at, self._free = point, free
        return found

    def blocked(self, walls: Sequence[NearWall], height_m: float) -> bool:
        """One of these walls is of a zone at other heights than this one, and too near to climb or
        sink beside it."""
        return any(
            wall.about != FENCE
            and wall.gap < margins.keep
            and not self._zones[wall.about].blocks(height_m, height_m)
            for wall, margins in walls
        )

    def holds(self, walls: Sequence[NearWall]) -> str:
        """The zone that the point of these walls is in; '': none."""
        found = next((w.about for w, _ in walls if w.gap < 0.0 and w.about != FENCE), FENCE)
        return "" if found == FENCE else self.name(found)

    def nearest_zone(self, walls: Sequence[NearWall]) -> str:
        """The name of the zone that is nearer than its clearance; '': none is."""
        zones = [wall for wall, margins in walls if wall.gap < margins.keep - margins.spare]
        zones = [wall for wall in zones if wall.about != FENCE]
        return self.name(min(zones, key=lambda wall: wall.gap).about) if zones else ""

    def name(self, about: int) -> str:
        """Of what a wall is about."""
        return FENCE_NAME if about == FENCE else f"zone {self._zones[about].name}"


def _millimetres(point: complex) -> tuple[int, int]:
    return round(1000.0 * point.real), round(1000.0 * point.imag)
