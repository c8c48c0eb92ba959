"""The mission clock that a station tells from the agents' messages."""

from __future__ import annotations

import pytest

from swarm_ctl.engine.station.mesh_clock import MeshClock


class Time:
    """The clock under the heard one, set by hand."""

    def __init__(self) -> None:
        self.s = 3.0

    def now(self) -> float:
        return self.s


@pytest.fixture
def time() -> Time:
    return Time()


@pytest.fixture
def clock(time: Time) -> MeshClock:
    made = MeshClock()
    made._own = time  # type: ignore[assignment]
    return made


@pytest.mark.parametrize("first", [500.0, 0.5])
def test_the_first_word_sets_it(clock: MeshClock, first: float) -> None:
    """Forwards or backwards."""
    clock.hear(1, first)
    assert clock.heard
    assert clock.now() == first


def test_the_fastest_message_counts(clock: MeshClock, time: Time) -> None:
    """Messages take 5 to 200 ms; the clock is as late as the fastest, and is not pulled by the slow
    ones."""
    for k in range(200):
        time.s += 0.05
        clock.hear(1, 1000.0 + time.s - (0.005 if k % 10 == 0 else 0.2))
    assert abs(clock.now() - (1000.0 + time.s)) < 0.02


def test_it_follows_agents_whose_clock_is_a_little_slower(clock: MeshClock, time: Time) -> None:
    """Fifty millionths, for an hour: it does not run away from them by the whole 180 ms."""
    for _ in range(36000):
        time.s += 0.1
        clock.hear(1, 100.0 + time.s * (1 - 50e-6) - 0.005)
    assert abs(clock.now() - (100.0 + time.s * (1 - 50e-6))) < 0.03


@pytest.mark.parametrize("ahead_s", [-10.0, 10.0, 0.5])
def test_an_agent_with_a_clock_of_its_own_does_not_move_it(
    clock: MeshClock, time: Time, ahead_s: float
) -> None:
    """It was started ten seconds later or before and counts from then: the first one's time stays,
    at each moment."""
    for _ in range(2000):
        time.s += 0.05
        clock.hear(1, 100.0 + time.s)
        clock.hear(2, 100.0 + ahead_s + time.s)
        assert clock.now() == pytest.approx(100.0 + time.s)


def test_a_first_message_that_was_late_sets_it_back_for_no_longer_than_the_next(time: Time) -> None:
    """At 25 times real time 100 ms are 2.5 s of the mission."""
    clock = MeshClock(25.0)
    clock._own = time  # type: ignore[assignment]
    for late_s in (2.5, 0.1):
        clock.hear(1, 100.0 + time.s - late_s)
    assert clock.now() == pytest.approx(100.0 + time.s - 0.1)


def test_one_that_starts_again_does_not_move_it(clock: MeshClock, time: Time) -> None:
    """It counts from its new start; the clock goes on as before."""
    clock.hear(1, 100.0 + time.s)
    for _ in range(100):
        time.s += 0.05
        clock.hear(1, time.s)
    assert clock.now() == pytest.approx(100.0 + time.s)


def test_in_lockstep_it_is_the_newest_message_of_all() -> None:
    """Mission time has no pace there."""
    clock = MeshClock(lockstep=True)
    for agent, time_s in ((1, 3.0), (2, 9.0), (1, 7.0)):
        clock.hear(agent, time_s)
    assert clock.now() == 9.0
