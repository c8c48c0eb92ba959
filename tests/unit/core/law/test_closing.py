"""A shape that closes: everyone gets a place of its own, by a short way, and all find the same."""

from __future__ import annotations

import itertools
import math

from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.law.formation import dealt
from swarm_ctl.core.model.geometry import Point, centred

POINTS = st.lists(
    st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=1, max_size=6, unique=True
)


def cost(slots: list[Point], places: list[Point], found: list[int]) -> float:
    at, ends = centred(slots), centred(places)
    return sum(math.dist(at[k], ends[place]) ** 2 for k, place in enumerate(found))


@given(POINTS, st.data())
def test_each_has_a_place_of_its_own_and_no_two_would_gain_by_exchange(
    slots: list[Point], data: st.DataObject
) -> None:
    places = data.draw(st.lists(st.sampled_from(slots), min_size=len(slots), max_size=len(slots)))
    places = [(n + 0.1 * k, e) for k, (n, e) in enumerate(places)]
    found = dealt(slots, places)
    assert sorted(found) == list(range(len(slots)))
    for a, b in itertools.combinations(range(len(slots)), 2):
        other = list(found)
        other[a], other[b] = other[b], other[a]
        assert cost(slots, places, found) <= cost(slots, places, other) + 1e-5


def test_a_line_closes_up_without_a_crossing() -> None:
    """The one in the middle leaves: those beside it move in, in their order."""
    left = [(0.0, 0.0), (0.0, 9.0), (0.0, 27.0), (0.0, 36.0)]
    assert dealt(left, [(0.0, 9.0 * k) for k in range(4)]) == [0, 1, 2, 3]
