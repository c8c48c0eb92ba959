"""Flying an uploaded mission: one leg an item, each a maneuver of its own. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sim.firmware.flying.maneuvers import (
    Axis,
    Demand,
    Ground,
    Hold,
    Land,
    Maneuver,
    Return,
    Sensed,
    Style,
    Takeoff,
    cruise,
)
from sim.firmware.message import Landed
from sim.firmware.protocol.mission_lists import Item, Nav
from sim.physics.geodesy import Vector3

_FACE_BEYOND_M = 2.0
_HEIGHT_M = 1.0


class GoTo:
    """Fly to a point, wait there; from the ground, climb first."""

    landed_state = Landed.IN_AIR

    def __init__(
        self,
        place: Vector3,
        radius_m: float,
        wait_s: float,
        heading_rad: float,
        climb: Takeoff | None = None,
    ) -> None:
        self.done = False
        self._climb = climb
        self._place = place
        self._radius_m = radius_m
        self._wait_s = wait_s
        self._heading_rad = heading_rad
        self._there_s: float | None = None

    def demand(self, now: float, sensed: Sensed, style: Style) -> Demand:
        """See `Maneuver`."""
        if self._climb is not None and not self._climb.done:
            return self._climb.demand(now, sensed, style)
        north, east, down = (p - s for p, s in zip(self._place, sensed.position_ned_m, strict=True))
        distance = math.hypot(north, east)
        if distance > _FACE_BEYOND_M:
            self._heading_rad = math.atan2(east, north)
        if self._there_s is None and distance <= self._radius_m and abs(down) <= _HEIGHT_M:
            self._there_s = now
        self.done = self._there_s is not None and now - self._there_s >= self._wait_s
        place: tuple[Axis, Axis, Axis] = self._place
        return cruise(style, self._heading_rad, place)


class LandAt:
    """Fly over a point at the height one has, then land."""

    def __init__(self, place: Vector3, ground_down_m: float, sensed: Sensed) -> None:
        self._goto = GoTo(
            (place[0], place[1], sensed.position_ned_m[2]), 1.0, 0.0, sensed.heading_rad
        )
        self._over = place
        self._ground_down_m = ground_down_m
        self._land: Land | None = None
        self.done = False

    @property
    def landed_state(self) -> Landed:
        """Landing in its last part."""
        return Landed.IN_AIR if self._land is None else Landed.LANDING

    def demand(self, now: float, sensed: Sensed, style: Style) -> Demand:
        """See `Maneuver`."""
        if self._land is None:
            demand = self._goto.demand(now, sensed, style)
            if not self._goto.done:
                return demand
            self._land = Land(demand.heading_rad, self._ground_down_m)
        down = self._land.demand(now, sensed, style)
        self.done = self._land.done
        return down._replace(position_ned_m=(self._over[0], self._over[1], None))


@dataclass(frozen=True)
class Course:
    """What a mission needs to know of its vehicle."""

    place: Callable[[Item], Vector3]
    """NED of an item's point."""
    home: Callable[[], Vector3]
    radius_m: float
    return_height_m: float
    return_wait_s: float
    takeoff_mps: float
    spool_up_s: float
    set_speed: Callable[[float], None]
    reached: Callable[[int], None]
    """Told the index of each item as it is done."""


class Auto:
    """A mission from item `first` on. At its end it hovers, unless it has landed."""

    def __init__(self, items: Sequence[Item], first: int, course: Course) -> None:
        self.current = first
        self.finished = False
        self.paused = False
        self._items = items
        self._course = course
        self._leg: Maneuver | None = None
        self._jumps: dict[int, int] = {}
        self._hold: Hold | None = None

    @property
    def landed_state(self) -> Landed:
        """The leg's."""
        return Landed.IN_AIR if self._leg is None else self._leg.landed_state

    @property
    def done(self) -> bool:
        """It has come to its end, and that was a landing."""
        return self.finished and isinstance(self._leg, LandAt | Land | Return)

    def jump_to(self, index: int) -> None:
        """Goes on with another item."""
        self.current, self._leg, self.finished = index, None, False

    def demand(self, now: float, sensed: Sensed, style: Style) -> Demand:
        """See `Maneuver`."""
        if self.paused and not sensed.landed:
            self._hold = self._hold or Hold(sensed.heading_rad)
            return self._hold.demand(now, sensed, style)
        self._hold = None
        for _ in range(
            len(self._items) + 1
        ):  # items that take no time; bounded for jumps in circles
            if self.finished:
                break
            if self._leg is None:
                self._leg = self._begin(now, sensed)
            demand = self._leg.demand(now, sensed, style)
            if not self._leg.done:
                return demand
            self._next()
        return self._after(now, sensed, style)

    def _after(self, now: float, sensed: Sensed, style: Style) -> Demand:
        if self._leg is None or isinstance(self._leg, Ground):
            self._leg = Ground() if sensed.landed else Hold(sensed.heading_rad)
        return self._leg.demand(now, sensed, style)

    def _next(self) -> None:
        self._course.reached(self.current)
        item = self._items[self.current]
        following = self.current + 1
        if item.command == Nav.DO_JUMP and self._jump_allowed(item):
            following = int(item.p[0])
        if following >= len(self._items):
            self.finished = True
            return
        self.current, self._leg = following, None

    def _jump_allowed(self, item: Item) -> bool:
        if not (
            math.isfinite(item.p[0])
            and math.isfinite(item.p[1])
            and 0 <= item.p[0] < len(self._items)
        ):
            return False
        made = self._jumps.get(self.current, 0)
        self._jumps[self.current] = made + 1
        return item.p[1] < 0 or made < item.p[1]

    def _begin(self, now: float, sensed: Sensed) -> Maneuver:
        item, course = self._items[self.current], self._course
        here = sensed.position_ned_m
        if item.command == Nav.TAKEOFF:
            if sensed.landed:
                return self._climb(now, sensed, course.place(item)[2])
            return GoTo(
                (here[0], here[1], course.place(item)[2]), course.radius_m, 0.0, sensed.heading_rad
            )
        if item.command == Nav.LAND:
            where = course.place(item) if item.placed else here
            return LandAt(where, course.home()[2], sensed)
        if item.command == Nav.RETURN:
            return Return(sensed, course.home(), course.return_height_m, course.return_wait_s)
        if item.command == Nav.DELAY:
            return GoTo(here, math.inf, _seconds(item.p[0]), sensed.heading_rad)
        if item.command == Nav.DO_CHANGE_SPEED and math.isfinite(item.p[1]) and item.p[1] > 0:
            course.set_speed(item.p[1])
        if item.command in _AT_A_PLACE:
            return self._goto(item, now, sensed)
        return Ground()  # done at once

    def _climb(self, now: float, sensed: Sensed, down_m: float) -> Takeoff:
        return Takeoff(sensed, down_m, now + self._course.spool_up_s, self._course.takeoff_mps)

    def _goto(self, item: Item, now: float, sensed: Sensed) -> GoTo:
        course = self._course
        n, e, d = course.place(item)
        here = sensed.position_ned_m
        place = (n, e, d) if item.placed else (here[0], here[1], d)
        wait = math.inf if item.command == Nav.LOITER_UNLIM else _seconds(item.p[0])
        if item.command == Nav.LOITER_TURNS:
            wait = 0.0
        own = (
            item.p[1]
            if item.command == Nav.WAYPOINT and math.isfinite(item.p[1]) and item.p[1] > 0
            else 0.0
        )
        climb = self._climb(now, sensed, d) if sensed.landed else None
        return GoTo(place, own or course.radius_m, wait, sensed.heading_rad, climb)


_AT_A_PLACE = frozenset(
    {Nav.WAYPOINT, Nav.SPLINE, Nav.LOITER_UNLIM, Nav.LOITER_TURNS, Nav.LOITER_TIME}
)


def _seconds(value: float) -> float:
    return value if math.isfinite(value) and value > 0 else 0.0
