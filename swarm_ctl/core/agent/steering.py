"""From what an agent decided to the goal that its vehicle is given in this tick."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

from swarm_ctl.core.agent.own_vehicle import OwnVehicle
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.control.controller import Controller
from swarm_ctl.core.control.navigation import OwnFix, climb_rate
from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import Limits, Point
from swarm_ctl.core.model.rows import row
from swarm_ctl.core.model.vehicle import AirborneGoal, FlyGoal, Goal
from swarm_ctl.core.swarm.snapshot import Formation, PeerSnapshot

NO_FIX = "no fresh position from the vehicle"


class Course(ABC):
    """What is flown by setpoints of ours."""

    __slots__ = ()

    @abstractmethod
    def velocity(self, controller: Controller, peers: PeerSnapshot) -> Point:
        """The velocity of this tick, (north, east) [m/s]."""


@row
class KeepClear(Course):
    """Stay, and make room for what comes close."""

    ground: bool = False
    """Also for vehicles that stand on the ground."""
    room_m: float = 0.0
    """So much at least."""
    down: bool = False
    """Out of zones that are under the vehicle, too: it is to land."""

    def velocity(self, controller: Controller, peers: PeerSnapshot) -> Point:
        """Out of the way."""
        if self.down:
            controller.safety_filter.climbs_m = -math.inf
        return controller.keep_clear(peers, ground=self.ground, room_m=self.room_m)


@row
class FlyTo(Course):
    """Straight to a point [m, common frame], around what stands in the way."""

    to_m: Point
    speed_mps: float

    def velocity(self, controller: Controller, peers: PeerSnapshot) -> Point:
        """Towards it."""
        return controller.go_to(peers, self.to_m, self.speed_mps)


@row
class FlyShape(Course):
    """The law, towards the own slot."""

    formation: Formation
    extra_mps: Point
    """The velocity of the own place, on top of the law."""
    off_m: Point | None
    """From the own stop point to the own place, on the agent that is pinned to it."""

    def velocity(self, controller: Controller, peers: PeerSnapshot) -> Point:
        """By the law."""
        return controller.form(peers, self.formation, self.extra_mps, self.off_m)


@row
class ClimbOver(Course):
    """Straight up over this place, against the wind."""

    place_m: Point
    height_m: float

    def velocity(self, controller: Controller, peers: PeerSnapshot) -> Point:
        """Back over the place."""
        return controller.stand_at(peers, self.place_m)


@row
class Intent:
    """What one tick has come to."""

    course: Course | Goal
    """A goal: nothing is steered."""
    phase: Phase
    reason: str | None = None
    """Why the agent waits, holds or lands; '' when all is well, None: as its interruption says."""


@dataclass(slots=True)
class SetpointCount:
    """Setpoints sent so far."""

    count: int = 0
    first_s: float = 0.0
    last_s: float = 0.0

    def add(self, now: float) -> None:
        """One was sent."""
        if self.count == 0:
            self.first_s = now
        self.count += 1
        self.last_s = now

    @property
    def rate_hz(self) -> float:
        """The mean rate from the first to the last one."""
        span = self.last_s - self.first_s
        return (self.count - 1) / span if span > 0 else 0.0


class Steering:
    """One agent's helm."""

    def __init__(self, controller: Controller, vehicle: OwnVehicle, limits: Limits) -> None:
        self._controller, self._vehicle, self._limits = controller, vehicle, limits
        self.setpoints = SetpointCount()
        self.goal_height_m = 0.0
        """The height above the common frame's origin that the vehicle flies to."""

    def fly(self, tick: Tick, course: Course | Goal) -> Goal:
        """The vehicle's goal in this tick. Without a fresh fix what is steered stands still."""
        controller, fix = self._controller, tick.fix
        if fix is not None:  # what is not steered comes down
            self.goal_height_m = -fix.position_ned_m[2] - self._vehicle.height(fix)
        if not isinstance(course, Course):
            controller.rest()
            return course
        if fix is None:
            controller.rest()
            return self._setpoint(tick.now, 0.0, 0.0, 0.0)
        vehicle, layers = self._vehicle, controller.safety_filter.layers
        missing_m = vehicle.target_height_m - vehicle.height(fix)
        lands = isinstance(course, KeepClear) and (course.down or course.room_m > 0.0)
        controller.safety_filter.climbs_m, controller.safety_filter.lands = missing_m, lands
        if not lands:
            self.goal_height_m = missing_m - fix.position_ned_m[2]
        velocity = course.velocity(controller, tick.peers)
        if isinstance(course, ClimbOver):
            flown = complex(*fix.velocity_ned_mps[:2])
            sent = complex(*velocity) + controller.headwind.meet(complex(*velocity), flown)
            sent -= complex(*fix.drift_mps)
            return AirborneGoal(course.height_m, (sent.real, sent.imag))
        against, drift = self._against(tick, complex(*velocity), fix), fix.drift_mps
        north, east = velocity[0] + against.real - drift[0], velocity[1] + against.imag - drift[1]
        waits = controller.safety_filter.waits or layers.waits_for is not None
        climb_mps = 0.0 if waits else climb_rate(missing_m, self._limits)
        return self._setpoint(tick.now, north, east, climb_mps)

    def _against(self, tick: Tick, setpoint: complex, fix: OwnFix) -> complex:
        """What is added to the setpoint of a PX4. An ArduCopter holds its way in the wind itself:
        it goes by places."""
        headwind, view = self._controller.headwind, tick.view
        if not (view.climbs_by_setpoints and view.controlled) or view.on_ground:
            return headwind.fade()
        flown = complex(*fix.velocity_ned_mps[:2])
        response_s, most_mps = self._controller.estimate.response_s, self._limits.speed_mps
        return headwind.steady(setpoint, flown, response_s, most_mps)

    def _setpoint(self, now: float, north: float, east: float, climb_mps: float) -> FlyGoal:
        self.setpoints.add(now)
        return FlyGoal((north, east, -climb_mps))
