"""Apart by height, for all words; and the reach of wakes."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.kernel.heights import (
    NO_SPAN,
    apart_by_height,
    in_wake,
    is_ahead,
    may_pass,
    needed_m,
    span,
    wake_mps,
    wake_reach_m,
)

HEIGHTS = st.floats(-50.0, 150.0)
DOUBTS = st.floats(0.0, 5.0)
LAYERS = st.floats(0.5, 20.0)
AGES = st.floats(0.0, 3.0)
RATES = st.floats(0.2, 8.0)


@given(HEIGHTS, HEIGHTS, HEIGHTS, HEIGHTS, DOUBTS, DOUBTS, LAYERS, RATES, AGES, st.data())
def test_two_that_are_apart_by_height_are_a_layer_apart_wherever_they_are(
    a: float,
    to_a: float,
    b: float,
    to_b: float,
    doubt_a: float,
    doubt_b: float,
    layer_m: float,
    closing_mps: float,
    age_s: float,
    data: st.DataObject,
) -> None:
    """Wherever each is on its way, off by all that is doubted, and nearer by all that both may have
    climbed since: they still are a layer apart."""
    one, other = span(a, to_a, doubt_a), span(b, to_b, doubt_b)
    if not apart_by_height(one, other, layer_m, closing_mps, age_s):
        return
    at_a = data.draw(st.floats(one.low_m, one.high_m)) + data.draw(st.floats(-doubt_a, doubt_a))
    at_b = data.draw(st.floats(other.low_m, other.high_m))
    at_b += data.draw(st.floats(-doubt_b, doubt_b))
    assert abs(at_a - at_b) - closing_mps * age_s > layer_m - 1e-9


@given(HEIGHTS, HEIGHTS, HEIGHTS, HEIGHTS, DOUBTS, LAYERS, AGES)
def test_both_say_the_same_and_more_doubt_or_age_makes_no_pair_apart(
    a: float, to_a: float, b: float, to_b: float, doubt: float, layer_m: float, age_s: float
) -> None:
    one, other = span(a, to_a, doubt), span(b, to_b, 0.5)
    apart = apart_by_height(one, other, layer_m, 2.0, age_s)
    assert apart == apart_by_height(other, one, layer_m, 2.0, age_s)
    worse = span(a, to_a, doubt + 1.0)
    assert not apart_by_height(worse, other, layer_m, 2.0, age_s) or apart
    assert not apart_by_height(one, other, layer_m, 2.0, age_s + 1.0) or apart
    assert not apart_by_height(one, NO_SPAN, layer_m, 2.0, age_s)


@pytest.mark.parametrize("place", range(3))
def test_a_number_that_is_none_makes_no_pair_apart(place: int) -> None:
    numbers = [20.0, 20.0, 0.5]
    assert apart_by_height(span(*numbers), span(0.0, 0.0, 0.5), 4.0, 2.0, 0.1)
    numbers[place] = math.nan
    assert not apart_by_height(span(*numbers), span(0.0, 0.0, 0.5), 4.0, 2.0, 0.1)
    assert not apart_by_height(span(20.0, 20.0, 0.5), span(0.0, 0.0, 0.5), 4.0, 2.0, math.inf)


def test_words_from_the_future_give_no_room() -> None:
    """A clock that is not known well may date a word after now."""
    one, other = span(20.0, 20.0, 0.5), span(0.0, 0.0, 0.5)
    assert needed_m(one, other, 4.0, 2.0, -3.0) == 5.0


def test_one_passes_at_the_keep_out_distance_and_not_much_under_it() -> None:
    assert may_pass(0.0, 4.25, 2.5)
    assert may_pass(-0.17, 4.25, 2.5)
    assert not may_pass(-0.18, 4.25, 2.5)
    assert not may_pass(math.nan, 4.25, 2.5)


@pytest.mark.parametrize(
    ("mass_kg", "rotor_distance_m", "reach_m", "speed_mps"),
    [(0.25, 0.16, 2.2, 4.4), (1.5, 0.32, 4.3, 5.4), (5.0, 0.5, 6.8, 6.3)],
)
def test_the_reach_of_a_wake(
    mass_kg: float, rotor_distance_m: float, reach_m: float, speed_mps: float
) -> None:
    """The page on safety has these figures. At the reach, the wake is as fast as the air in the
    rotors of an equal vehicle, whatever its mass."""
    found = wake_reach_m(rotor_distance_m)
    assert found == pytest.approx(reach_m, abs=0.05)
    assert wake_mps(mass_kg, found) == pytest.approx(speed_mps, abs=0.05)
    area = 4 * math.pi * (0.4 * rotor_distance_m) ** 2
    induced = math.sqrt(mass_kg * 9.81 / (2 * 1.225 * area))
    assert wake_mps(mass_kg, found) == pytest.approx(induced)


def test_a_wake_is_a_cone_below_and_nowhere_else() -> None:
    assert in_wake(1.0, 5.0, 0.32)
    assert not in_wake(1.4, 5.0, 0.32)
    assert not in_wake(0.0, -5.0, 0.32)
    assert in_wake(0.0, 0.5, 0.32)
    assert not in_wake(0.0, 0.0, 0.32)


@pytest.mark.parametrize(
    ("climbs_m", "other_m", "ahead"),
    [
        (5.0, 20.2, False),
        (5.0, 20.4, True),
        (5.0, 26.9, True),
        (5.0, 27.1, False),
        (5.0, 17.0, False),
        (-5.0, 17.0, True),
        (-5.0, 12.9, False),
        (-5.0, 23.0, False),
        (-0.5, 18.0, True),
        (0.0, 21.0, False),
    ],
)
def test_what_is_ahead_in_height(climbs_m: float, other_m: float, ahead: bool) -> None:
    """On the way up or down, and 2 m beyond; one that is hardly higher is passed already."""
    assert is_ahead(20.0, climbs_m, other_m, 2.0) is ahead
