"""What a vehicle is doing: maneuvers that turn what it senses into a demand on its motion. Pure.

Positions are NED metres in the simulator's common frame; a firmware translates its own local frame
before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from sim.firmware.message import Landed
from sim.physics.geodesy import Vector3

Axis = float | None


class Sensed(NamedTuple):
    """What the firmware's estimator says of its vehicle."""

    position_ned_m: Vector3
    velocity_ned_mps: Vector3
    thrust_ned_mps2: Vector3
    """Acceleration by the rotors alone, beside what carries the weight: it makes the vehicle
    lean."""
    heading_rad: float
    landed: bool


class Demand(NamedTuple):
    """What the firmware wants of the motion; axes without a position (None) follow the velocity
    alone."""

    velocity_ned_mps: Vector3
    position_ned_m: tuple[Axis, Axis, Axis]
    speed_mps: float
    climb_mps: float
    descent_mps: float
    heading_rad: float
    lift: bool


@dataclass(frozen=True, slots=True)
class Style:
    """How a firmware flies by itself, from its parameters."""

    speed_mps: float
    climb_mps: float
    descent_mps: float
    land_mps: float
    """Descent below `land_below_m` above the take-off point."""
    land_below_m: float
    captures: bool
    """Stops by holding the point where it came to rest (else the velocity controller itself
    remembers the path)."""


class Maneuver(Protocol):
    """One thing a vehicle does until told otherwise."""

    @property
    def landed_state(self) -> Landed:
        """EXTENDED_SYS_STATE.landed_state while it goes on in the air."""
        ...

    @property
    def done(self) -> bool:
        """It has reached what it was begun for."""
        ...

    def demand(self, now: float, sensed: Sensed, style: Style, /) -> Demand:
        """Called at least every 0.1 s of mission time."""
        ...


@dataclass(slots=True)
class Ground:
    """Motors idle or off. In the air it would fall."""

    landed_state: Landed = Landed.IN_AIR
    done: bool = True

    def demand(self, _now: float, sensed: Sensed, style: Style) -> Demand:
        """See `Maneuver`."""
        return _demand(style, sensed.heading_rad, lift=False)


class Anchor:
    """Remembers where a stopping vehicle came to rest."""

    _SLOW_MPS = 0.3

    def __init__(self) -> None:
        self._point: tuple[float, float] | None = None

    def point(self, sensed: Sensed, style: Style) -> tuple[Axis, Axis]:
        """The horizontal point to hold; (None, None) while still braking, or where the style needs
        none."""
        if self._point is None and style.captures:
            north, east, _ = sensed.velocity_ned_mps
            if math.hypot(north, east) < self._SLOW_MPS:
                self._point = sensed.position_ned_m[:2]
        return self._point if self._point is not None else (None, None)


class Hold:
    """Stop and stay."""

    landed_state = Landed.IN_AIR
    done = True

    def __init__(self, heading_rad: float) -> None:
        self._heading_rad = heading_rad
        self._anchor = Anchor()
        self._down: Axis = None

    def demand(self, _now: float, sensed: Sensed, style: Style) -> Demand:
        """See `Maneuver`."""
        north, east = self._anchor.point(sensed, style)
        if self._down is None and style.captures and abs(sensed.velocity_ned_mps[2]) < 0.2:
            self._down = sensed.position_ned_m[2]
        return _demand(style, self._heading_rad, position=(north, east, self._down))


@dataclass(slots=True)
class Velocity:
    """Follow a velocity, and where given a position, until the next setpoint."""

    velocity_ned_mps: Vector3
    heading_rad: float
    position_ned_m: tuple[Axis, Axis, Axis] = (None, None, None)
    yaw_rate_radps: float = 0.0
    since_s: float = 0.0
    landed_state: Landed = Landed.IN_AIR
    done: bool = True

    def demand(self, now: float, _sensed: Sensed, style: Style) -> Demand:
        """See `Maneuver`."""
        heading = self.heading_rad
        if self.yaw_rate_radps:
            heading += self.yaw_rate_radps * (now - self.since_s)
        return _demand(style, heading, self.velocity_ned_mps, self.position_ned_m)


class Takeoff:
    """Spool up, climb straight to `down_m`."""

    landed_state = Landed.TAKEOFF
    _CLOSE_M = 0.3

    def __init__(self, start: Sensed, down_m: float, at_s: float, climb_mps: float) -> None:
        self.done = False
        self._start = start
        self._down_m = down_m
        self._at_s = at_s
        self._climb_mps = climb_mps

    def demand(self, now: float, sensed: Sensed, style: Style) -> Demand:
        """See `Maneuver`."""
        if sensed.landed and now < self._at_s:
            return _demand(style, self._start.heading_rad, lift=False)
        north, east, _ = self._start.position_ned_m
        self.done = abs(sensed.position_ned_m[2] - self._down_m) < self._CLOSE_M
        where = (north, east, self._down_m)
        return _demand(style, self._start.heading_rad, position=where, climb_mps=self._climb_mps)


class Land:
    """Down where it is: fast first, then slowly to the ground at `ground_down_m`, and past it if
    that is lower."""

    landed_state = Landed.LANDING

    def __init__(
        self, heading_rad: float, ground_down_m: float, slow_mps: float | None = None
    ) -> None:
        self.done = False
        self._heading_rad = heading_rad
        self._ground_down_m = ground_down_m
        self._slow_mps = slow_mps
        self._anchor = Anchor()

    def demand(self, _now: float, sensed: Sensed, style: Style) -> Demand:
        """See `Maneuver`."""
        self.done = sensed.landed
        height = self._ground_down_m - sensed.position_ned_m[2]
        rate = style.land_mps if height < style.land_below_m else style.descent_mps
        if self._slow_mps is not None:
            rate = self._slow_mps
        north, east = self._anchor.point(sensed, style)
        return _demand(style, self._heading_rad, (0.0, 0.0, rate), (north, east, None))


class Return:
    """Climb (never descend) to the return height, fly home, wait, land."""

    _CLOSE_M = 1.0

    def __init__(self, start: Sensed, home_ned_m: Vector3, height_m: float, wait_s: float) -> None:
        self.done = False
        self._heading_rad = start.heading_rad
        self._home = home_ned_m
        self._from = start.position_ned_m
        self._down_m = min(home_ned_m[2] - height_m, start.position_ned_m[2])
        self._wait_s = wait_s
        self._home_since_s: float | None = None
        self._climbed = False
        self._land: Land | None = None

    @property
    def landed_state(self) -> Landed:
        """Landing in its last part."""
        return Landed.IN_AIR if self._land is None else Landed.LANDING

    def demand(self, now: float, sensed: Sensed, style: Style) -> Demand:
        """See `Maneuver`."""
        if self._land is not None:
            down = self._land.demand(now, sensed, style)
            self.done = self._land.done
            home = (self._home[0], self._home[1], None)
            return _demand(style, self._heading_rad, down.velocity_ned_mps, home)
        north, east, down_m = sensed.position_ned_m
        self._climbed = self._climbed or down_m - self._down_m < self._CLOSE_M
        place = self._home if self._climbed else self._from
        if (
            self._climbed
            and math.hypot(north - self._home[0], east - self._home[1]) < self._CLOSE_M
        ):
            self._home_since_s = now if self._home_since_s is None else self._home_since_s
            if now - self._home_since_s >= self._wait_s:
                self._land = Land(self._heading_rad, self._home[2])
        return _demand(style, self._heading_rad, position=(place[0], place[1], self._down_m))


def cruise(style: Style, heading_rad: float, place: tuple[Axis, Axis, Axis]) -> Demand:
    """Fly to a point, in the style."""
    return _demand(style, heading_rad, position=place)


def _demand(
    style: Style,
    heading_rad: float,
    velocity: Vector3 = (0.0, 0.0, 0.0),
    position: tuple[Axis, Axis, Axis] = (None, None, None),
    *,
    climb_mps: float | None = None,
    lift: bool = True,
) -> Demand:
    climb = style.climb_mps if climb_mps is None else climb_mps
    return Demand(velocity, position, style.speed_mps, climb, style.descent_mps, heading_rad, lift)
