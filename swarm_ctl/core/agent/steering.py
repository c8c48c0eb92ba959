"""From what an agent decided to the goal that its vehicle is given in this tick."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from swarm_ctl.core.agent.flight import OwnVehicle
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.control.altitude import climb_rate
from swarm_ctl.core.control.controller import Controller
from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import Limits, Point
from swarm_ctl.core.model.rows import row
from swarm_ctl.core.model.vehicle import AirborneGoal, FlyGoal, Goal
from swarm_ctl.core.swarm.snapshot import Formation

NO_FIX = "no fresh position from the vehicle"


@row
class KeepClear:
    """Stay, and make room for what comes close."""

    ground: bool = False
    """Also for vehicles that stand on the ground."""
    room_m: float = 0.0
    """So much at least."""


@row
class FlyTo:
    """Straight to a point [m, common frame], around what stands in the way."""

    to_m: Point
    speed_mps: float


@row
class FlyShape:
    """The law, towards the own slot."""

    formation: Formation
    extra_mps: Point
    """The velocity of the own place, on top of the law."""
    off_m: Point | None
    """From the own stop point to the own place, on the agent that is pinned to it."""


@row
class ClimbOver:
    """Straight up over this place, against the wind."""

    place_m: Point
    height_m: float


Course: TypeAlias = KeepClear | FlyTo | FlyShape | ClimbOver
"""What is flown by setpoints of ours."""


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

    def fly(self, tick: Tick, course: Course | Goal) -> Goal:
        """The vehicle's goal in this tick. Without a fresh fix what is steered stands still."""
        controller, fix = self._controller, tick.fix
        if not isinstance(course, Course):
            controller.rest()
            return course
        if fix is None:
            controller.rest()
            return self._setpoint(tick.now, 0j, 0.0)
        match course:
            case KeepClear():
                velocity = controller.keep_clear(
                    tick.peers, ground=course.ground, room_m=course.room_m
                )
            case FlyTo():
                velocity = controller.go_to(tick.peers, course.to_m, course.speed_mps)
            case FlyShape():
                velocity = controller.form(
                    tick.peers, course.formation, course.extra_mps, course.off_m
                )
            case ClimbOver():
                return self._climb(tick, fix, course)
        sent = complex(*velocity) + controller.headwind.fade() - complex(*fix.drift_mps)
        missing_m = self._vehicle.target_height_m - self._vehicle.height(fix)
        return self._setpoint(tick.now, sent, climb_rate(missing_m, self._limits))

    def _climb(self, tick: Tick, fix: OwnFix, course: ClimbOver) -> AirborneGoal:
        controller = self._controller
        wanted = complex(*controller.stand_at(tick.peers, course.place_m))
        against = controller.headwind.meet(wanted, complex(*fix.velocity_ned_mps[:2]))
        sent = wanted + against - complex(*fix.drift_mps)
        return AirborneGoal(course.height_m, (sent.real, sent.imag))

    def _setpoint(self, now: float, velocity: complex, climb_mps: float) -> FlyGoal:
        self.setpoints.add(now)
        return FlyGoal((velocity.real, velocity.imag, -climb_mps))
