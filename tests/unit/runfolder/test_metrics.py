"""The numbers of a flight."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from swarm_ctl.core.law import formation
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.runfolder.files import Damage
from swarm_ctl.runfolder.flight import Flight, TrackSource, flight_of
from swarm_ctl.runfolder.metrics import (
    approaches,
    formation_error,
    last_number,
    longest_link,
    time_to_settle,
    zone_distance,
)
from swarm_ctl.runfolder.truth import Bools, Floats, Truth

metres = st.floats(-500, 500, allow_nan=False)
slots = hnp.arrays(np.float64, (4, 2), elements=metres)
paths = hnp.arrays(np.float64, (3, 4, 2), elements=metres)
alive = hnp.arrays(np.bool_, (3, 4))


def _flight(
    points: Floats,
    live: Bools | None = None,
    source: TrackSource = TrackSource.TRUTH,
    airborne: Bools | None = None,
) -> Flight:
    moments, n = points.shape[:2]
    flags, none = np.ones((moments, n), bool), np.zeros((moments, n))
    return Flight(
        np.linspace(0.0, 1.0, moments),
        np.concatenate([points, np.zeros((moments, n, 1))], axis=-1),
        none,
        flags,
        flags if airborne is None else airborne,
        flags if live is None else live,
        none + 0.1,
        (source,) * n,
    )


@given(paths, slots, alive)
def test_formation_error_is_the_laws_over_the_live_agents(points, slots, live) -> None:  # type: ignore[no-untyped-def]
    found = formation_error(_flight(points, live), slots)
    for k in range(3):
        chosen = live[k]
        if chosen.any():
            assert found[k] == pytest.approx(
                float(formation.formation_error(points[k, chosen], slots[chosen])), abs=1e-9
            )
        else:
            assert np.isnan(found[k])


TIMES = np.arange(0, 20.05, 0.1)


@pytest.mark.parametrize(
    ("under", "expected"),
    [
        ([(3.0, 20.0)], 2.0),
        ([(3.0, 7.9), (9.0, 20.0)], 8.0),
        ([(3.0, 8.0)], 2.0),
        ([(0.0, 20.0)], 0.0),
        ([(3.0, 7.8)], None),
        ([(16.0, 20.0)], None),
        ([(12.1, 20.0)], None),
        ([(12.0, 20.0)], 11.0),
        ([], None),
    ],
)
def test_time_to_settle(under: list[tuple[float, float]], expected: float | None) -> None:
    """The form step starts at 1 s, the landing at 12 s, and the shape has to stand for 5 s."""
    error = np.full(len(TIMES), 3.0)
    for start, end in under:
        error[np.abs(TIMES - (start + end) / 2) <= (end - start) / 2 + 0.01] = 0.4
    found = time_to_settle(TIMES, error, 1.0, 12.0, tolerance_m=0.5, settle_s=5.0)
    assert found == (None if expected is None else pytest.approx(expected))


def test_the_tolerance_itself_is_not_under_it_and_nan_is_not_either() -> None:
    assert time_to_settle(TIMES, np.full(len(TIMES), 0.5), 0.0, 20.0, 0.5, 5.0) is None
    assert time_to_settle(TIMES, np.full(len(TIMES), np.nan), 0.0, 20.0, 0.5, 5.0) is None
    assert time_to_settle(np.zeros(0), np.zeros(0), 0.0, 20.0, 0.5, 5.0) is None


@given(
    hnp.arrays(np.float64, 40, elements=st.sampled_from([0.1, 0.9, np.nan])),
    st.integers(0, 39),
    st.integers(0, 8),
)
def test_time_to_settle_is_the_first_window_that_holds(error, start, window) -> None:  # type: ignore[no-untyped-def]
    times = np.arange(40.0)
    found = time_to_settle(times, error, float(start), 39.0, 0.5, float(window))
    wanted = next(
        (k for k in range(start, 40 - window) if all(error[k : k + window + 1] < 0.5)), None
    )
    assert found == (None if wanted is None else wanted - start)


def test_longest_link_counts_only_links_with_two_live_ends() -> None:
    points = np.array([[[0, 0], [3, 4], [0, 90]], [[0, 0], [6, 8], [0, 1]]], dtype=float)
    live = np.array([[True, True, False], [True, True, True]])
    assert longest_link(_flight(points, live), [(0, 1), (0, 2)]) == (10.0, (0, 1))
    assert longest_link(_flight(points), [(0, 1), (0, 2)]) == (90.0, (0, 2))
    assert longest_link(_flight(points, np.zeros((2, 3), bool)), [(0, 1)]) is None


def _truth() -> Truth:
    return Truth(
        sysids=(7, 9),
        time_s=np.array([0.0, 1.0, 2.0]),
        position_ned_m=np.arange(18.0).reshape(3, 2, 3),
        descent_mps=np.zeros((3, 2)),
        armed=np.ones((3, 2), bool),
        airborne=np.array([[False, True], [True, True], [True, True]]),
        minima={(7, 9): 2.0, (7, 8): 1.5},
        minima_s={(7, 9): 1.0, (7, 8): 1.0},
        events=(),
        last_s=2.0,
        complete=True,
        damage=Damage(),
    )


def test_a_flight_has_the_plans_order_and_the_agents_lives() -> None:
    flight = flight_of(_truth(), (9, 8, 7), (1.0, np.inf, np.inf))
    np.testing.assert_array_equal(flight.points_m[0, 0], [3.0, 4.0])
    np.testing.assert_array_equal(flight.points_m[0, 2], [0.0, 1.0])
    assert np.isnan(flight.points_m[:, 1]).all()
    np.testing.assert_array_equal(
        flight.live, [[True, False, False], [True, False, True], [False, False, True]]
    )
    np.testing.assert_array_equal(flight.during(1.0, 1.5).time_s, [1.0])


def test_two_that_pass_between_two_moments_are_seen() -> None:
    """From 10 m apart to 10 m apart on the other side, 1 m beside each other half way."""
    points = np.array([[[0, 0], [-10, 1]], [[0, 0], [10, 1]]], dtype=float)
    (found,) = approaches(_flight(points))
    assert (found.columns, found.distance_m, found.time_s) == ((0, 1), 1.0, 0.5)
    assert found.doubt_m == pytest.approx(0.2)


@given(paths)
def test_an_approach_is_never_farther_than_any_moment(points) -> None:  # type: ignore[no-untyped-def]
    least = {found.columns: found.distance_m for found in approaches(_flight(points))}
    assert len(least) == 6
    for (i, j), distance_m in least.items():
        moments = np.linalg.norm(points[:, i] - points[:, j], axis=-1)
        assert distance_m <= moments.min() + 1e-6


def test_on_the_ground_the_noise_of_estimates_is_no_approach() -> None:
    """By the truth any distance counts while some vehicle flies."""
    points = np.array([[[0, 0], [1, 0]], [[0, 0], [1, 0]]], dtype=float)
    one = np.array([[True, False]] * 2)
    assert list(approaches(_flight(points, source=TrackSource.ESTIMATES, airborne=one))) == []
    assert len(list(approaches(_flight(points, airborne=one)))) == 1
    assert list(approaches(_flight(points, airborne=np.zeros((2, 2), bool)))) == []


def test_last_number() -> None:
    assert last_number(np.array([1.0, 2.0, np.nan])) == 2.0
    assert last_number(np.array([np.nan])) is None


corners = st.lists(st.tuples(metres, metres), min_size=3, max_size=9).map(tuple)
zones = st.builds(Zone, st.just("z"), corners, st.just(0.0), st.just(1.0)) | st.builds(
    Zone, st.just("z"), st.tuples(st.tuples(metres, metres)), st.floats(0.1, 200.0), st.just(1.0)
)


@example(Zone("z", ((0.0, 0.0), (0.0, 0.0), (0.0, 2e-308)), 0.0, 1.0), np.full((5, 2), 4.0))
@given(zones, hnp.arrays(np.float64, (5, 2), elements=metres))
def test_the_distance_to_a_zone_is_that_to_its_outline_and_zero_inside(
    zone: Zone, points: Floats
) -> None:
    """By the zone's own word on what is inside, and by many points of its outline."""
    found = zone_distance(points, zone)
    outline = np.array([*zone.corners_m, zone.corners_m[0]])
    share = np.linspace(0.0, 1.0, 400)[:, None, None]
    many = (outline[:-1] + share * np.diff(outline, axis=0)).reshape(-1, 2)
    spaced = np.linalg.norm(np.diff(outline, axis=0), axis=-1).max() / 399
    for point, away in zip(points, found, strict=True):
        beside = np.linalg.norm(many - point, axis=-1).min()
        if zone.radius_m:
            assert away == pytest.approx(max(0.0, beside - zone.radius_m), abs=1e-9)
        elif beside > spaced:  # nearer, it may lie on the outline between two of them
            assert (away == 0.0) == zone.contains((point[0], point[1]))
            if away:
                assert away <= beside + 1e-9
                assert away >= beside - spaced - 1e-9
