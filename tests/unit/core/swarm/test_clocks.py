"""How far the others' clocks are ahead: the truth lies between the bounds, and news is never
younger than it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from swarm_ctl.core.model.messages import AgentState, Answers, ClockEcho, ClockNews, Phase
from swarm_ctl.core.model.timeouts import FRESH_S, NEIGHBOUR_S
from swarm_ctl.core.swarm.clocks import DRIFT, STEADY_S, Clocks, PeerClock
from swarm_ctl.core.swarm.peers import Peer
from swarm_ctl.core.swarm.plausibility import INSISTS_S, BeliefLimits
from tests.unit.core.builders import plan

LIMITS = BeliefLimits.of(plan())
ROUNDING_S = 1e-5
Showing = Callable[[float], float]
"""From the own time to what the other's clock shows."""

OFFSET = st.floats(-3600, 3600) | st.floats(-0.5, 0.5)
DRIFTS = st.floats(-1e-4, 1e-4) | st.floats(-0.9 * DRIFT, 0.9 * DRIFT)
DELAY = st.floats(0, 0.5) | st.just(0.0)


def state(time_s: float, seq: int = 1) -> AgentState:
    zero = (0.0, 0.0, 0.0)
    return AgentState(
        2, seq, time_s, 7, Phase.FLY, 1, False, True, zero, zero, (0.0, 0.0), (0.0, 0.0)
    )


@dataclass(frozen=True)
class Trip:
    """A word that goes out `gap_s` after the one before came back, and comes back."""

    gap_s: float
    out_s: float
    held_s: float
    back_s: float

    @property
    def s(self) -> float:
        """The round trip."""
        return self.out_s + self.back_s


TRIPS = st.lists(
    st.builds(Trip, st.floats(0, 5), DELAY, st.floats(0, 2), DELAY), min_size=1, max_size=12
)


def travel(clock: PeerClock, shows: Showing, now: float, trip: Trip) -> float:
    """One word there and back; when it is back."""
    left = now + trip.gap_s
    came = left + trip.out_s
    answered = came + trip.held_s
    back = answered + trip.back_s
    clock.answered(left, shows(came), shows(answered), back)
    return back


def steady(offset: float, drift: float) -> Showing:
    return lambda own: own * (1 + drift) + offset


@given(OFFSET, DRIFTS, TRIPS, st.floats(0, 60))
def test_the_truth_lies_between_the_bounds(
    offset: float, drift: float, trips: list[Trip], later: float
) -> None:
    """Whatever the ways are like, and long after the last word; the best guess is off by half a
    round trip at most."""
    clock, shows, now = PeerClock(), steady(offset, drift), 0.0
    for trip in trips:
        now = travel(clock, shows, now, trip)
        low, high = clock.bounds(now)
        truth = shows(now) - now
        assert low - ROUNDING_S <= truth <= high + ROUNDING_S
        assert high - low <= trip.s + 2 * DRIFT * (trip.s + trip.held_s) + ROUNDING_S
        assert (
            abs(truth - 0.5 * (low + high))
            <= 0.5 * trip.s + DRIFT * (trip.s + trip.held_s) + ROUNDING_S
        )
    low, high = clock.bounds(now + later)
    assert low - ROUNDING_S <= shows(now + later) - (now + later) <= high + ROUNDING_S


@given(
    OFFSET, DRIFTS, TRIPS, st.lists(st.tuples(st.floats(0.05, 0.3), DELAY), min_size=1, max_size=30)
)
def test_news_is_never_younger_than_it_is(
    offset: float, drift: float, trips: list[Trip], messages: list[tuple[float, float]]
) -> None:
    """States with random delays, out of order: the bound covers the true age, the guess is at least
    half of it."""
    peer, shows, now = Peer(2, PeerClock(), LIMITS), steady(offset, drift), 0.0
    for trip in trips:
        now = travel(peer.clock, shows, now, trip)
    sent_s, arrivals = now, []
    for seq, (gap_s, delay_s) in enumerate(messages, start=1):
        sent_s += gap_s
        arrivals.append((sent_s + delay_s, sent_s, seq))
    sent = {seq: sent_s for _, sent_s, seq in arrivals}
    for came_s, left_s, seq in sorted(arrivals):
        peer.hear(state(shows(left_s), seq), came_s)
        assert peer.state is not None
        true_age = came_s - sent[peer.state.seq]
        assert peer.view(came_s).age_at_most_s >= true_age - ROUNDING_S
        assert peer.view(came_s).age_at_most_s <= 2 * peer.age(came_s) + ROUNDING_S
        assert peer.age(came_s) >= 0.0
        assert peer.age(came_s + 3.0) == pytest.approx(peer.age(came_s) + 3.0)


@example(0.0, 8e-4, [Trip(0.0, 0.0, 0.0, 0.0)], 1.0, [], [Trip(0.0, 0.0, 1.0, 0.0)])  # held long
@given(OFFSET, DRIFTS, TRIPS, st.floats(-3600, 3600), st.lists(DELAY, max_size=5), TRIPS)
def test_a_clock_that_jumps(
    offset: float,
    drift: float,
    before: list[Trip],
    jump: float,
    delays: list[float],
    after: list[Trip],
) -> None:
    """Once the words have agreed for a while, the bounds are off by no more than the round trips:
    what is less is no contradiction."""
    clock, now = PeerClock(), 0.0
    for trip in before:
        now = travel(clock, steady(offset, drift), now, trip)
    shows = steady(offset + jump, drift)
    for delay in delays:
        clock.told(shows(now), now + delay)
        now += delay
    after += [replace(after[-1], gap_s=STEADY_S)] * 2
    for trip in after:
        now = travel(clock, shows, now, trip)
    widest = max(trip.s for trip in before) + min(trip.s for trip in after) + 2 * DRIFT * 60
    low, high = clock.bounds(now)
    assert clock.unknown_s is None
    assert low - widest <= shows(now) - now <= high + widest


@given(st.floats(0, 0.3), st.floats(0, 0.3))
def test_late_news_is_seen_as_late(out_s: float, back_s: float) -> None:
    """Also where only one way is slow: nothing that is over a second old counts as fresh."""
    peer, shows = Peer(2, PeerClock(), LIMITS), steady(-7.0, 0.0)
    now = travel(peer.clock, shows, 0.0, Trip(0.0, out_s, 0.3, back_s))
    late_s = 0.4
    peer.hear(state(shows(now), 1), now + late_s)
    assert peer.view(now + late_s).age_at_most_s >= late_s - ROUNDING_S
    assert peer.age(now + late_s) >= late_s - 0.5 * (out_s + back_s) - 0.01
    for held_s in (0.0, 0.2, 0.5, 0.8):
        if peer.age(now + late_s + held_s) <= FRESH_S:
            assert late_s + held_s <= 2 * FRESH_S


def test_who_does_not_answer_is_not_fresh_and_lost_in_the_end() -> None:
    """A peer with an unknown clock leaves N_i at once, and its states do not keep it
    alive."""
    peer = Peer(2, PeerClock(), LIMITS)
    for k in range(100):
        peer.hear(state(0.05 * k + 50.0, k), 0.05 * k)
        assert peer.age(0.05 * k) > NEIGHBOUR_S
    assert peer.age(0.05 * 99) == pytest.approx(0.05 * 99 + NEIGHBOUR_S, abs=0.02)
    assert peer.report(5.0).clock_ahead_s is None


def test_a_late_message_changes_nothing_and_a_clock_set_back_is_heard() -> None:
    """Late ones are behind in time and number; another process or a clock set back is not, or is
    alone."""
    peer = Peer(2, PeerClock(), LIMITS)
    travel(peer.clock, steady(0.0, 0.0), 0.0, Trip(0.0, 0.0, 0.0, 0.0))
    peer.hear(state(10.0, 10), 10.0)
    peer.hear(state(9.95, 9), 10.0)
    assert peer.state == state(10.0, 10)
    now = insists(peer, 11, 3.0, 10.05)
    assert peer.state is not None
    assert peer.state.time_s == pytest.approx(3.0 + now - 10.05)
    assert peer.age(now) > NEIGHBOUR_S
    travel(peer.clock, steady(-7.05, 0.0), now, Trip(0.0, 0.0, 0.0, 0.0))
    peer.hear(state(now + 0.05 - 7.05, 40), now + 0.05)
    assert peer.age(now + 0.05) == pytest.approx(0.0, abs=1e-3)


def insists(peer: Peer, seq: int, told_s: float, now: float) -> float:
    """A peer whose clock was set to `told_s`, until it is believed; when that is."""
    begun = now
    while not peer.hear(state(told_s + now - begun, seq), now):
        assert now - begun <= INSISTS_S
        seq, now = seq + 1, now + 0.05
    assert now - begun >= INSISTS_S - 0.05
    return now


def test_a_clock_set_ahead_is_not_believed_until_it_has_answered() -> None:
    """News from the future contradicts what is known of the clock."""
    peer = Peer(2, PeerClock(), LIMITS)
    travel(peer.clock, steady(0.0, 0.0), 0.0, Trip(0.0, 0.01, 0.0, 0.01))
    peer.hear(state(10.0, 1), 10.0)
    assert peer.age(10.0) < 0.1
    now = insists(peer, 2, 12.05, 10.05)
    assert peer.age(now) > NEIGHBOUR_S
    travel(peer.clock, steady(2.0, 0.0), now, Trip(0.0, 0.01, 0.0, 0.01))
    peer.hear(state(now + 0.1 + 2.0, 40), now + 0.1)
    assert peer.age(now + 0.1) < 0.1


def shared() -> tuple[Clocks, Peer]:
    """Agent 1's knowledge of agents 2 and 3, all on one clock, and agent 2 as it hears it."""
    clocks = Clocks(1, [2, 3], {1, 2, 3})
    return clocks, Peer(2, clocks.of[2], LIMITS)


@given(st.floats(0, 0.5), st.floats(-1e6, 1e6))
def test_a_shared_clock_is_known_exactly_whatever_words_say(late_s: float, told_s: float) -> None:
    """A state is as old as it is, from the first one on; no word is said, and a forged one changes
    nothing, however often it comes."""
    clocks, peer = shared()
    peer.hear(state(10.0, 1), 10.0 + late_s)
    for k in range(20):
        now = 10.0 + late_s + 0.05 * k
        assert k or clocks.say(now) is None
        echo = ClockEcho(1, now - 0.01, 0.0)
        clocks.hear(ClockNews(2, now + told_s, Answers.SOON, (echo,)), now)
        assert (peer.clock.known, peer.clock.bounds(now)) == (True, (0.0, 0.0))
        assert peer.age(now) == pytest.approx(now - 10.0, abs=1e-9)
        assert peer.view(now).age_at_most_s == pytest.approx(now - 10.0, abs=1e-9)
    assert peer.clock.stepped_s == pytest.approx(max(0.0, abs(told_s) - 0.01), abs=0.011)


def test_a_state_from_the_future_of_a_shared_clock_is_refused() -> None:
    """In flight it is dropped. From a process that has taken the peer's place it is never fresh,
    and the clock is asked for."""
    clocks, peer = shared()
    peer.hear(state(10.0, 1), 10.0)
    assert not peer.hear(state(10.15, 2), 10.05)
    assert peer.hear(state(10.1, 3), 10.1)
    assert (peer.age(10.1), clocks.say(10.1)) == (0.0, None)
    assert peer.hear(state(3600.0, 4), 12.0)
    assert peer.age(12.0) > NEIGHBOUR_S
    word = clocks.say(12.0)
    assert word is not None
    assert word.wants is Answers.SOON


def test_of_one_clock_late_states_are_asked_nothing() -> None:
    """A machine that can't keep up has no time for words. One that says words itself has a clock of
    its own, and is asked."""
    clocks, peer = shared()
    for k in range(40):
        peer.hear(state(0.05 * k, k), 0.7 + 0.05 * k)
    assert not peer.clock.known
    assert clocks.say(3.0) is None
    clocks.hear(ClockNews(peer.id, 2.3, Answers.SOON, ()), 3.0)
    word = clocks.say(3.0)
    assert word is not None
    assert word.wants is Answers.SOON


def test_another_process_with_an_older_clock_is_found_out() -> None:
    """Its states are late on and on, also if no other state of this peer was heard before. One
    stopped receiver is no reason."""
    _, peer = shared()
    for k in range(200):
        peer.hear(state(0.05 * k, k), 10.0)
    assert peer.clock.known
    _, peer = shared()
    for k in range(25):
        peer.hear(state(0.05 * k, k), 20.0 + 0.05 * k)
    assert not peer.clock.known
    now = travel(peer.clock, steady(-20.0, 0.0), 21.2, Trip(0.0, 0.01, 0.0, 0.01))
    peer.hear(state(now - 20.0, 30), now)
    assert peer.age(now) == pytest.approx(0.0, abs=0.02)


def test_one_that_knows_of_no_sharing_is_answered() -> None:
    """An agent that was started again by hand, on the same clock; seconds later no word is said
    any more."""
    clocks, _ = shared()
    clocks.hear(ClockNews(2, 5.0, Answers.SOON, ()), 5.01)
    word = clocks.say(5.05)
    assert word is not None
    assert [echo.agent for echo in word.echoes] == [2]
    said = [now for k in range(400) if clocks.say(now := 5.1 + 0.05 * k) is not None]
    assert len(said) <= 12
    assert max(said) < 12.0


def test_answers_do_not_feed_each_other() -> None:
    """One of six asks for a while, because its load made it take a peer's clock for another one:
    seconds after its last word no agent says any."""
    others = {i: Clocks(i, {*range(1, 7)} - {i}, range(1, 7)) for i in range(1, 6)}
    said: list[float] = []
    under_way: list[ClockNews] = []
    for k in range(400):
        now = 0.05 * k
        if now < 5.0:
            under_way.append(ClockNews(6, now, Answers.SOON, ()))
        for own in others.values():
            for news in under_way:
                own.hear(news, now)
        words = [clocks.say(now) for clocks in others.values()]
        under_way = [word for word in words if word]
        said += [now] * len(under_way)
    assert 5.0 < max(said) < 12.0


def test_a_hundred_clocks_are_known_within_three_seconds() -> None:
    """Of agents that were started by hand, each with a clock of its own. A word has a bounded
    size."""
    ahead = {i: 3600.0 * math.sin(i) for i in range(1, 101)}
    clocks = {i: Clocks(i, ahead.keys() - {i}) for i in ahead}
    for i, own in clocks.items():
        for j, clock in own.of.items():
            clock.told(ahead[j], ahead[i])
    under_way: list[ClockNews] = []
    known = False
    for tick in range(1, 60):
        now = 0.05 * tick
        for i, own in clocks.items():
            for news in under_way:
                if news.agent != i:
                    own.hear(news, now + ahead[i])
        words = [own.say(now + ahead[i]) for i, own in clocks.items()]
        under_way = [word for word in words if word is not None]
        assert all(len(word.echoes) <= 16 for word in under_way)
        known = all(clock.known for own in clocks.values() for clock in own.of.values())
        if known:
            break
    assert known
