"""The own position in the common frame, from the vehicle's own frame."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.control.navigation import DRIFT_MAX_MPS, Navigator, OwnFix
from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.vehicle import GlobalFix, LocalFix, Vector3, VehicleView
from tests.unit.core.builders import NOW, ORIGIN, view

metres = st.floats(-500.0, 500.0)
speeds = st.floats(-20.0, 20.0)
vectors = st.tuples(metres, metres, st.floats(-100.0, 0.0))


def seen(
    at: Vector3 = (3.0, 4.0, -5.0), velocity: Vector3 = (0.0, 0.0, 0.0), **more: Any
) -> VehicleView:
    return view(local=LocalFix(NOW, at, velocity), **more)


def fixed(of: VehicleView, now: float = NOW) -> OwnFix:
    found = Navigator(ORIGIN).fix(of, now)
    assert found is not None
    return found


def test_without_a_local_position_or_its_origin_there_is_none() -> None:
    navigator = Navigator(ORIGIN)
    assert navigator.fix(view(local=None), NOW) is None
    assert navigator.fix(view(origin=None), NOW) is None


@given(vectors, vectors)
def test_the_origin_of_the_vehicle_is_an_offset(at: Vector3, off: Vector3) -> None:
    """A vehicle whose own origin lies elsewhere is where the two together say."""
    found = fixed(seen(at, origin=geodetic_from_ned(off, ORIGIN)))
    expected = [a + b for a, b in zip(at, off, strict=True)]
    assert found.position_ned_m == pytest.approx(expected, abs=0.05)
    assert found.height_m == -at[2]


def test_an_origin_that_moves_moves_the_position() -> None:
    """An EKF that is reset tells a new origin; the old offset is not kept."""
    navigator = Navigator(ORIGIN)
    navigator.fix(seen(), NOW)
    moved = navigator.fix(seen(origin=geodetic_from_ned((100.0, 0.0, 0.0), ORIGIN)), NOW)
    assert moved is not None
    assert moved.position_ned_m == pytest.approx((103.0, 4.0, -5.0), abs=0.01)


@given(st.tuples(speeds, speeds, speeds), st.floats(0.0, 3.0))
def test_it_is_carried_on_for_half_a_second(velocity: Vector3, age_s: float) -> None:
    """With its velocity, to the time that is asked for, and no longer; the age goes on."""
    found = fixed(seen(velocity=velocity), NOW + age_s)
    ahead = min(age_s, 0.5)
    expected = [a + v * ahead for a, v in zip((3.0, 4.0, -5.0), velocity, strict=True)]
    assert found.position_ned_m == pytest.approx(expected, abs=1e-6)
    assert found.age_s == pytest.approx(age_s)
    assert found.velocity_ned_mps == velocity


def test_the_two_positions_are_compared_horizontally() -> None:
    """[m]; 0 without GLOBAL_POSITION_INT."""
    place = geodetic_from_ned((3.0, 10.0, -90.0), ORIGIN)
    told = seen(global_=GlobalFix(NOW, place, 90.0, (0.0, 0.0, 0.0)))
    navigator, own = Navigator(ORIGIN), fixed(told)
    assert navigator.disagreement_m(told, own) == pytest.approx(6.0, abs=0.01)
    assert navigator.disagreement_m(replace(told, global_=None), own) == 0.0


def flown(
    navigator: Navigator, seconds: float, true_mps: complex, told_mps: complex, at_m: complex = 0j
) -> complex:
    """The drift after reports at 20 Hz of a vehicle that flies `true_mps` and tells `told_mps`."""
    drift = 0j
    for tick in range(1, round(seconds * 20) + 1):
        place = at_m + true_mps * tick / 20
        report = LocalFix(
            NOW, (place.real, place.imag, -10.0), (told_mps.real, told_mps.imag, 0.0), tick / 20
        )
        found = navigator.fix(view(local=report), NOW)
        assert found is not None
        drift = complex(*found.drift_mps)
        carried = complex(*found.velocity_ned_mps[:2])
        assert carried == pytest.approx(told_mps + drift)
    return drift


def test_a_velocity_that_its_positions_deny_is_corrected_within_seconds() -> None:
    drift = flown(Navigator(ORIGIN), 4.0, 1.6 + 0.2j, 2.0 - 0.3j)
    assert drift == pytest.approx(-0.4 + 0.5j, abs=0.03)


def test_the_drift_is_bounded_and_a_jump_of_the_position_is_none() -> None:
    """A position that stands still at 5 m/s is an estimator that failed, not a drift."""
    navigator = Navigator(ORIGIN)
    assert abs(flown(navigator, 10.0, 0j, 5.0 + 0j)) <= DRIFT_MAX_MPS + 1e-9
    calm = Navigator(ORIGIN)
    flown(calm, 2.0, 1.0 + 0j, 1.0 + 0j)
    report = LocalFix(NOW, (2.0 + 40.0, 0.0, -10.0), (1.0, 0.0, 0.0), 2.05)
    jumped = calm.fix(view(local=report), NOW)
    assert jumped is not None
    assert math.hypot(*jumped.drift_mps) < 1e-6
