"""How late a vehicle answers, estimated in flight: what is found, how surely, its stop point."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.core.kernel.response import LATEST_S, coast_of, coasted, pending
from swarm_ctl.core.law.own_response import OwnResponse
from swarm_ctl.core.model.plan import Response

TICK_S = 0.05
MODEL = Response(dead_time_s=0.4, lag_s=0.5, acceleration_mps2=2.8)


class Flight:
    """A vehicle that answers in its own way, and what its agent believes of it."""

    def __init__(self, true: Response, model: Response = MODEL, wind: complex = 0j) -> None:
        self.estimate = OwnResponse(model, TICK_S)
        self._coast = coast_of(true, TICK_S)
        self._under_way = [0j] * pending(true, TICK_S)
        self._wind = wind
        self.place = self.velocity = self.stop_point = 0j

    def fly(self, setpoint: complex, seconds: float) -> None:
        """Tick by tick."""
        for _ in range(round(seconds / TICK_S)):
            self.stop_point = self.estimate.stop_point(self.place, self.velocity)
            self.estimate.sent(setpoint)
            self._under_way.append(setpoint)
            acting = self._under_way.pop(0)
            self.place, self.velocity = coasted(self.place, self.velocity, acting, 1.0, self._coast)
            self.place += self._wind * TICK_S


def swapped(true: Response, wind: complex = 0j) -> Flight:
    """After some seconds of turns, as a swap has them."""
    flight = Flight(true, wind=wind)
    for setpoint in (3 + 1j, -1 + 3j, -3 - 2j, 2 - 2j):
        flight.fly(setpoint, 1.5)
    return flight


@settings(max_examples=30, deadline=None)
@given(st.floats(0.0, 1.3))
def test_it_finds_how_late_the_vehicle_answers(dead_time_s: float) -> None:
    """To a tenth of a second, earlier or later than the model."""
    true = replace(MODEL, dead_time_s=dead_time_s)
    late_s = round(dead_time_s / TICK_S) * TICK_S - MODEL.dead_time_s
    assert swapped(true).estimate.late_s == pytest.approx(late_s, abs=0.1)


@pytest.mark.parametrize("lag_s", [0.1, 0.3, 0.7, 1.0])
def test_another_lag_is_not_taken_for_another_dead_time(lag_s: float) -> None:
    """In quick turns: there it does not act like one."""
    assert abs(swapped(replace(MODEL, lag_s=lag_s)).estimate.late_s) < 0.1


@pytest.mark.parametrize("dead_time_s", [0.0, 0.2, 0.7, 0.9])
def test_the_vehicle_comes_to_rest_at_its_stop_point(dead_time_s: float) -> None:
    """Half a metre off at most where the model alone is off by up to 2.5 m (5 m/s, 0.5 s)."""
    flight = swapped(replace(MODEL, dead_time_s=dead_time_s))
    flight.fly(4 + 0j, 2.0)
    predicted = flight.stop_point + 4 * TICK_S
    flight.fly(0j, 6.0)
    assert abs(flight.place - predicted) < 0.5


@pytest.mark.parametrize("dead_time_s", [0.4, 0.6, 0.9])
def test_the_limit_of_acceleration_acts_on_what_has_yet_to_be_flown(dead_time_s: float) -> None:
    """A vehicle at 6 m/s is told to turn round: it comes to rest at its stop point, as told while
    it still flew on. As plain sums of what has yet to be flown, stop points lay 1.5 m and 2.4 m
    off where the vehicle answers later than its model."""
    flight = swapped(replace(MODEL, dead_time_s=dead_time_s))
    flight.fly(6 + 0j, 4.0)
    flight.fly(-6 + 0j, 0.8)
    predicted = flight.stop_point - 6 * TICK_S
    flight.fly(0j, 6.0)
    assert abs(flight.place - predicted) < 0.4


def test_a_right_model_is_left_alone() -> None:
    """Also in a steady wind that pushes the vehicle by 0.3 m/s."""
    for wind in (0j, 0.3j):
        assert abs(swapped(MODEL, wind).estimate.late_s) < 0.05


def test_doubt_falls_with_motion_and_not_with_time() -> None:
    """From the model's own to a twentieth of a second."""
    flight = Flight(MODEL)
    flight.fly(0j, 30.0)
    assert flight.estimate.doubt_s == pytest.approx(MODEL.doubt_s)
    flight.fly(3 + 0j, 1.5)
    assert flight.estimate.doubt_s < 0.2
    assert swapped(MODEL).estimate.doubt_s == pytest.approx(0.05, abs=0.02)
    assert Flight(MODEL, replace(MODEL, doubt_s=0.1)).estimate.doubt_s == pytest.approx(0.1)


def test_it_is_bounded() -> None:
    """A vehicle that does not move at all is not waited for without end."""
    flight = Flight(MODEL)
    for _ in range(200):
        flight.estimate.stop_point(0j, 0j)
        flight.estimate.sent(5 + 0j)
    assert flight.estimate.late_s <= LATEST_S


def test_a_position_that_is_corrected_is_not_a_response() -> None:
    """A jump of 4 m, as after a GPS glitch, moves the estimate by less than 0.1 s."""
    flight = swapped(MODEL)
    before = flight.estimate.late_s
    flight.place += 4 + 0j
    flight.fly(2 + 2j, 1.0)
    assert flight.estimate.late_s == pytest.approx(before, abs=0.1)


def test_a_restart_forgets_the_motion_and_keeps_the_estimate() -> None:
    """After a landing or a pilot's flight, the vehicle stands where it is."""
    flight = swapped(replace(MODEL, dead_time_s=0.7))
    late_s = flight.estimate.late_s
    flight.estimate.restart()
    assert flight.estimate.stop_point(7 + 0j, 0j) == 7 + 0j
    assert flight.estimate.late_s == pytest.approx(late_s, abs=1e-9)


def test_a_vehicle_that_stands_is_known_as_well_after_a_restart() -> None:
    """Of two that fly and stand alike, one starts afresh, half a metre from where maps begin: both
    know the same, and go on to."""
    one, other = (swapped(replace(MODEL, dead_time_s=0.7)) for _ in range(2))
    for flight in (one, other):
        flight.fly(0j, 40.0)
    believed = one.estimate.late_s, one.estimate.doubt_s
    one.estimate.restart()
    moved, one.place = 0.5j - one.place, 0.5j
    assert (one.estimate.late_s, one.estimate.doubt_s) == believed
    for setpoint in (3 + 1j, -2j):
        for flight in (one, other):
            flight.fly(setpoint, 0.5)
        assert one.estimate.late_s == pytest.approx(other.estimate.late_s, abs=1e-9)
        assert one.estimate.doubt_s == pytest.approx(other.estimate.doubt_s, abs=1e-9)
        assert one.stop_point - moved == pytest.approx(other.stop_point, abs=1e-9)
