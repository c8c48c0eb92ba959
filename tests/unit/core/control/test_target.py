"""What is known of a target: carried on, smoothed, and not thrown by words that can't be true."""

from __future__ import annotations

import cmath
import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.control.target import Sighting, Tracker

EVERY_S = 0.2


def word(t: float, at: complex, velocity: complex | None = None, teller: str = "boat") -> Sighting:
    return Sighting(true_s=t, at=at, velocity=velocity, accuracy_m=0.5, height_m=0.0, teller=teller)


def circling(t: float, speed: float, turns: float) -> tuple[complex, complex]:
    """From the origin, to the north at first."""
    velocity = speed * cmath.exp(1j * turns * t)
    if abs(turns) < 1e-6:
        return speed * t + 0j, velocity
    return speed * (cmath.exp(1j * turns * t) - 1) / (1j * turns), velocity


def tracked(speed: float, turns: float, count: int = 12, noise: float = 0.0) -> Tracker:
    dice, tracker = random.Random(1), Tracker("boat")
    for k in range(count):
        at, velocity = circling(k * EVERY_S, speed, turns)
        at += complex(dice.gauss(0, 0.3), dice.gauss(0, 0.3)) * noise
        velocity += complex(dice.gauss(0, 0.2), dice.gauss(0, 0.2)) * noise
        tracker.hear(word(k * EVERY_S, at, velocity))
    return tracker


@given(st.floats(0, 15), st.floats(-0.3, 0.3), st.floats(0, 0.9))
def test_a_target_on_a_circle_is_where_it_is(speed: float, turns: float, later_s: float) -> None:
    """With perfect words, and a turn that shows, to decimetres; carried on by up to a second."""
    tracker = tracked(speed, turns)
    now = 11 * EVERY_S + later_s
    known = tracker.now(now)
    assert known is not None
    at, velocity = circling(now, speed, turns)
    hidden = (
        abs(turns) <= 0.041 or speed < 1.0
    )  # then it counts as flying straight, from the middle
    bent = speed * abs(turns) * (5.5 * EVERY_S + later_s) if hidden else 0.0
    assert abs(known.at - at) < 0.05 + 0.02 * speed + bent * (5.5 * EVERY_S + later_s)
    assert abs(known.velocity - velocity) < 0.05 + 0.05 * speed + bent


def test_words_without_velocity_tell_it_by_their_places() -> None:
    tracker = Tracker("boat")
    for k in range(6):
        tracker.hear(word(k * EVERY_S, 3.0 * k * EVERY_S * 1j))
    known = tracker.now(1.0)
    assert known is not None
    assert known.velocity == pytest.approx(3j)
    assert known.course == pytest.approx(1j)


def test_a_jump_is_not_believed_and_is_named() -> None:
    tracker = tracked(5.0, 0.0)
    before = tracker.now(2.4)
    assert not tracker.hear(word(2.4, 80.0 + 0j, 5.0 + 0j))
    assert tracker.now(2.4) == before
    assert any("jumped by 68 m" in said for said in tracker.take_said())


def test_a_place_that_is_told_on_and_on_is_believed_in_the_end() -> None:
    """Its receiver was off before, or is carried elsewhere: nobody says otherwise."""
    tracker = tracked(5.0, 0.0)
    heard = [tracker.hear(word(2.4 + k * EVERY_S, 80j, 0j)) for k in range(20)]
    first = heard.index(True)
    assert first * EVERY_S == pytest.approx(2.0, abs=0.41)
    known = tracker.now(6.0)
    assert known is not None
    assert abs(known.at - 80j) < 0.5


def test_a_velocity_that_the_places_contradict_is_not_flown() -> None:
    """A receiver tells 0 for what it does not know; another one is turned round."""
    for told in (0j, -3 + 0j, 3j, 40 + 0j):
        tracker = Tracker("boat")
        for k in range(40):
            tracker.hear(word(k * EVERY_S, 3.0 * k * EVERY_S + 0j, told))
        known = tracker.now(39 * EVERY_S)
        assert known is not None
        assert abs(known.velocity - 3.0) < 0.01
        assert abs(known.at - 3.0 * 39 * EVERY_S) < 0.01
        assert any("off that of its places: the places count" in t for t in tracker.take_said())


@pytest.mark.parametrize(
    ("every_s", "accuracy_m"), [(0.2, 0.5), (0.2, 3.0), (1.0, 0.5), (1.0, 3.0)]
)
@pytest.mark.parametrize("seed", range(5))
def test_noise_of_the_places_contradicts_no_velocity(
    every_s: float, accuracy_m: float, seed: int
) -> None:
    """Two minutes of places with all the noise that is told of them; it speeds up and turns."""
    tracker, dice, at = Tracker("boat"), random.Random(seed), 0j
    for k in range(round(120.0 / every_s)):
        velocity = (3.0 + 2.0 * math.sin(0.5 * k * every_s)) * cmath.exp(0.1j * k * every_s)
        at += velocity * every_s
        off = complex(dice.gauss(0, accuracy_m), dice.gauss(0, accuracy_m)) / math.sqrt(2.0)
        tracker.hear(word(k * every_s, at + off, velocity)._replace(accuracy_m=accuracy_m))
    assert tracker.take_said() == []


def test_a_jump_in_height_is_not_believed_until_it_goes_on() -> None:
    tracker = tracked(5.0, 0.0)
    heard = [
        tracker.hear(word(t, 5.0 * t + 0j, 5.0 + 0j)._replace(height_m=90.0))
        for t in (2.4 + k * EVERY_S for k in range(20))
    ]
    assert heard.index(True) * EVERY_S == pytest.approx(2.0, abs=0.41)
    assert "jumped by 90 m in height by the word of boat" in tracker.take_said()


def test_absurd_speeds_are_refused() -> None:
    tracker = Tracker("boat")
    assert not tracker.hear(word(0.0, 0j, 300.0 + 0j))
    assert not tracker.hear(word(0.0, 0j)._replace(accuracy_m=1e9))
    assert tracker.now(0.0) is None
