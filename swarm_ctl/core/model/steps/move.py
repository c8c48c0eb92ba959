"""The formation along a way."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Literal

from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.planned_formation import Frame, Motion, PlannedFormation
from swarm_ctl.core.model.policies import Policy
from swarm_ctl.core.model.steps.step import Path, strayed


@dataclass(frozen=True, slots=True)
class MoveStep(Path):
    """Take the formation's centre along `waypoints_m` (common frame) at `speed_mps`, keeping
    shape."""

    waypoints_m: tuple[Point, ...]
    speed_mps: float
    tolerance_m: float
    settle_s: float
    timeout_s: float
    on_timeout: Policy = Policy.LAND
    opens_m: float | None = None
    """None: all together. Else in file, one behind the other along the waypoints, until so much of
    the way is left."""
    kind: Literal["move"] = "move"

    @property
    def file(self) -> MoveStep | None:
        return None if self.opens_m is None else self

    @property
    def way_m(self) -> tuple[Point, ...]:
        return self.waypoints_m

    def on_way(self, way_m: tuple[Point, ...]) -> MoveStep:
        return replace(self, waypoints_m=way_m)

    def after(self, formation: PlannedFormation) -> PlannedFormation:
        return replace(formation, centre_m=self.waypoints_m[-1])

    def poses(self, before: PlannedFormation) -> list[PlannedFormation]:
        """At each waypoint."""
        return [before, *(replace(before, centre_m=centre) for centre in self.waypoints_m)]

    def legs_m(self, before: PlannedFormation) -> list[float]:
        points = (before.centre_m, *self.waypoints_m)
        return [math.dist(a, b) for a, b in itertools.pairwise(points)]

    def left_m(self, frame: Frame, radius_m: float) -> float:
        if frame.leg >= len(self.waypoints_m):
            return 0.0
        return math.dist(frame.point_m, self.waypoints_m[frame.leg])

    def arrived(self, frame: Frame, radius_m: float) -> bool:
        return frame.leg >= len(self.waypoints_m)

    def _moved(self, frame: Frame, share: float) -> Frame:
        if frame.leg >= len(self.waypoints_m):
            return frame
        (n, e), (to_n, to_e) = frame.point_m, self.waypoints_m[frame.leg]
        point = (n + share * (to_n - n), e + share * (to_e - e))
        return replace(frame, point_m=point, leg=frame.leg + (share == 1.0))

    def _motion(self, frame: Frame, speed_mps: float, radius_m: float) -> Motion:
        left = self.left_m(frame, radius_m)
        (n, e), (to_n, to_e) = frame.point_m, self.waypoints_m[frame.leg]
        return Motion(complex((to_n - n) / left * speed_mps, (to_e - e) / left * speed_mps))

    def along(self, start: Frame, frame: Frame, radius_m: float) -> tuple[float, float]:
        apart_m, turned_m, grown_m = strayed(start, frame, radius_m)
        way = [start.point_m, *self.waypoints_m[start.leg :]]
        k = max(0, min(frame.leg - start.leg, len(way) - 1))
        if frame.leg < start.leg:
            done, beside = 0.0, apart_m
        else:
            done, beside = _onto(way[k], way[min(k + 1, len(way) - 1)], frame.point_m)
        done += sum(math.dist(a, b) for a, b in itertools.pairwise(way[: k + 1]))
        return done, beside + turned_m + grown_m


def _onto(a: Point, b: Point, at: Point) -> tuple[float, float]:
    """How far along from a to b, and how far beside it."""
    length = math.dist(a, b)
    if length == 0.0:
        return 0.0, math.dist(a, at)
    north, east = (b[0] - a[0]) / length, (b[1] - a[1]) / length
    done = max(0.0, min(length, (at[0] - a[0]) * north + (at[1] - a[1]) * east))
    return done, math.dist(at, (a[0] + done * north, a[1] + done * east))
