"""No wish passes above the speed limit, whatever goes in."""

from __future__ import annotations

import cmath
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.kernel.wish import NO_RELEASE, Release, bent, limited, noted, swirled, turned

SPEED = 5.0
ANY = st.floats(allow_nan=True, allow_infinity=True)
SOME = st.floats(-100, 100)


@given(ANY, ANY)
def test_speed_never_above_the_limit(north: float, east: float) -> None:
    """Infinities and NaN included; those become zero."""
    out = limited(complex(north, east), SPEED)
    assert abs(out) <= SPEED * (1 + 1e-12)
    if not math.isfinite(math.hypot(north, east)):
        assert out == 0


@given(SOME, SOME)
def test_direction_is_kept(north: float, east: float) -> None:
    """A wish is scaled, not turned."""
    out = limited(complex(north, east), SPEED)
    assert out.real * east == pytest.approx(out.imag * north, abs=1e-6)
    assert out.real * north >= 0


def test_slow_velocities_pass_unchanged() -> None:
    """To the last bit."""
    assert limited(3.0 - 1.0j, SPEED) == 3.0 - 1.0j
    assert limited(30.0 - 40.0j, SPEED) == pytest.approx(3.0 - 4.0j)


@given(SOME, SOME, SOME, SOME, st.floats(0, 5))
def test_a_bent_wish_does_not_close_in_faster(
    north: float, east: float, away_north: float, away_east: float, closing: float
) -> None:
    """Towards the other aircraft at most `closing`."""
    wish, away = complex(north, east), complex(away_north, away_east)
    if abs(away) < 1e-3:
        return
    out = bent(wish, away, closing)
    assert -(out * away.conjugate()).real / abs(away) <= closing + 1e-6


@pytest.mark.parametrize(
    ("wish", "away", "turns", "flown"),
    [
        (-3 + 0j, 2 + 0j, -1j, -1 - 2j),  # what is not flown towards it goes past it
        (-3 + 0j, 2 + 0j, 1j, -1 + 2j),
        (-3 + 4j, 2 + 0j, -1j, -1 + 2j),
        (-1 + 4j, 2 + 0j, -1j, -1 + 4j),
        (3 + 0j, 2 + 0j, -1j, 3 + 0j),
        (-3 + 0j, 1e-10 + 0j, -1j, -3 + 0j),  # on one spot there is no side
    ],
)
def test_a_bent_wish_goes_past(
    wish: complex, away: complex, turns: complex, flown: complex
) -> None:
    assert bent(wish, away, 1.0, turns) == pytest.approx(flown)


@pytest.mark.parametrize(
    ("consensus", "turn"),
    [(3.0, 0.5), (cmath.rect(3.0, math.pi / 3), 0.125), (3j, 0.0), (-3.0, 0.0)],
)
def test_avoidance_swirls_where_it_points_against_consensus(
    consensus: complex, turn: float
) -> None:
    """To its left, by 27 degrees at most."""
    assert swirled(consensus, -2 + 0j) == pytest.approx(-2 * complex(1.0, -turn))
    assert swirled(0j, -2 + 0j) == -2


SPEED_MPS, TICK_S = 5.0, 0.05


def after(ticks: int, got: float, wanted: complex = 5 + 0j) -> Release:
    """An agent that wants so much for so many ticks and gets this share of it."""
    made = NO_RELEASE
    for _ in range(ticks):
        made = noted(made, wanted, wanted * got, SPEED_MPS, TICK_S)
    return made


@pytest.mark.parametrize(
    ("release", "stuck"),
    [
        (after(1, 0.0), False),  # it has not wanted much for long
        (after(2, 0.0), True),
        (after(60, 0.14), True),
        (after(60, 0.16), False),
        (after(60, 0.0, 0.2 + 0j), False),
        (after(60, -1.0), True),
        (after(60, 0.0)._replace(left_s=0.01), False),
    ],
)
def test_who_wants_to_move_and_does_not_goes_sideways(release: Release, stuck: bool) -> None:
    wish, then = turned(release, 1 + 1j, 5 + 0j, 1, SPEED_MPS, TICK_S)
    assert then.fails == int(stuck)
    if stuck:
        assert wish == pytest.approx(cmath.rect(2.5, -math.pi / 3))
        assert (then.wanted, then.got) == (0.0, 0.0)
        assert 1.0 <= then.left_s <= 1.9
    elif release.left_s <= 0.0:
        assert (wish, then) == (1 + 1j, release)


def test_an_average_is_of_a_second_and_a_half() -> None:
    """Of what it wants, at most its top speed, and of what it gets that way."""
    share = TICK_S / 1.5
    made = noted(NO_RELEASE, 10j, 3 + 1j, SPEED_MPS, TICK_S)
    assert (made.wanted, made.got) == pytest.approx((5.0 * share, share))
    assert noted(made, 10j, 1j, SPEED_MPS, TICK_S).got == pytest.approx(share + share * (1 - share))
    assert noted(made, 0j, 9j, SPEED_MPS, TICK_S) == made
    sideways = made._replace(left_s=0.5)
    assert noted(sideways, 10j, 3 + 1j, SPEED_MPS, TICK_S) == sideways


@pytest.mark.parametrize(("wants", "flies"), [(0.1, 1.0), (2.0, 2.0), (9.0, 2.5)])
def test_how_fast_it_goes_sideways_until_its_time_is_over(wants: float, flies: float) -> None:
    """As fast as it wants, between a fifth and half of the top speed."""
    release = NO_RELEASE._replace(left_s=0.1, side=1j)
    wish, release = turned(release, 7j, complex(wants), 1, SPEED_MPS, TICK_S)
    assert wish == pytest.approx(flies * 1j)
    assert release.left_s == pytest.approx(0.05)
    assert turned(release, 7j, 0j, 1, SPEED_MPS, TICK_S)[0] == 7j
    assert turned(release._replace(left_s=0.0), 7j, 1j, 1, SPEED_MPS, TICK_S)[0] == 7j


@pytest.mark.parametrize(
    ("fails", "mean_s", "others"), [(0, 1.5, 0.0), (2, 3.5, 0.0), (3, 4.5, 0.4), (9, 6.5, 0.4)]
)
def test_each_release_is_longer_and_some_go_to_the_other_side(
    fails: int, mean_s: float, others: float
) -> None:
    """By dice of each agent's own: two that block each other do not move alike."""
    stuck = after(60, 0.0)._replace(fails=fails)
    made = [turned(stuck, 0j, 5 + 0j, agent, SPEED_MPS, TICK_S)[1] for agent in range(1, 251)]
    times_s = [each.left_s + TICK_S for each in made]
    assert 0.7 * mean_s <= min(times_s) <= 0.75 * mean_s
    assert 1.25 * mean_s <= max(times_s) <= 1.3 * mean_s
    assert len(set(times_s)) == len(made)
    assert sum(times_s) / len(made) == pytest.approx(mean_s, rel=0.05)
    share = sum(each.side.imag > 0 for each in made) / len(made)
    assert share == pytest.approx(others, abs=0.06)
    assert {each.fails for each in made} == {fails + 1}
