"""The filter's half-planes, and what is proven of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from swarm_ctl.core.kernel import constraints
from swarm_ctl.core.kernel.constraints import Margins, Other, cap, flies_with, margins_of, minded
from swarm_ctl.core.kernel.program import PAIR, Row, relaxed
from swarm_ctl.core.kernel.wish import swirled
from swarm_ctl.core.model.plan import LawParameters, Response

LAW = LawParameters()
MARGINS = margins_of(LAW, Response(), 5.0, 5.0, 5.0)


def proven_m(apart_m: float, speed_mps: float) -> float:
    """How near two come that circle this far apart (docs/understand/safety-evidence.md#proven, 2):
    D F(W tau / D), with a lag a fifth over the model's."""
    response = Response()
    tau_s = 1.2 * response.lag_s + 0.3 * speed_mps / response.acceleration_mps2
    m = 2 * speed_mps * tau_s / apart_m
    u = np.linspace(0.0, 40.0, 400_001)
    f = np.where(m * u < np.pi / 2, np.cos(np.minimum(m * u, np.pi)), np.pi / 2 - m * u)
    return apart_m * float(np.sum(np.exp(-u) * f) * (u[1] - u[0]))


def test_the_proven_bound_lies_over_r_in() -> None:
    """Of two that are as slow as at D."""
    in_metres = margins_of(LAW, Response(), 5.0, 5.0)
    near_m = proven_m(in_metres.keep_out, in_metres.slow)
    assert near_m == pytest.approx(1.15 * LAW.r_in * 5.0, rel=1e-3)


@pytest.mark.parametrize(("unit_m", "speed_mps"), [(1.5, 3.0), (3.0, 6.0)])
def test_caution_is_as_wide_as_the_top_speed_asks(unit_m: float, speed_mps: float) -> None:
    """Where it begins, the bound holds for two that pass at a 1.6th of the top speed; nearer by a
    tenth of its width, it does not."""
    margins = margins_of(LAW, Response(), speed_mps, unit_m)
    begins_m, least_m = margins.keep_out + margins.zone, 1.15 * LAW.r_in * unit_m
    assert proven_m(begins_m, speed_mps / 1.6) >= least_m * (1 - 1e-3)
    assert proven_m(begins_m - 0.1 * margins.zone, speed_mps / 1.6) < least_m


def heard(setpoint: complex = 0j, age_s: float = 0.0, *, yields: bool = True) -> Other:
    """Another aircraft whose news is fresh."""
    return Other(2, True, 0j, setpoint, age_s, age_s, yields, 0.0, True)


def unsure(doubt_s: float, response_s: float, other: Other) -> float:
    return constraints.unsure(doubt_s, response_s, other)


def keep_out_plane(
    apart: complex, lower: bool, other: Other, margins: Margins
) -> tuple[complex, float, float]:
    return constraints.keep_out(other._replace(apart=apart, lower=lower), margins)


def test_margins_are_the_same_in_any_unit() -> None:
    in_units, in_metres = MARGINS, margins_of(LAW, Response(), 5.0, 5.0)
    for name in Margins._fields:
        assert getattr(in_metres, name) == pytest.approx(5.0 * getattr(in_units, name))


def test_doubt_of_the_own_response_slows_near_others_and_only_there() -> None:
    """Two that are off by all that they doubt keep 1.1 r_in: each half of what D spares."""
    for unsure_s in (0.1, 0.5, 1.0):
        slow = cap(0.0, unsure_s, MARGINS)
        assert MARGINS.keep_out - 2 * 2 * unsure_s * slow / 2 >= 1.1 * LAW.r_in - 1e-9
    assert cap(MARGINS.reach, 0.5, MARGINS) == MARGINS.speed


def test_a_difference_of_two_responses_makes_both_unsure() -> None:
    """Whichever of the two answers later; an aircraft that tells no response adds nothing."""
    alike, none = heard()._replace(response_s=0.9), heard()._replace(response_s=0.0)
    late, quick = heard()._replace(response_s=1.5), heard()._replace(response_s=0.3)
    assert unsure(0.1, 0.9, late) == pytest.approx(0.7)
    assert unsure(0.1, 0.9, quick) == pytest.approx(0.7)
    assert unsure(0.1, 0.9, alike) == unsure(0.1, 0.9, none) == pytest.approx(0.1)


@settings(deadline=None)
@given(
    st.floats(2.0, 12.0),
    st.floats(0.1, 1.0),
    st.floats(2.0, 8.0),
    st.floats(0.0, 3.0),
    st.booleans(),
)
def test_what_is_not_minded_neither_forbids_nor_slows(
    speed_mps: float, lag_s: float, most_mps2: float, unsure_s: float, yields: bool
) -> None:
    """A study leaves such pairs out. Half-planes that the speed limit alone ensures change no
    velocity, whatever its wish."""
    response = Response(lag_s=lag_s, acceleration_mps2=most_mps2)
    margins = margins_of(LAW, response, speed_mps, 5.0, 5.0)
    far = minded(unsure_s, margins) + 1e-6
    _, bound, room = keep_out_plane(
        complex(margins.keep_out + far), True, heard(yields=yields), margins
    )
    assert room == pytest.approx(far)
    assert bound < -margins.speed
    assert cap(far, unsure_s, margins) == pytest.approx(margins.speed, rel=1e-12)


def test_speed_near_others_follows_what_the_vehicle_can_stop_and_turn() -> None:
    """A vehicle that accelerates less is slower at D, and gets its speed back farther out."""
    weak, strong = (
        margins_of(LAW, Response(acceleration_mps2=a), 12.0, 5.0, 5.0) for a in (2.0, 8.0)
    )
    assert weak.slow < strong.slow
    assert weak.reach > strong.reach
    assert cap(0.5, 0.0, weak) < cap(0.5, 0.0, strong) <= 12.0 / 5.0


points = st.tuples(st.floats(-2, 2), st.floats(-2, 2))


@settings(max_examples=60)
@given(st.lists(points, min_size=2, max_size=6), st.lists(points, min_size=6, max_size=6))
def test_integrators_that_start_apart_stay_apart_whatever_they_wish(
    starts: list[tuple[float, float]], wishes: list[tuple[float, float]]
) -> None:
    """|s_ij| >= D is invariant with fresh news, each doing its half, for any constant wishes (claim
    1)."""
    s = [complex(*start) for start in starts]
    assume(all(abs(a - b) >= MARGINS.keep_out for i, a in enumerate(s) for b in s[:i]))
    for _ in range(60):
        planes: list[list[Row]] = [[] for _ in s]
        rooms = [math.inf for _ in s]
        for i, a in enumerate(s):
            for j, b in enumerate(s):
                if i != j:
                    n, bound, room = keep_out_plane(a - b, i < j, heard(), MARGINS)
                    planes[i].append(Row(n.real, n.imag, bound, PAIR, 0, 0))
                    rooms[i] = min(rooms[i], room)
        for i, wish in enumerate(wishes[: len(s)]):
            allowed = cap(rooms[i], 0.05, MARGINS)
            flown, slacks = relaxed(complex(*wish), planes[i], len(planes[i]), allowed)
            assert slacks[PAIR] < 1e-6
            s[i] += 0.05 * flown
        assert all(abs(a - b) >= MARGINS.keep_out - 1e-4 for i, a in enumerate(s) for b in s[:i])


@given(points, points, st.floats(0, 1), st.floats(0, 3))
def test_keep_out_counts_from_the_nearest_place_the_other_may_be_at(
    apart: tuple[float, float], setpoint: tuple[float, float], share: float, age_s: float
) -> None:
    """No place on the way that the other may have flown is nearer than the one that counts."""
    own, flies = complex(*apart), complex(*setpoint)
    assume(abs(own) > 1e-6)
    _, _, room = keep_out_plane(own, True, heard(flies, age_s), MARGINS)
    keep_out = MARGINS.keep_out + MARGINS.growth * age_s
    assert room <= abs(own - share * age_s * flies) - keep_out + 1e-9


@pytest.mark.parametrize(
    ("fresh", "rare", "yields", "age_s", "off"),
    [
        (True, False, True, 0.4, 0.4 * 1.0 + 0.4 * MARGINS.growth),
        (True, False, False, 0.4, 0.4 * 1.0 + 3.0 * MARGINS.growth),
        (True, True, False, 1.4, 1.4 * 1.0 + 3.0 * MARGINS.growth),
        (False, False, False, 9.0, 1.0 * 1.0 + 3.0 * MARGINS.growth),
        (False, True, False, 9.0, 2.0 * 1.0 + 3.0 * MARGINS.growth),
    ],
)
def test_what_may_constrain(
    fresh: bool, rare: bool, yields: bool, age_s: float, off: float
) -> None:
    """Fresh news by its age; older news for a second of flight, after a far word for two, and all
    that D may grow by."""
    reach = MARGINS.keep_out + MARGINS.reach + off
    flown_s = constraints.flown_s(age_s, fresh, rare)
    told = (1j, age_s, flown_s, yields, MARGINS.reach, MARGINS)
    assert constraints.constrains(reach - 1e-9, *told)
    assert not constraints.constrains(reach + 1e-9, *told)


@given(points, st.floats(0, 9), st.floats(0, 2), st.booleans(), st.floats(0, 2))
def test_what_may_not_constrain_forbids_nothing(
    setpoint: tuple[float, float], age_s: float, flown_s: float, yields: bool, unsure_s: float
) -> None:
    """Wherever it has flown since it was told of."""
    assume(not yields or age_s <= 0.5)
    flies, reach = complex(*setpoint), minded(unsure_s, MARGINS)
    other = heard(flies, age_s, yields=yields)._replace(flown_s=flown_s)
    grows_s = age_s if yields else 3.0
    far = MARGINS.keep_out + reach + abs(flies) * flown_s + MARGINS.growth * grows_s + 1e-6
    assert not constraints.constrains(far, flies, age_s, flown_s, yields, reach, MARGINS)
    for turn in range(8):
        apart = far * complex(math.cos(0.8 * turn), math.sin(0.8 * turn))
        _, bound, room = keep_out_plane(apart, True, other, MARGINS)
        assert bound <= -MARGINS.speed
        assert cap(room, unsure_s, MARGINS) == pytest.approx(MARGINS.speed)


def test_a_silent_one_is_passed_outside_of_its_keep_out() -> None:
    """By a fifth of caution's width, however long it has been silent."""
    for age_s, grown_s in ((0.0, 0.0), (1.0, 1.0), (60.0, 3.0)):
        _, _, room = keep_out_plane(
            complex(constraints.passed_at(age_s, MARGINS)), True, heard(0j, age_s), MARGINS
        )
        assert room == pytest.approx(0.2 * MARGINS.zone)
        asked = MARGINS.keep_out + grown_s * MARGINS.growth + 0.2 * MARGINS.zone
        assert constraints.passed_at(age_s, MARGINS) == pytest.approx(asked)


@pytest.mark.parametrize(
    ("length", "other_mps", "outwards"),
    [
        (0.88, 0.0, 0.05 * MARGINS.r),  # half of what is left: the other may take the other half
        (0.88, -0.01 * MARGINS.r, 0.05 * MARGINS.r),
        (0.88, 0.07 * MARGINS.r, 0.03 * MARGINS.r),  # it flies out faster than its half
        (1.0, -0.01 * MARGINS.r, -0.01 * MARGINS.r),
        (1.0, -0.05 * MARGINS.r, -0.01 * MARGINS.r),
        (1.0, 0.0, -0.02 * MARGINS.r),  # it does nothing of its half
        (1.19, 9.0, -0.45 * 0.8),  # less than keeping apart may ask for
    ],
)
def test_a_guard_lets_a_link_grow_to_its_range_and_no_farther(
    length: float, other_mps: float, outwards: float
) -> None:
    """What the other end does not do of its half, this one does; at 98 % of r it ends."""
    away = complex(0.6, 0.8)
    margins = MARGINS._replace(speed=0.8)
    normal, bound = constraints.guard(length * margins.r * away, -other_mps * away, margins)
    assert normal == pytest.approx(-away)
    assert -bound == pytest.approx(outwards)


def test_two_on_one_spot_part_along_north() -> None:
    """The lower id northwards."""
    for lower in (True, False):
        normal, bound, _ = keep_out_plane(0j, lower, heard(), MARGINS)
        assert bound > 0
        assert (normal * bound).real == pytest.approx(0.5 if lower else -0.5, abs=1e-2)


# --- the swirl ---


@given(points, points)
def test_the_swirl_only_turns_what_points_against_the_wish(
    to: tuple[float, float], away: tuple[float, float]
) -> None:
    consensus, avoidance = complex(*to), complex(*away)
    assume(abs(consensus) > 1e-3 and abs(avoidance) > 1e-3)
    out = swirled(consensus, avoidance)
    if (consensus * avoidance.conjugate()).real >= 0:
        assert out == pytest.approx(avoidance)
    else:
        assert (out * avoidance.conjugate()).real == pytest.approx(abs(avoidance) ** 2)


@given(st.complex_numbers(max_magnitude=8), st.complex_numbers(min_magnitude=0.1, max_magnitude=8))
def test_one_that_does_not_make_the_formations_way_does_not_fly_with_it(
    setpoint: complex, moving: complex
) -> None:
    """One that stands, or flies across or against it, never does; one that flies its velocity and
    any correction that is smaller than half of it always does."""
    assert not flies_with(0j, moving)
    assert not flies_with(setpoint.imag * moving * 1j - abs(setpoint) * moving, moving)
    correction = setpoint / 8 * 0.49 * abs(moving)
    assert flies_with(moving + correction, moving)
    assert flies_with(setpoint, 0j)
