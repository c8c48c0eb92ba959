"""A vehicle whose velocity loop is a PX4's, in wind."""

from __future__ import annotations

import pytest

from swarm_ctl.core.control.controller import Headwind
from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS

TICK_S, DRAG_PER_S, WIND_MPS = 0.05, 1.0, 4.0


class Vehicle:
    """P 1.8, I 0.4, and the drag of the SIH quadrotor."""

    def __init__(self) -> None:
        self.place = self.velocity = self.integral = 0.0

    def tick(self, setpoint: float) -> None:
        error = setpoint - self.velocity
        self.integral += 0.4 * error * TICK_S
        air = DRAG_PER_S * (WIND_MPS - self.velocity)
        self.velocity += (1.8 * error + self.integral + air) * TICK_S
        self.place += self.velocity * TICK_S


def test_the_wind_takes_a_climbing_vehicle_along_by_little() -> None:
    """With setpoints of zero it goes 4 m and on."""
    vehicle, headwind = Vehicle(), Headwind(AUTOPILOT_KINDS["px4"].response, TICK_S)
    for _ in range(80):
        vehicle.tick(headwind.meet(0j, complex(vehicle.velocity)).real)
    assert 0.0 < vehicle.place < 1.5
    plain = Vehicle()
    for _ in range(80):
        plain.tick(0.0)
    assert plain.place > 4.0


def test_what_is_added_fades_as_the_vehicle_learns() -> None:
    """After the climb the vehicle stays: its integrator takes over at the rate of the fading."""
    vehicle, headwind = Vehicle(), Headwind(AUTOPILOT_KINDS["px4"].response, TICK_S)
    for _ in range(80):
        vehicle.tick(headwind.meet(0j, complex(vehicle.velocity)).real)
    begun, added = vehicle.place, abs(headwind.added)
    assert added > 1.0
    for _ in range(500):
        vehicle.tick(headwind.fade().real)
        assert abs(vehicle.velocity) < 0.3
    assert abs(vehicle.place - begun) < 1.0
    assert abs(headwind.added) < 0.01


@pytest.mark.parametrize(("steadied", "flown_on_m"), [(False, 4.1), (True, 2.2)])
def test_a_vehicle_that_brakes_does_not_fly_on(steadied: bool, flown_on_m: float) -> None:
    """What its integrator held against the air carries it on; by its response it goes 1.8 m."""
    vehicle, headwind = Vehicle(), Headwind(AUTOPILOT_KINDS["px4"].response, TICK_S)

    def fly(setpoint: float, ticks: int) -> float:
        for _ in range(ticks):
            flown, added = complex(vehicle.velocity), 0.0
            if steadied:
                added = headwind.steady(complex(setpoint), flown, 0.9, 2.0).real
            vehicle.tick(setpoint + added)
        return vehicle.place

    begun = fly(2.0, 400)
    assert fly(0.0, 200) - begun == pytest.approx(flown_on_m, abs=0.1)


def test_no_vehicle_is_told_to_fly_faster_than_it_may() -> None:
    """But by what autopilots overshoot: one that gathers speed late would overtake its setpoint."""
    headwind = Headwind(AUTOPILOT_KINDS["px4"].response, TICK_S)
    for _ in range(100):
        added = headwind.steady(1.5 + 1.5j, 0j, 0.9, 2.2)
        along = abs(1.5 + 1.5j) + (added * (1.0 - 1.0j)).real / abs(1.0 + 1.0j)
        assert along <= 1.2 * 2.2 + 1e-9
    assert headwind.added.real > 0.0
