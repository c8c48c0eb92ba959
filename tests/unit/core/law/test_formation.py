"""Formation measures: invariances, and agreement with plain loops."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swarm_ctl.core.law import formation
from swarm_ctl.core.model.arrays import Floats

count = st.shared(st.integers(2, 9), key="n")
points = count.flatmap(lambda n: arrays(np.float64, (n, 2), elements=st.floats(-1000, 1000)))
shift = st.tuples(st.floats(-1000, 1000), st.floats(-1000, 1000))


@given(points, shift)
def test_a_shape_stands_wherever_it_stands(slots: Floats, by: tuple[float, float]) -> None:
    assert formation.formation_error(slots + np.array(by), slots) == pytest.approx(0, abs=1e-9)


@given(points, points, shift, shift)
def test_moving_points_or_slots_together_changes_nothing(
    p: Floats, z: Floats, by: tuple[float, float], slots_by: tuple[float, float]
) -> None:
    moved = formation.formation_error(p + np.array(by), z + np.array(slots_by))
    assert moved == pytest.approx(formation.formation_error(p, z), abs=1e-8)


@given(points, points)
def test_formation_error_is_the_largest_deviation(p: Floats, z: Floats) -> None:
    e = [(a[0] - b[0], a[1] - b[1]) for a, b in zip(p.tolist(), z.tolist(), strict=True)]
    mean = (sum(x for x, _ in e) / len(e), sum(y for _, y in e) / len(e))
    assert formation.formation_error(p, z) == pytest.approx(
        max(math.dist(x, mean) for x in e), abs=1e-9
    )


@given(points, points)
def test_one_formation_is_measured_alike_without_arrays(p: Floats, z: Floats) -> None:
    plain = formation.error_of_one(*([complex(*at) for at in each.tolist()] for each in (p, z)))
    assert plain == float(formation.formation_error(p, z))  # to the last bit


@given(points)
def test_closest_pair_is_the_closest(p: Floats) -> None:
    found = formation.closest_pair(p)
    assert found is not None
    apart, (i, j) = found
    assert i < j
    assert apart == pytest.approx(math.dist(p[i], p[j]))
    assert apart == pytest.approx(
        min(math.dist(a, b) for a, b in itertools.combinations(p.tolist(), 2))
    )
    assert formation.smallest_distance(p) == apart


def test_batches_are_measured_one_by_one() -> None:
    batch = np.random.default_rng(1).normal(size=(4, 3, 5, 2))
    slots = np.random.default_rng(2).normal(size=(5, 2))
    errors, between = formation.formation_error(batch, slots), formation.distances(batch)
    assert errors.shape == (4, 3)
    assert between.shape == (4, 3, 5, 5)
    assert errors[2, 1] == pytest.approx(formation.formation_error(batch[2, 1], slots))
    assert between[2, 1] == pytest.approx(formation.distances(batch[2, 1]))


def test_one_point_has_no_pair() -> None:
    assert formation.closest_pair([[1.0, 2.0]]) is None
    assert formation.smallest_distance([[1.0, 2.0]]) == math.inf
