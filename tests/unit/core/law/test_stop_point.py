"""The stop point: exact for dead time plus lag, and where the vehicle really comes to rest."""

from __future__ import annotations

from collections import deque

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.identification.fit import stop_point
from swarm_ctl.core.kernel.response import coast_of, pending, stop_distance
from swarm_ctl.core.model.plan import Response

DT = 0.05
VEHICLE = Response(dead_time_s=0.4, lag_s=0.5, acceleration_mps2=2.8)
SPEED = st.floats(-4.0, 4.0)
VECTOR = st.tuples(SPEED, SPEED)


class Simulated:
    """Dead time, lag, acceleration limit, integrated in fine steps. A complex number is north +
    east * 1j."""

    def __init__(self, vehicle: Response) -> None:
        self.vehicle = vehicle
        self.p = self.v = 0j
        self.delayed = deque([0j] * pending(vehicle, DT))

    def tick(self, command: complex, fine: int = 50) -> None:
        self.delayed.append(command)
        acting = self.delayed.popleft()
        for _ in range(fine):
            a = (acting - self.v) / self.vehicle.lag_s
            a *= min(1.0, self.vehicle.acceleration_mps2 / max(1e-12, abs(a)))
            self.v += a * DT / fine
            self.p += self.v * DT / fine

    def stop_point(self) -> complex:
        return stop_point(self.p, self.v, self.delayed, DT, self.vehicle)


@given(st.lists(VECTOR, min_size=1, max_size=60))
def test_vehicle_comes_to_rest_there(commands: list[tuple[float, float]]) -> None:
    """After any commands, told to stop, the vehicle rests within 10 cm of its stop point."""
    vehicle = Simulated(VEHICLE)
    for command in commands:
        vehicle.tick(complex(*command))
    predicted = vehicle.stop_point()
    for _ in range(200):
        vehicle.tick(0j)
    assert abs(vehicle.v) < 1e-3
    assert vehicle.p == pytest.approx(predicted, abs=0.1)


@given(st.lists(VECTOR, min_size=2, max_size=40))
def test_single_integrator_seen_from_the_stop_point(commands: list[tuple[float, float]]) -> None:
    """Without saturation ds/dt = v_cmd: the stop point moves by command * dt each tick, exactly."""
    unbounded = Response(0.4, 0.5, 1e6)
    vehicle = Simulated(unbounded)
    for command in commands:
        before = vehicle.stop_point()
        vehicle.tick(complex(*command), fine=200)
        assert vehicle.stop_point() - before == pytest.approx(complex(*command) * DT, abs=2e-3)


def test_stop_distance_has_no_jump_where_braking_saturates() -> None:
    knee = VEHICLE.acceleration_mps2 * VEHICLE.lag_s
    below, above = (
        stop_distance(speed, coast_of(VEHICLE, DT)) for speed in (knee - 1e-9, knee + 1e-9)
    )
    assert above == pytest.approx((knee**2 + knee**2) / (2 * VEHICLE.acceleration_mps2))
    assert below == pytest.approx(above, abs=1e-6)
