"""The nearest allowed velocity: optimal, inside, and least slack where nothing is."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.kernel import program
from swarm_ctl.core.kernel.program import LEAVE, LINK, NONE, PAIR, WALL, Row

Plane = tuple[float, float, float]
Vector = tuple[float, float]
numbers = st.floats(-2, 2)
angles = st.floats(0, 2 * math.pi)
planes = st.lists(
    st.builds(lambda a, b: (math.cos(a), math.sin(a), b), angles, st.floats(-1.2, 0.6)),
    min_size=0,
    max_size=7,
)
caps = st.floats(0.1, 1.5)


def rows(hard: list[Plane], soft: list[Plane]) -> list[Row]:
    levels = [PAIR] * len(hard) + [LINK] * len(soft)
    return [Row(*plane, level, 0, 0) for plane, level in zip([*hard, *soft], levels, strict=True)]


def nearest(wish: Vector, planes: list[Plane], cap: float) -> Vector | None:
    exists, v = program.nearest(complex(*wish), rows(planes, []), len(planes), cap, LINK, NONE)
    return (v.real, v.imag) if exists else None


def relaxed(wish: Vector, hard: list[Plane], soft: list[Plane], cap: float) -> tuple[Vector, float]:
    asked = rows(hard, soft)
    v, slacks = program.relaxed(complex(*wish), asked, len(asked), cap)
    return (v.real, v.imag), slacks[PAIR]


def inside(v: tuple[float, float], of: list[Plane], cap: float, slack: float = 1e-6) -> bool:
    return math.hypot(*v) <= cap + slack and all(
        nx * v[0] + ny * v[1] >= b - slack for nx, ny, b in of
    )


@given(st.tuples(numbers, numbers), planes, caps)
def test_nothing_allowed_is_nearer(wish: tuple[float, float], of: list[Plane], cap: float) -> None:
    """The answer is allowed, and no allowed point of a fine grid is nearer to the wish."""
    found = nearest(wish, of, cap)
    steps = np.linspace(-cap, cap, 41)
    grid = [
        (float(x), float(y))
        for x in steps
        for y in steps
        if inside((float(x), float(y)), of, cap, -1e-6)
    ]
    if found is None:
        assert not grid
        return
    assert inside(found, of, cap)
    assert all(math.dist(wish, found) <= math.dist(wish, point) + 1e-6 for point in grid)


@given(st.tuples(numbers, numbers), planes, caps)
def test_a_wish_that_is_allowed_is_kept_to_the_last_bit(
    wish: tuple[float, float], of: list[Plane], cap: float
) -> None:
    """Passive where nothing is violated."""
    if inside(wish, of, cap, 0.0):
        assert nearest(wish, of, cap) == wish


@given(st.tuples(numbers, numbers), planes, planes, caps)
def test_slack_is_the_least(
    wish: tuple[float, float], hard: list[Plane], soft: list[Plane], cap: float
) -> None:
    """The hard planes give way by the least common slack: a linear program's, with the disc as a
    64-gon."""
    found, slack = relaxed(wish, hard, soft, cap)
    assert inside(found, [(nx, ny, b - slack) for nx, ny, b in hard], cap)
    if slack == 0.0:
        return
    turns = [2 * math.pi * k / 64 for k in range(64)]
    rows = [[-nx, -ny, -1.0] for nx, ny, _ in hard] + [
        [math.cos(a), math.sin(a), 0.0] for a in turns
    ]
    ends = [-b for _, _, b in hard] + [cap] * 64
    from scipy.optimize import linprog  # here, because it takes 0.4 s

    least = linprog([0, 0, 1], A_ub=rows, b_ub=ends, bounds=[(None, None), (None, None), (0, None)])
    assert slack == pytest.approx(least.fun, abs=5e-3)


standing = st.lists(
    st.builds(lambda a, b: (math.cos(a), math.sin(a), b), angles, st.floats(-1.2, 0.0)),
    min_size=1,
    max_size=5,
)


@given(st.tuples(numbers, numbers), standing, planes, planes, caps)
def test_no_wall_that_holds_gives_way(
    wish: Vector, walls: list[Plane], hard: list[Plane], soft: list[Plane], cap: float
) -> None:
    """A vehicle that stands satisfies each wall that holds. So whatever pairs and links ask for,
    they give way, and the walls have no slack."""
    asked = [Row(*wall, WALL, 0, 0) for wall in walls] + rows(hard, soft)
    v, slacks = program.relaxed(complex(*wish), asked, len(asked), cap)
    assert slacks[WALL] == 0.0
    assert inside((v.real, v.imag), walls, cap)
    between = [(nx, ny, b - slacks[PAIR]) for nx, ny, b in hard]
    assert inside((v.real, v.imag), between, cap, 1e-4)


@given(st.tuples(numbers, numbers), planes, planes, planes, caps)
def test_no_pair_gives_way_to_what_leads_out_of_a_zone(
    wish: Vector, hard: list[Plane], out: list[Plane], soft: list[Plane], cap: float
) -> None:
    """Pairs have no more slack than alone, and what leads out no more than without links."""
    leaves = [Row(*plane, LEAVE, 0, 0) for plane in out]
    both = rows(hard, []) + leaves
    asked = both + rows([], soft)
    _, alone = program.relaxed(complex(*wish), rows(hard, []), len(hard), cap)
    _, without = program.relaxed(complex(*wish), both, len(both), cap)
    _, slacks = program.relaxed(complex(*wish), asked, len(asked), cap)
    assert slacks[PAIR] == pytest.approx(alone[PAIR], abs=1e-3)
    assert slacks[LEAVE] == pytest.approx(without[LEAVE], abs=1e-3)
