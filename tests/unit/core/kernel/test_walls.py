"""What walls ask for, and what is proven of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.core.kernel.constraints import Other, cap, keep_out, margins_of
from swarm_ctl.core.kernel.decide import NearWall, Own, decided
from swarm_ctl.core.kernel.program import Row
from swarm_ctl.core.kernel.response import coasted, model_of, steered, stop_point, unknown
from swarm_ctl.core.kernel.walls import (
    ERROR_M,
    Edge,
    Wall,
    faced,
    keep_off,
    wall_cap,
    wall_margins_of,
)
from swarm_ctl.core.model.plan import LawParameters, Response
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.safety.surroundings import Surroundings

RESPONSE, SPEED_MPS = Response(), 5.0
WALL = wall_margins_of(1.25, RESPONSE, SPEED_MPS)
MARGINS = margins_of(LawParameters(), RESPONSE, SPEED_MPS, 5.0)
angles = st.floats(0, 2 * math.pi)


def unit(angle: float) -> complex:
    return complex(math.cos(angle), math.sin(angle))


def test_a_vehicle_may_stand_wherever_a_wall_holds() -> None:
    """At D and beyond, no velocity is asked for; nearer, the wall is left, and not faster than
    `leaves`."""
    for gap in (WALL.keep, WALL.keep + 0.01, 50.0):
        assert keep_off(gap, WALL) <= 0.0
    assert 0.0 < keep_off(WALL.keep - 0.01, WALL) < WALL.leaves
    assert keep_off(-20.0, WALL) == WALL.leaves


def test_the_cap_falls_towards_the_wall_and_never_to_nothing() -> None:
    gaps = np.linspace(0.0, WALL.reach, 200).tolist()
    for doubt_s in (0.05, 0.5, 1.0):
        caps = [wall_cap(gap, doubt_s, WALL) for gap in gaps]
        assert caps == sorted(caps)
        assert caps[0] > 0.1
    assert wall_cap(WALL.reach, RESPONSE.doubt_s, WALL) == SPEED_MPS


@given(st.floats(0.5, 12), st.floats(0.1, 1), st.floats(1, 8), st.floats(0, 3), st.floats(0.5, 3))
def test_a_wall_beyond_its_reach_asks_for_nothing(
    speed_mps: float, lag_s: float, most_mps2: float, doubt_s: float, clearance_m: float
) -> None:
    """It is not even looked at: the speed limit ensures what it asks for."""
    response = Response(lag_s=lag_s, acceleration_mps2=most_mps2, doubt_s=doubt_s)
    margins = wall_margins_of(clearance_m, response, speed_mps)
    assert keep_off(margins.reach, margins) <= -speed_mps + 1e-9
    assert wall_cap(margins.reach, doubt_s, margins) == pytest.approx(speed_mps)


def test_on_an_edge_itself_the_vector_is_to_one_side_of_it() -> None:
    """And in the middle of a circle northwards: a unit vector in each case."""
    assert faced(Edge(0j, 3 + 4j, 0.0), 1.5 + 2j) == (pytest.approx(0.8 - 0.6j), 0.0)
    assert faced(Edge(2 + 3j, 2 + 3j, 5.0), 2 + 3j) == (1 + 0j, -5.0)


def test_each_cause_of_caution_at_a_wall() -> None:
    """To turn, to stop, and for what is doubted of the own stop point."""
    free = WALL._replace(spare=1e9, braking=1e9)
    half = 0.5 * (WALL.slow + WALL.speed)
    assert wall_cap(WALL.keep + 0.5 * WALL.zone, 0.0, free) == pytest.approx(half)
    stops = free._replace(braking=0.5, zone=1e-9)
    assert wall_cap(WALL.keep + 1.0, 0.0, stops) == pytest.approx(min(WALL.slow + 1.0, 5.0))
    unsure = free._replace(spare=0.5, zone=1e-9)
    assert wall_cap(WALL.keep + 1.0, 0.5, unsure) == pytest.approx(3.0)
    assert wall_cap(WALL.keep - 1.0, 0.5, unsure) == pytest.approx(min(1.0, WALL.slow))


def test_margins_are_the_same_in_any_unit() -> None:
    in_units = wall_margins_of(1.25, RESPONSE, SPEED_MPS, 5.0)
    assert [5.0 * each for each in in_units] == pytest.approx(list(WALL))


@given(st.complex_numbers(max_magnitude=20), st.complex_numbers(max_magnitude=20), angles)
def test_the_nearest_point_of_an_edge(first: complex, last: complex, angle: float) -> None:
    """No point of the edge is nearer than what the normal and the gap say."""
    at = 30.0 * unit(angle)
    normal, gap = faced(Edge(first, last, 0.0), at)
    assert abs(normal) == pytest.approx(1.0)
    nearest = at - normal * gap
    points = [first + (last - first) * share for share in np.linspace(0, 1, 50).tolist()]
    assert all(abs(at - point) >= gap - 1e-6 for point in points)
    assert min(abs(nearest - point) for point in points) <= abs(last - first) / 49 + 1e-6


@settings(max_examples=300, deadline=None)
@given(
    st.complex_numbers(max_magnitude=8),
    st.lists(st.tuples(angles, st.floats(WALL.keep, 12)), min_size=1, max_size=4),
    st.lists(st.tuples(angles, st.floats(0.1, 9), st.complex_numbers(max_magnitude=5)), max_size=4),
    st.sampled_from([0j, 3 + 0j, -1 + 2j]),
)
def test_pairs_that_press_open_no_wall_that_holds(
    wish: complex,
    walls: list[tuple[float, float]],
    others: list[tuple[float, float, complex]],
    moving: complex,
) -> None:
    """Whatever is wished and whoever comes, the velocity satisfies each wall that holds."""
    near = [NearWall(Wall(unit(a), gap, k), WALL) for k, (a, gap) in enumerate(walls)]
    around = [
        Other(k + 2, True, unit(a) * x, v, 0.1, 0.1, True, 0.9, along=k % 2 == 0)
        for k, (a, x, v) in enumerate(others)
    ]
    rows: list[Row] = []
    own = Own(0.3, 0.9, moving)
    counted = (around, len(around), [], 0, near, len(near))
    found = decided(wish, *counted, own, MARGINS, rows)
    for wall, _ in near:
        along = (wall.normal.conjugate() * found.velocity).real
        assert along >= keep_off(wall.gap, WALL) - 1e-6


@settings(max_examples=300, deadline=None)
@given(
    st.complex_numbers(max_magnitude=8),
    st.tuples(angles, st.floats(-6.0, -0.01)),
    st.tuples(angles, st.floats(0.1, 9)),
    st.sampled_from([0j, 3 + 0j, -1 + 2j]),
)
def test_no_pair_gives_way_to_a_zone_that_is_left(
    wish: complex, wall: tuple[float, float], other: tuple[float, float], moving: complex
) -> None:
    """In a zone a vehicle does all that the keep-out asks for, as far as it may be so fast; and
    where nobody is near, it leaves as fast as walls ask for."""
    near = [NearWall(Wall(unit(wall[0]), wall[1], 0), WALL)]
    own = Own(0.3, 0.9, moving)
    close = Other(2, True, unit(other[0]) * other[1], 0j, 0.1, 0.1, True, 0.9, along=False)
    found = decided(wish, [close], 1, [], 0, near, 1, own, MARGINS, [])
    normal, bound, room = keep_out(close, MARGINS)
    fastest = min(cap(room, 0.3, MARGINS), wall_cap(wall[1], 0.3, WALL))
    assert (normal.conjugate() * found.velocity).real >= min(bound, fastest) - 1e-4
    alone = decided(wish, [], 0, [], 0, near, 1, own, MARGINS, [])
    leaves = min(keep_off(wall[1], WALL), wall_cap(wall[1], 0.3, WALL))
    assert (unit(-wall[0]) * alone.velocity).real >= leaves - 1e-4


ZONES = {
    "circle": Zone("tree", ((0.0, 0.0),), 2.0, 1.25),
    "corner": Zone("box", ((-4.0, -4.0), (4.0, -4.0), (4.0, 4.0), (-4.0, 4.0)), 0.0, 1.25),
    "concave": Zone("u", ((0.0, -6.0), (8.0, -6.0), (2.0, 0.0), (8.0, 6.0), (0.0, 6.0)), 0.0, 1.25),
}


def flown(zone: Zone, seed: int, response: Response, ticks: int = 700) -> float:
    """The least distance of positions from a zone: one vehicle that wishes to be beyond it, in it,
    or anywhere, and answers as modelled."""
    dice = np.random.default_rng(seed)
    around = Surroundings([zone], None, response, SPEED_MPS)
    outline = [Edge(complex(*a), complex(*b), zone.radius_m) for a, b in _edges(zone)]
    model = model_of(response, 0.05)
    estimate, sent = unknown(model), [0j] * model.remembered
    place, velocity, least = 20.0 * unit(dice.uniform(0, 7)), 0j, math.inf
    goal = 0j
    for tick in range(ticks):
        if tick % 80 == 0:
            goal = dice.uniform(0, 15) * unit(dice.uniform(0, 7))
        own = stop_point(estimate, place, velocity, sent, model)
        walls = around.near(own, 10.0, 10.0)
        wish = 4.0 * (goal - own)
        wish *= min(1.0, SPEED_MPS / max(abs(wish), 1e-9))
        counted = ([], 0, [], 0, walls, len(walls))
        setpoint = decided(wish, *counted, Own(0.05, 0.9, 0j), MARGINS, []).velocity
        count = estimate.sent
        estimate = steered(estimate, setpoint, sent, model)
        acting = sent[(count - model.pending) % model.remembered]
        place, velocity = coasted(place, velocity, acting, 1.0, model.coast)
        assert abs(setpoint) <= SPEED_MPS + 1e-9
        least = min(least, *(faced(edge, place)[1] for edge in outline))
    return least


def _edges(zone: Zone) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    corners = zone.corners_m
    return list(zip(corners, (*corners[1:], corners[0]), strict=True))


@pytest.mark.parametrize("zone", ZONES.values(), ids=ZONES)
def test_positions_keep_the_clearance_round_corners_too(zone: Zone) -> None:
    """Vehicles that answer as modelled, whatever they wish: what D has for errors is not used."""
    for seed in range(6):
        assert flown(zone, seed, RESPONSE) >= zone.clearance_m
    slow = Response(dead_time_s=0.6, lag_s=0.8, acceleration_mps2=2.0)
    assert flown(zone, 7, slow) >= zone.clearance_m


def test_a_wall_keeps_more_than_its_clearance() -> None:
    """So much is for what the vehicle's own position is off by."""
    assert WALL.keep == 1.25 + ERROR_M
