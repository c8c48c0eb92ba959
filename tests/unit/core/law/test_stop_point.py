"""The stop point: exact for dead time plus lag, and where the vehicle really comes to rest."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.law.stop_point import Coast, pending, stop_distance, stop_points
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
        return complex(Coast(self.vehicle, DT).rest(self.p, self.v, self.delayed))


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


def test_at_rest_the_stop_point_is_the_position() -> None:
    under_way = [0j] * pending(VEHICLE, DT)
    assert Coast(VEHICLE, DT).rest(3 - 4j, 0j, under_way) == pytest.approx(3 - 4j)


def test_batch_is_the_same_as_one_by_one() -> None:
    """Leading axes are vehicles."""
    rng = np.random.default_rng(1)
    p, v, c = rng.normal(size=(3, 4, 2)), rng.normal(size=(3, 4, 2)), rng.normal(size=(3, 4, 8, 2))
    p, v, c = 3 * p, 3 * v, 3 * c  # fast enough to meet the acceleration limit
    batch = stop_points(p, v, c, DT, VEHICLE)
    under_way = [complex(*row) for row in c[1, 2]]
    one = Coast(VEHICLE, DT).rest(complex(*p[1, 2]), complex(*v[1, 2]), under_way)
    assert complex(*batch[1, 2]) == pytest.approx(one)


def test_stop_distance_has_no_jump_where_braking_saturates() -> None:
    knee = VEHICLE.acceleration_mps2 * VEHICLE.lag_s
    below, above = stop_distance(np.array([knee - 1e-9, knee + 1e-9]), VEHICLE, np.maximum)
    assert above == pytest.approx((knee**2 + knee**2) / (2 * VEHICLE.acceleration_mps2))
    assert below == pytest.approx(above, abs=1e-6)
