"""What a vehicle is doing: maneuvers turn what it senses into a demand on its motion. Pure.

Positions are NED metres in the simulator's common frame; a firmware converts its own local frame
before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from swarm_sim.firmware.flying.position_target import NOTHING, Axes, Axis
from swarm_sim.firmware.message import LandedState
from swarm_sim.physics.geodesy import Vector3

STILL: Vector3 = (0.0, 0.0, 0.0)


class Sensed(NamedTuple):
    """What the firmware's estimator says of its vehicle."""

    position_ned_m: Vector3
    velocity_ned_mps: Vector3
    thrust_ned_mps2: Vector3
    """Acceleration by the rotors beyond what carries the weight: it makes the vehicle lean."""
    heading_rad: float
    landed: bool


class Demand(NamedTuple):
    """The motion a firmware wants; axes without a position follow the velocity alone."""

    velocity_ned_mps: Vector3
    position_ned_m: Axes
    speed_mps: float
    climb_mps: float
    descent_mps: float
    heading_rad: float
    lift: bool


@dataclass(frozen=True, slots=True)
class FlightStyle:
    """How a firmware flies by itself, from its parameters."""

    speed_mps: float
    climb_mps: float
    descent_mps: float
    land_mps: float
    """Descent below `land_below_m` above the take-off point."""
    land_below_m: float
    land_from_m: float
    """From here down to `land_below_m` the descent slows down steadily."""
    takeoff_mps: float
    spool_up_s: float
    """From a take-off command to lift."""
    takeoff_ramp_s: float
    """From lift to the full rate of climb."""
    return_height_m: float
    return_wait_s: float
    """Between the arrival above home and the landing."""
    waypoint_radius_m: float
    captures: bool
    """Stops by holding the point where it came to rest, not by the velocity controller's memory."""


class Maneuver(Protocol):
    """One thing a vehicle does until told otherwise."""

    @property
    def landed_state(self) -> LandedState:
        """EXTENDED_SYS_STATE.landed_state while it goes on in the air."""

    @property
    def done(self) -> bool:
        """It has reached its goal."""

    def demand(self, now: float, sensed: Sensed, style: FlightStyle, /) -> Demand:
        """Called at least every 0.1 s of mission time."""


@dataclass(slots=True)
class GroundManeuver:
    """Motors idle or off; in the air the vehicle would fall."""

    landed_state: LandedState = LandedState.IN_AIR
    done: bool = True

    def demand(self, _now: float, sensed: Sensed, style: FlightStyle) -> Demand:
        return fly(style, sensed.heading_rad)._replace(lift=False)


class _Anchor:
    """Remembers where a stopping vehicle came to rest."""

    point: tuple[Axis, Axis] = (None, None)
    """To hold, horizontally; nothing while still braking, or where the style needs none."""
    down: Axis = None

    def settle(self, sensed: Sensed, style: FlightStyle) -> None:
        """Takes the present point once the vehicle is slow."""
        north, east, down = sensed.velocity_ned_mps
        if style.captures and self.point == (None, None) and math.hypot(north, east) < 0.3:
            self.point = sensed.position_ned_m[:2]
        if style.captures and self.down is None and abs(down) < 0.2:
            self.down = sensed.position_ned_m[2]


class HoldManeuver:
    """Stop and stay."""

    landed_state = LandedState.IN_AIR
    done = True

    def __init__(self, heading_rad: float) -> None:
        self._heading_rad = heading_rad
        self._anchor = _Anchor()

    def demand(self, _now: float, sensed: Sensed, style: FlightStyle) -> Demand:
        self._anchor.settle(sensed, style)
        return fly(style, self._heading_rad, position=(*self._anchor.point, self._anchor.down))


@dataclass(slots=True)
class VelocityManeuver:
    """Follow a velocity, and where given a position, until the next setpoint."""

    velocity_ned_mps: Vector3
    heading_rad: float
    position_ned_m: Axes = NOTHING
    yaw_rate_radps: float = 0.0
    since_s: float = 0.0
    landed_state: LandedState = LandedState.IN_AIR
    done: bool = True

    def demand(self, now: float, _sensed: Sensed, style: FlightStyle) -> Demand:
        heading = self.heading_rad
        if self.yaw_rate_radps:
            heading += self.yaw_rate_radps * (now - self.since_s)
        return fly(style, heading, self.velocity_ned_mps, self.position_ned_m)


@dataclass(slots=True)
class TakeoffManeuver:
    """Spool up, then climb straight to `down_m`."""

    start: Sensed
    down_m: float
    began_s: float
    climb_mps: float
    landed_state: LandedState = LandedState.TAKEOFF
    done: bool = False

    def demand(self, now: float, sensed: Sensed, style: FlightStyle) -> Demand:
        lifted_s = now - self.began_s - style.spool_up_s
        if sensed.landed and lifted_s < 0.0:
            return fly(style, self.start.heading_rad)._replace(lift=False)
        north, east, _ = self.start.position_ned_m
        self.done = abs(sensed.position_ned_m[2] - self.down_m) < 0.3
        demand = fly(style, self.start.heading_rad, position=(north, east, self.down_m))
        share = min(1.0, lifted_s / style.takeoff_ramp_s) if style.takeoff_ramp_s else 1.0
        return demand._replace(climb_mps=self.climb_mps * share)


@dataclass(slots=True)
class LandManeuver:
    """Down where it is: fast first, then slowly to the ground at `ground_down_m`, and past it if
    the real ground is lower."""

    heading_rad: float
    ground_down_m: float
    slow_mps: float | None = None
    """In place of the style's rates."""
    anchor: _Anchor = field(default_factory=_Anchor)
    landed_state: LandedState = LandedState.LANDING
    done: bool = False

    def demand(self, _now: float, sensed: Sensed, style: FlightStyle) -> Demand:
        self.done = sensed.landed
        self.anchor.settle(sensed, style)
        height = self.ground_down_m - sensed.position_ned_m[2]
        slows_m = max(style.land_from_m - style.land_below_m, 1e-3)
        share = min(1.0, max(0.0, (height - style.land_below_m) / slows_m))
        rate = style.land_mps + share * (style.descent_mps - style.land_mps)
        velocity = (0.0, 0.0, rate if self.slow_mps is None else self.slow_mps)
        return fly(style, self.heading_rad, velocity, (*self.anchor.point, None))


class _EndsInLanding:
    """A maneuver whose last part is a landing over a given point."""

    def __init__(self, over: Vector3) -> None:
        self.done = False
        self._over = over
        self._land: LandManeuver | None = None

    @property
    def landed_state(self) -> LandedState:
        return LandedState.IN_AIR if self._land is None else LandedState.LANDING

    def _land_demand(
        self, land: LandManeuver, now: float, sensed: Sensed, style: FlightStyle
    ) -> Demand:
        down = land.demand(now, sensed, style)
        self.done = land.done
        return down._replace(position_ned_m=(self._over[0], self._over[1], None))


class ReturnManeuver(_EndsInLanding):
    """Climb (never descend) to the return height, fly home, wait, land."""

    _CLOSE_M = 1.0

    def __init__(self, start: Sensed, home_ned_m: Vector3, height_m: float, wait_s: float) -> None:
        super().__init__(home_ned_m)
        self._heading_rad = start.heading_rad
        self._from = start.position_ned_m
        self._down_m = min(home_ned_m[2] - height_m, start.position_ned_m[2])
        self._wait_s = wait_s
        self._home_since_s: float | None = None
        self._climbed = False

    def demand(self, now: float, sensed: Sensed, style: FlightStyle) -> Demand:
        if self._land is not None:
            return self._land_demand(self._land, now, sensed, style)
        home = self._over
        north, east, down_m = sensed.position_ned_m
        self._climbed = self._climbed or down_m - self._down_m < self._CLOSE_M
        place = home if self._climbed else self._from
        if self._climbed and math.hypot(north - home[0], east - home[1]) < self._CLOSE_M:
            self._home_since_s = now if self._home_since_s is None else self._home_since_s
            if now - self._home_since_s >= self._wait_s:
                self._land = LandManeuver(self._heading_rad, home[2])
        return fly(style, self._heading_rad, position=(place[0], place[1], self._down_m))


@dataclass(slots=True)
class GoToManeuver:
    """Fly to a point, wait there; from the ground, climb first."""

    place: Vector3
    radius_m: float
    wait_s: float
    heading_rad: float
    climb: TakeoffManeuver | None = None
    there_s: float | None = None
    landed_state: LandedState = LandedState.IN_AIR
    done: bool = False

    def demand(self, now: float, sensed: Sensed, style: FlightStyle) -> Demand:
        if self.climb is not None and not self.climb.done:
            return self.climb.demand(now, sensed, style)
        north, east, down = (p - s for p, s in zip(self.place, sensed.position_ned_m, strict=True))
        distance = math.hypot(north, east)
        if distance > 2.0:
            self.heading_rad = math.atan2(east, north)
        if self.there_s is None and distance <= self.radius_m and abs(down) <= 1.0:
            self.there_s = now
        self.done = self.there_s is not None and now - self.there_s >= self.wait_s
        return fly(style, self.heading_rad, position=self.place)


class LandAtManeuver(_EndsInLanding):
    """Fly over a point at the present height, then land."""

    def __init__(self, place: Vector3, ground_down_m: float, sensed: Sensed) -> None:
        super().__init__(place)
        over = (place[0], place[1], sensed.position_ned_m[2])
        self._goto = GoToManeuver(over, 1.0, 0.0, sensed.heading_rad)
        self._ground_down_m = ground_down_m

    def demand(self, now: float, sensed: Sensed, style: FlightStyle) -> Demand:
        if self._land is None:
            demand = self._goto.demand(now, sensed, style)
            if not self._goto.done:
                return demand
            self._land = LandManeuver(demand.heading_rad, self._ground_down_m)
        return self._land_demand(self._land, now, sensed, style)


def fly(
    style: FlightStyle, heading_rad: float, velocity: Vector3 = STILL, position: Axes = NOTHING
) -> Demand:
    """The demand for a velocity or a position, with the speeds of `style`."""
    s = style
    return Demand(
        velocity_ned_mps=velocity,
        position_ned_m=position,
        speed_mps=s.speed_mps,
        climb_mps=s.climb_mps,
        descent_mps=s.descent_mps,
        heading_rad=heading_rad,
        lift=True,
    )
