"""Flying an uploaded mission: one leg an item, each a maneuver of its own. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from swarm_sim.firmware.flying.maneuvers import (
    Demand,
    FlightStyle,
    GoToManeuver,
    GroundManeuver,
    HoldManeuver,
    LandAtManeuver,
    LandManeuver,
    Maneuver,
    ReturnManeuver,
    Sensed,
    TakeoffManeuver,
)
from swarm_sim.firmware.flying.mission_items import MissionItem
from swarm_sim.firmware.message import LandedState, MavCmd
from swarm_sim.physics.geodesy import Vector3

_AT_A_PLACE = frozenset({16, 17, 18, 19, 82})
"""MAV_CMDs of items that are a point to fly to: waypoints and loiters."""
_WAIT_S: dict[int, float] = {MavCmd.NAV_LOITER_UNLIM: math.inf, MavCmd.NAV_LOITER_TURNS: 0.0}
"""At the point, where the item itself doesn't say it; turns are not flown."""


@dataclass(frozen=True)
class MissionVehicle:
    """What a mission needs to know of its vehicle, and tells it."""

    style: FlightStyle
    """As it was when the mission began."""
    place: Callable[[MissionItem], Vector3]
    """NED of an item's point."""
    home: Callable[[], Vector3]
    set_speed: Callable[[float], None]
    reached: Callable[[int], None]
    """Told the index of each item as it is done."""


class MissionManeuver:
    """A mission from item `first` on. At its end it hovers, unless it has landed."""

    def __init__(self, items: Sequence[MissionItem], first: int, vehicle: MissionVehicle) -> None:
        self.current = first
        self.finished = False
        self.paused = False
        self._items = items
        self._vehicle = vehicle
        self._leg: Maneuver | None = None
        self._jumps: dict[int, int] = {}
        self._hold: HoldManeuver | None = None

    @property
    def landed_state(self) -> LandedState:
        """The leg's."""
        return LandedState.IN_AIR if self._leg is None else self._leg.landed_state

    @property
    def done(self) -> bool:
        """It has come to its end, and that was a landing."""
        landing = isinstance(self._leg, LandAtManeuver | LandManeuver | ReturnManeuver)
        return self.finished and landing

    def jump_to(self, index: int) -> None:
        """Goes on with another item."""
        self.current, self._leg, self.finished = index, None, False

    def demand(self, now: float, sensed: Sensed, style: FlightStyle) -> Demand:
        if self.paused and not sensed.landed:
            self._hold = self._hold or HoldManeuver(sensed.heading_rad)
            return self._hold.demand(now, sensed, style)
        self._hold = None
        # several items may take no time; the bound ends jumps in circles
        for _ in range(len(self._items) + 1):
            if self.finished:
                break
            if self._leg is None:
                self._leg = self._begin(now, sensed)
            demand = self._leg.demand(now, sensed, style)
            if not self._leg.done:
                return demand
            self._next()
        return self._after(now, sensed, style)

    def _after(self, now: float, sensed: Sensed, style: FlightStyle) -> Demand:
        if self._leg is None or isinstance(self._leg, GroundManeuver):
            self._leg = GroundManeuver() if sensed.landed else HoldManeuver(sensed.heading_rad)
        return self._leg.demand(now, sensed, style)

    def _next(self) -> None:
        self._vehicle.reached(self.current)
        item = self._items[self.current]
        following = self.current + 1
        if item.command == MavCmd.DO_JUMP and self._jump_allowed(item):
            following = int(item.p[0])
        if following >= len(self._items):
            self.finished = True
        else:
            self.jump_to(following)

    def _jump_allowed(self, item: MissionItem) -> bool:
        to, times = item.p[:2]
        if not (math.isfinite(to) and math.isfinite(times) and 0 <= to < len(self._items)):
            return False
        made = self._jumps.get(self.current, 0)
        self._jumps[self.current] = made + 1
        return times < 0 or made < times

    def _begin(self, now: float, sensed: Sensed) -> Maneuver:
        item, vehicle, style = self._items[self.current], self._vehicle, self._vehicle.style
        here, heading = sensed.position_ned_m, sensed.heading_rad
        if item.command == MavCmd.NAV_TAKEOFF:
            down = vehicle.place(item)[2]
            if sensed.landed:
                return TakeoffManeuver(sensed, down, now, style.takeoff_mps)
            return GoToManeuver((here[0], here[1], down), style.waypoint_radius_m, 0.0, heading)
        if item.command == MavCmd.NAV_LAND:
            where = vehicle.place(item) if item.placed else here
            return LandAtManeuver(where, vehicle.home()[2], sensed)
        if item.command == MavCmd.NAV_RETURN_TO_LAUNCH:
            return ReturnManeuver(
                sensed, vehicle.home(), style.return_height_m, style.return_wait_s
            )
        if item.command == MavCmd.NAV_DELAY:
            return GoToManeuver(here, math.inf, _positive(item.p[0]), heading)
        if item.command == MavCmd.DO_CHANGE_SPEED and (speed := _positive(item.p[1])):
            vehicle.set_speed(speed)
        if item.command in _AT_A_PLACE:
            return self._go_to(item, now, sensed)
        return GroundManeuver()  # done at once

    def _go_to(self, item: MissionItem, now: float, sensed: Sensed) -> GoToManeuver:
        style = self._vehicle.style
        n, e, d = self._vehicle.place(item)
        here = sensed.position_ned_m
        place = (n, e, d) if item.placed else (here[0], here[1], d)
        wait = _WAIT_S.get(item.command, _positive(item.p[0]))
        own = _positive(item.p[1]) if item.command == MavCmd.NAV_WAYPOINT else 0.0
        climb = TakeoffManeuver(sensed, d, now, style.takeoff_mps) if sensed.landed else None
        radius = own or style.waypoint_radius_m
        return GoToManeuver(place, radius, wait, sensed.heading_rad, climb)


def _positive(value: float) -> float:
    """The value; 0 where it is not a positive number."""
    return value if math.isfinite(value) and value > 0 else 0.0
