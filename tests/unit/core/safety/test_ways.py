"""The shortest way round zones keeps off all of them, and is found where there is one."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Sequence

import pytest

from swarm_ctl.core.kernel.walls import Edge, faced
from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.safety.fence import inside
from swarm_ctl.core.safety.ways import WayMap

KEEP_M = 1.75
Outline = tuple[tuple[Point, ...], float, float]


def tree(north: float, east: float, radius: float) -> Outline:
    return ((north, east),), radius, KEEP_M


def length_m(way: list[Point]) -> float:
    return sum(math.dist(a, b) for a, b in itertools.pairwise(way))


def least_m(way: list[Point], outlines: list[Outline]) -> float:
    """The least distance of a way from what it goes round."""
    found = math.inf
    for a, b in itertools.pairwise(way):
        for k in range(101):
            at = complex(*a) + (complex(*b) - complex(*a)) * k / 100
            for corners, radius, _ in outlines:
                ends = zip(corners, (*corners[1:], corners[0]), strict=True)
                edges = [Edge(complex(*c), complex(*d), radius) for c, d in ends]
                found = min(found, *(faced(edge, at)[1] for edge in edges))
    return found


def room_m(a: Point, b: Point, corners: Sequence[Point], *, within: bool = False) -> float:
    """The least distance of points of a line from an outline; under 0 in it, or out of it."""
    ends = list(zip(corners, (*corners[1:], corners[0]), strict=True))
    least = math.inf
    for k in range(101):
        at = complex(*a) + (complex(*b) - complex(*a)) * k / 100
        gap = min(faced(Edge(complex(*c), complex(*d), 0.0), at)[1] for c, d in ends)
        holds = len(corners) > 2 and inside(corners, (at.real, at.imag))
        least = min(least, gap if holds is within else -gap)
    return least


def test_a_free_line_is_the_way() -> None:
    assert WayMap([]).shortest((0.0, 0.0), (50.0, 3.0)) == [(0.0, 0.0), (50.0, 3.0)]
    assert WayMap([tree(20, 9, 2)]).shortest((0, 0), (50, 0)) == [(0, 0), (50, 0)]


def test_round_a_tree_the_way_is_hardly_longer_than_the_string_round_it() -> None:
    way = WayMap([tree(25, 0, 2)]).shortest((0.0, 0.0), (50.0, 0.0))
    assert way is not None
    r = 2 + KEEP_M
    turns = math.acos(r / 25)
    string_m = 2 * (math.sqrt(25**2 - r * r) + r * (math.pi / 2 - turns))
    assert string_m <= length_m(way) < 1.05 * string_m
    assert least_m(way, [tree(25, 0, 2)]) >= KEEP_M


def test_out_of_a_dead_end_the_way_leads_back() -> None:
    trap: Outline = (
        ((10, -10), (40, -10), (40, 10), (10, 10), (10, 8), (38, 8), (38, -8), (10, -8)),
        0.0,
        KEEP_M,
    )
    way = WayMap([trap]).shortest((30.0, 0.0), (60.0, 0.0))
    assert way is not None
    assert length_m(way) > 60
    assert least_m(way, [trap]) >= KEEP_M


def test_there_is_none_through_a_closed_wall_nor_out_of_the_fence() -> None:
    fence = ((-10.0, -20.0), (60.0, -20.0), (60.0, 20.0), (-10.0, 20.0))
    wall: Outline = (((20, -19), (22, -19), (22, 19), (20, 19)), 0.0, KEEP_M)
    assert WayMap([wall]).shortest((0.0, 0.0), (50.0, 0.0)) is not None
    assert WayMap([wall], fence, 0.5).shortest((0.0, 0.0), (50.0, 0.0)) is None


@pytest.mark.parametrize("seed", range(6))
def test_in_a_drawn_wood(seed: int) -> None:
    """The way keeps off each tree, and no detour by one corner more is shorter."""
    dice, trees = random.Random(seed), list[Outline]()
    while len(trees) < 25:
        north, east, r = dice.uniform(12, 76), dice.uniform(-32, 32), dice.uniform(0.5, 3)
        if all(math.dist((north, east), c[0]) > r + q + 1 for c, q, _ in trees):
            trees.append(tree(north, east, r))
    ways = WayMap(trees)
    way = ways.shortest((0.0, 0.0), (88.0, 0.0))
    assert way is not None
    assert least_m(way, trees) >= KEEP_M - 1e-6
    for k in range(len(way) - 2):
        assert not ways.free_line(way[k], way[k + 2])


def test_an_end_that_is_too_near_is_left_outwards() -> None:
    """From where the filter has stopped a vehicle, and from inside by fault, there is a way."""
    ways = WayMap([tree(25, 0, 2)])
    for start in ((21.5, 0.3), (22.8, 0.1)):
        way = ways.shortest(start, (50.0, 0.0))
        assert way is not None
        assert math.dist(way[1], (25, 0)) >= math.dist(start, (25, 0))


@pytest.mark.parametrize("seed", range(4))
def test_a_line_is_free_where_no_point_of_it_comes_too_near(seed: int) -> None:
    """Among circles, polygons and a fence with a notch: as one that looks at points of it has
    found, but for lines that only just touch. The first wall on a line is one that it touches."""
    dice, walls = random.Random(seed), list[Outline]()
    for _ in range(12):
        north, east = dice.uniform(0, 80), dice.uniform(0, 80)
        wide, high = dice.uniform(2, 14), dice.uniform(2, 14)
        corners = ((north, east), (north + wide, east), (north, east + high))
        walls.append(tree(north, east, 2.0) if dice.random() < 0.5 else (corners, 0.0, KEEP_M))
    fence = ((-10.0, -10.0), (90.0, -10.0), (45.0, 20.0), (90.0, 90.0), (-10.0, 90.0))
    ways, told = WayMap(walls, fence, KEEP_M), set[bool]()
    for _ in range(40):
        a, b = ((dice.uniform(-5, 85), dice.uniform(-5, 85)) for _ in range(2))
        rooms = [room_m(a, b, corners) - radius for corners, radius, _ in walls]
        room = min(*rooms, room_m(a, b, fence, within=True))
        if abs(room - KEEP_M) > 0.1:
            assert ways.free_line(a, b) is (room > KEEP_M)
            told.add(room > KEEP_M)
        first = ways.cut_by(a, b)
        if first is not None and first < len(walls):
            assert rooms[first] < KEEP_M + 0.1
    assert told == {True, False}
