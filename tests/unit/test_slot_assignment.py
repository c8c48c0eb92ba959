"""Slot choice: least total squared distance, whatever the frame."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swarm_ctl.core.law.formation import centred
from swarm_ctl.core.model.arrays import Floats
from swarm_ctl.slot_assignment import _assigned, nearest

count = st.shared(st.integers(1, 6), key="n")
points = count.flatmap(lambda n: arrays(np.float64, (n, 2), elements=st.floats(-100, 100)))
shift = st.tuples(st.floats(-1000, 1000), st.floats(-1000, 1000))


def cost(p: Floats, z: Floats) -> float:
    return float(np.sum((centred(p) - centred(z)) ** 2))


@given(points, points)
def test_no_other_choice_costs_less(p: Floats, slots: Floats) -> None:
    chosen = nearest(p, slots)
    assert sorted(map(tuple, chosen.tolist())) == sorted(map(tuple, slots.tolist())), (
        "every slot taken once"
    )
    least = min(cost(p, slots[list(order)]) for order in itertools.permutations(range(len(slots))))
    assert cost(p, chosen) == pytest.approx(least, rel=1e-9, abs=1e-6)


@given(points, points, shift, shift)
def test_where_shape_and_swarm_are_does_not_matter(
    p: Floats, slots: Floats, by: tuple[float, float], slots_by: tuple[float, float]
) -> None:
    moved = nearest(p + np.array(by), slots + np.array(slots_by)) - np.array(slots_by)
    assert cost(p, moved) == pytest.approx(cost(p, nearest(p, slots)), rel=1e-6, abs=1e-4)


@given(points, shift, st.randoms(use_true_random=False))
def test_agents_that_stand_in_the_shape_stay(
    slots: Floats, by: tuple[float, float], random: object
) -> None:
    order = list(range(len(slots)))
    random.shuffle(order)  # type: ignore[attr-defined]
    assert nearest(slots[order] + np.array(by), slots) == pytest.approx(slots[order], abs=1e-3)


square = st.integers(1, 12).flatmap(
    lambda n: arrays(np.float64, (n, n), elements=st.integers(0, 3) | st.floats(0, 9))
)


@given(square)
def test_between_equal_sums_the_choice_is_scipys(costs: Floats) -> None:
    """With which the slots of plans were dealt before: their hashes stay."""
    from scipy.optimize import linear_sum_assignment  # here, because it takes 0.4 s

    least = costs.argmin(axis=1).tolist()
    if len(set(least)) < len(least):
        assert _assigned(costs) == linear_sum_assignment(costs)[1].tolist()
