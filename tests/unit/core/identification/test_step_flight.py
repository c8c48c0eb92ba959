"""The flight that measures a vehicle: what it refuses on the ground, its schedule, what ends it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from swarm_ctl.core.identification.step_flight import StepFlight, Steps
from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.messages import Outcome
from swarm_ctl.core.model.plan import Fence, Response
from swarm_ctl.core.model.vehicle import (
    AirborneGoal,
    Contact,
    FlyGoal,
    GlobalFix,
    Goal,
    LandGoal,
    LocalFix,
    ReleaseGoal,
    StandbyGoal,
    VehicleView,
)
from tests.unit.core.builders import NOW, ORIGIN, PARKED, view

TICK_S = 0.05
STEPS = Steps(speed_mps=3.0, height_m=5.0)
BOX = STEPS.box_m


def square(half_m: float, height_m: float = 20.0) -> Fence:
    corners = ((-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m))
    return Fence(corners, height_m)


class Vehicle:
    """A vehicle that does at once what it is told, on a virtual clock."""

    def __init__(self, steps: Steps = STEPS, fence: Fence | None = None, **seen: Any) -> None:
        self.flight = StepFlight(steps, Response(), TICK_S, fence, ORIGIN)
        self.now, self.seen = NOW, seen
        self.at, self.velocity = [0.0, 0.0, 0.0], (0.0, 0.0, 0.0)
        self.armed = self.controlled = False
        self.setpoints: list[tuple[float, float, float]] = []

    def view(self) -> VehicleView:
        north, east, down = self.at
        place = geodetic_from_ned((north, east, down), ORIGIN)
        found = view(
            heartbeat_s=self.now,
            local=LocalFix(self.now, (north, east, down), self.velocity),
            global_=GlobalFix(self.now, place, -down, self.velocity),
            armed=self.armed,
            controlled=self.controlled,
            on_ground=down > -0.1,
            released=True,
        )
        return replace(found, **self.seen)

    def tick(self, stop: str = "") -> Goal:
        self.now += TICK_S
        goal = self.flight.step(self.now, self.view(), stop)
        self.velocity = (0.0, 0.0, 0.0)
        match goal:
            case AirborneGoal(height_m=height_m):
                self.armed = True
                self.at[2] = max(-height_m, self.at[2] - 2.0 * TICK_S)
            case FlyGoal(velocity_ned_mps=velocity):
                self.velocity, self.controlled = velocity, True
                self.at = [a + v * TICK_S for a, v in zip(self.at, velocity, strict=True)]
                self.setpoints.append(velocity)
            case LandGoal():
                self.controlled = False
                self.at[2] = min(0.0, self.at[2] + 2.0 * TICK_S)
                self.armed = self.at[2] < -0.05
            case ReleaseGoal() | StandbyGoal():
                pass
        return goal

    def run(self, seconds: float = 400.0, stop: str = "") -> None:
        until = self.now + seconds
        while self.flight.ended is None and self.now < until:
            self.tick(stop)

    @property
    def ended(self) -> tuple[Outcome, str]:
        assert self.flight.ended is not None
        return self.flight.ended.outcome, self.flight.ended.reason


# --- what is refused on the ground ---

NOT_READY = {"healthy": False, "health_reason": "no SYS_STATUS"}
REFUSALS: list[tuple[str, dict[str, Any], float, str]] = [
    ("armed already", {"armed": True}, 0.1, "the vehicle is armed already"),
    ("in the air", PARKED | {"on_ground": False}, 0.1, "the vehicle is in the air already"),
    ("a fault", {"fault": "a fixed wing"}, 0.1, "a fixed wing"),
    ("not ready", NOT_READY, 121.0, "not ready after 120 s: no SYS_STATUS"),
    ("no position", {"global_": None}, 121.0, "not ready after 120 s"),
    ("silent", NOT_READY | {"heartbeat_s": -math.inf}, 16.0, "not ready after 15 s"),
]


@pytest.mark.parametrize(("what", "seen", "after_s", "why"), REFUSALS, ids=[r[0] for r in REFUSALS])
def test_what_is_refused(what: str, seen: dict[str, Any], after_s: float, why: str) -> None:
    """Without arming: the vehicle gets no goal but standby."""
    vehicle = Vehicle(**seen)
    goals = {type(vehicle.tick()) for _ in range(round(after_s / TICK_S))}
    assert goals == {StandbyGoal}
    outcome, reason = vehicle.ended
    assert outcome is Outcome.FAILED
    assert why in reason


@pytest.mark.parametrize(
    ("fence", "why"),
    [
        (square(BOX + 0.1), ""),
        (square(BOX - 0.1), "the box of 13.5 m around the vehicle is not all inside"),
        (square(99.0, STEPS.height_m), ""),
        (square(99.0, STEPS.height_m - 0.1), "5 m is above the geofence, which ends at 4.9 m"),
    ],
    ids=["just inside", "beyond", "just low enough", "too high"],
)
def test_the_box_lies_inside_the_geofence(fence: Fence, why: str) -> None:
    vehicle = Vehicle(fence=fence)
    vehicle.run(2.0)
    if why:
        assert why in vehicle.ended[1]
    else:
        assert vehicle.flight.ended is None


# --- what ends it in the air ---


def contact(north_m: float, up_m: float) -> Contact:
    place = geodetic_from_ned((north_m, 0.0, -up_m), ORIGIN)
    return Contact(NOW, 77, place, (0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("what", "where", "ends"),
    [
        ("near", (8.0, 5.0), True),
        ("far", (60.0, 5.0), False),
        ("high above", (8.0, 20.0), False),
        ("parked beside the start", (8.0, 1.0), False),
    ],
)
def test_traffic_ends_it(what: str, where: tuple[float, float], ends: bool) -> None:
    """Another aircraft within 10 m and 5 m of height lands the vehicle."""
    vehicle = Vehicle()
    vehicle.run(12.0)
    assert vehicle.at[2] == pytest.approx(-STEPS.height_m, abs=0.5)
    vehicle.seen = {"contacts": (contact(*where),)}
    vehicle.run(20.0)
    if ends:
        outcome, reason = vehicle.ended
        assert outcome is Outcome.ABORTED
        assert "another aircraft is" in reason
    else:
        assert vehicle.flight.ended is None
