"""One behind the other: where the way has opened, an agent is out of the file for good."""

from __future__ import annotations

import cmath
import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from swarm_ctl.core.kernel.queue import OUT, STAYS, along_way, next_on, point_on

WAY = [0j, 50 + 0j, 100 + 0j]
ENDS = [0.0, 50.0, 100.0]
HOME = 80 + 8j


def test_an_agent_whose_place_lies_behind_the_opening_is_out_for_good() -> None:
    """Else it went back into the file there, and those behind it waited for it for ever."""
    at = along_way(WAY, ENDS, 85.0, 90 + 0j, 90.0, HOME)
    assert at == OUT
    assert along_way(WAY, ENDS, at, 84 + 6j, 90.0, HOME) == OUT
    assert next_on(80.0, at, 100.0, 8.0) == 86.0
    assert next_on(at, 70.0, 100.0, 8.0) == OUT


def test_one_that_is_heard_in_its_place_alone_is_followed_by_nobody() -> None:
    """Its place lies before the opening, and its words from there were lost."""
    assert along_way(WAY, ENDS, 72.0, HOME + 0.9, 90.0, HOME) == OUT
    assert along_way(WAY, ENDS, 72.0, HOME + 1.1, 90.0, HOME) < 90.0


def test_in_the_file_each_stays_behind_the_one_before_it() -> None:
    assert along_way(WAY, ENDS, 18.0, 20 + 3j, 90.0, HOME) == 20.0
    assert next_on(20.0, 30.0, 100.0, 8.0) == 22.0
    assert next_on(20.0, 28.2, 100.0, 8.0) == STAYS
    assert next_on(20.0, 28.3, 100.0, 8.0) == pytest.approx(20.3)
    assert next_on(20.0, OUT, 100.0, 8.0) == 26.0


BENT = [10 + 5j, 10 + 25j, 10 + 25j, 40 + 25j, 40 - 5j]
BENDS = [0.0, 20.0, 20.0, 50.0, 80.0]
"""With a corner twice, as where a leg is over at once."""


@given(st.floats(0.0, 80.0))
def test_a_point_on_the_way_is_so_far_along_it(along: float) -> None:
    """Each of its legs, each of its corners; and it is found there again, from where it was."""
    at = point_on(BENT, BENDS, along)
    k = next(k for k in range(4) if along <= BENDS[k + 1] > BENDS[k])
    leg = BENT[k + 1] - BENT[k]
    assert cmath.isclose(at, BENT[k] + leg / abs(leg) * (along - BENDS[k]), abs_tol=1e-9)
    for was in (along - 7.9, along, along + 7.9):
        if was < 80.0:
            assert along_way(BENT, BENDS, was, at, 99.0, 999j) == pytest.approx(along, abs=1e-6)


def test_behind_its_end_is_its_end() -> None:
    assert point_on(BENT, BENDS, 99.0) == BENT[-1]
    assert point_on(BENT, BENDS, -1.0) == BENT[0] - 1j


@given(st.complex_numbers(max_magnitude=60.0), st.floats(0.0, 80.0))
@example(45 + 25j, 49.0)
def test_a_vehicle_is_where_the_way_is_nearest_near_where_it_was(at: complex, was: float) -> None:
    """At most 8 m back, 15 m on; of two places that are as near the first."""
    window = [was - 8.0 + 0.01 * k for k in range(2301)]
    places = [place for place in window if 0.0 <= place <= 80.0]
    least = min(abs(at - point_on(BENT, BENDS, place)) for place in places)
    found = along_way(BENT, BENDS, was, at, 99.0, 999j)
    assert was - 8.001 <= found <= was + 15.001
    assert abs(at - point_on(BENT, BENDS, found)) == pytest.approx(least, abs=0.02)


def test_of_two_places_that_are_as_near_it_is_in_the_first() -> None:
    there_and_back, ends = [0j, 5 + 0j, 0j], [0.0, 5.0, 10.0]
    assert along_way(there_and_back, ends, 4.0, 2 + 3j, 99.0, 999j) == 2.0


@pytest.mark.parametrize(
    ("was", "at", "along"),
    [(89.7, 85 + 0j, OUT), (89.6, 85 + 0j, 85.0), (85.0, 89.7 + 0j, OUT), (85.0, 89.6 + 0j, 89.6)],
)
def test_a_hand_before_the_opening_it_is_out(was: float, at: complex, along: float) -> None:
    """0.3 m: less is not waited for."""
    assert along_way(WAY, ENDS, was, at, 90.0, HOME) == pytest.approx(along)
    assert math.isinf(along_way(WAY, ENDS, 70.0, HOME + 0.99, 90.0, HOME))
