"""Neighbour graphs: the paper's start, and what must hold for every graph."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.law import graph
from swarm_ctl.core.model.plan import Point

TABLE_II: dict[int, Point] = {
    1: (14, 16),
    2: (12, 12),
    3: (10, 18),
    4: (6, 12),
    5: (6, 16),
    6: (14, 10),
}

coordinate = st.integers(-8, 8).map(float)
many_starts = st.dictionaries(st.integers(1, 65535), st.tuples(coordinate, coordinate), max_size=12)


def path(count: int) -> dict[int, tuple[int, ...]]:
    return {i: tuple(j for j in (i - 1, i + 1) if 1 <= j <= count) for i in range(1, count + 1)}


def test_table_ii_is_the_path_6_2_1_3_5_4() -> None:
    near = graph.neighbours(TABLE_II, 4.5)
    assert near == {1: (2, 3), 2: (1, 6), 3: (1, 5), 4: (5,), 5: (3, 4), 6: (2,)}
    assert graph.edges(near) == ((1, 2), (1, 3), (2, 6), (3, 5), (4, 5))
    assert len(graph.components(near)) == 1


def test_table_ii_falls_apart_at_a_shorter_range() -> None:
    assert graph.components(graph.neighbours(TABLE_II, 4.2)) == ((1,), (2, 6), (3,), (4, 5))


def test_the_range_itself_is_within_range() -> None:
    assert graph.neighbours({1: (0, 0), 2: (3, 4)}, 5.0) == {1: (2,), 2: (1,)}


@given(many_starts, st.floats(0.5, 10))
def test_neighbours_are_mutual_and_the_components_a_partition(
    starts: dict[int, Point], r: float
) -> None:
    near = graph.neighbours(starts, r)
    assert all(i in near[j] and i != j for i in near for j in near[i])
    parts = graph.components(near)
    assert sorted(i for part in parts for i in part) == sorted(starts)
    where = {i: k for k, part in enumerate(parts) for i in part}
    assert all(where[i] == where[j] for i in near for j in near[i])
    assert all(
        math.dist(starts[i], starts[j]) > r for i in starts for j in starts if where[i] != where[j]
    )


@given(many_starts.filter(lambda starts: len(starts) > 1), st.floats(0.5, 10))
def test_connectivity_is_positive_exactly_where_the_graph_is_connected(
    starts: dict[int, Point], r: float
) -> None:
    near = graph.neighbours(starts, r)
    assert (graph.algebraic_connectivity(near) > 0) == (len(graph.components(near)) == 1)
    assert (graph.consensus_rate(near) > 0) == (len(graph.components(near)) == 1)


@given(many_starts, st.floats(0.5, 10), st.sets(st.integers(0, 11)))
def test_losing_agents_is_never_having_had_them(
    starts: dict[int, Point], r: float, picked: set[int]
) -> None:
    lost = {agent for k, agent in enumerate(sorted(starts)) if k in picked}
    left = {i: p for i, p in starts.items() if i not in lost}
    assert graph.without(graph.neighbours(starts, r), lost) == graph.neighbours(left, r)


@pytest.mark.parametrize("count", [2, 3, 6, 10])
def test_known_spectra(count: int) -> None:
    """Path: 2 - 2 cos(pi / n), and 1 - cos(pi / (n - 1)) normalised; complete: n, and n / (n -
    1)."""
    complete = {i: tuple(j for j in range(count) if j != i) for i in range(count)}
    assert graph.algebraic_connectivity(path(count)) == pytest.approx(
        2 - 2 * math.cos(math.pi / count)
    )
    assert graph.consensus_rate(path(count)) == pytest.approx(1 - math.cos(math.pi / (count - 1)))
    assert graph.algebraic_connectivity(complete) == pytest.approx(count)
    assert graph.consensus_rate(complete) == pytest.approx(count / (count - 1))


def test_one_agent_and_none() -> None:
    assert graph.components({}) == ()
    assert graph.components({7: ()}) == ((7,),)
    assert graph.algebraic_connectivity({7: ()}) == graph.consensus_rate({7: ()}) == 0.0
