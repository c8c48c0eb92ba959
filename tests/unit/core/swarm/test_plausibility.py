"""What is believed of a peer: all that an honest one says, nothing that no vehicle can do, and what
one forged state may do."""

from __future__ import annotations

import cmath
import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.model.messages import (
    AgentState,
    Answers,
    ClockEcho,
    ClockNews,
    CommandKind,
    Phase,
)
from swarm_ctl.core.model.planned_formation import Frame
from swarm_ctl.core.swarm.peers import Peer, Peers
from swarm_ctl.core.swarm.plausibility import (
    CREEP_M,
    INSISTS_S,
    JUMP_M,
    LASTS_S,
    SUSPECT_S,
    BeliefLimits,
    Doubt,
)
from tests.unit.core.builders import plan, state

PLAN = plan()
LIMITS = BeliefLimits.of(PLAN)
SPEED = PLAN.limits.speed_mps
TICK_S = 0.05
FINITE = st.floats(allow_nan=False, allow_infinity=False)


def heard(seconds: float = 1.0) -> tuple[Peers, Peer, float]:
    """A peer that stands at (0, 0) and was heard for so long; the time of its next state."""
    peers = Peers(PLAN, 1)
    peer = next(iter(peers))
    peer.clock.answered(0.0, 0.0, 0.0, 0.01)
    count = round(seconds / TICK_S)
    for k in range(count):
        assert peer.hear(said(k), TICK_S * k)
    return peers, peer, TICK_S * count


def said(k: int, **changes: Any) -> AgentState:
    """The k-th state of a peer that stands and flies."""
    still = {"position_ned_m": (0.0, 0.0, -8.0), "stop_point_m": (0.0, 0.0)}
    return state(2, **({"seq": 100 + k, "time_s": TICK_S * k} | still | changes))


@given(
    st.lists(
        st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.booleans(), st.floats(0, 0.3)),
        min_size=5,
        max_size=80,
    )
)
def test_an_honest_peer_is_always_believed(ticks: list[tuple[float, float, bool, float]]) -> None:
    """Whatever velocities it is told, in each tick another one, and whatever is lost or late."""
    peer = Peer(2, Peers(PLAN, 1).clocks.of[2], LIMITS)
    peer.clock.answered(0.0, 0.0, 0.0, 0.01)
    place = velocity = 0j
    response_s, arrivals = 1.0, []
    for k, (north, east, lost, late_s) in enumerate(ticks):
        setpoint = complex(north, east) * SPEED / math.sqrt(2)
        velocity += (setpoint - velocity) * TICK_S / response_s
        place += velocity * TICK_S
        stop = place + velocity * response_s
        word = said(
            k,
            position_ned_m=(place.real, place.imag, -8.0),
            velocity_ned_mps=(velocity.real, velocity.imag, 0.0),
            stop_point_m=(stop.real, stop.imag),
            setpoint_mps=(setpoint.real, setpoint.imag),
            response_s=response_s,
        )
        if not lost:
            arrivals.append((TICK_S * k + late_s, word))
    for came_s, word in sorted(arrivals, key=lambda arrival: arrival[0]):
        peer.hear(word, came_s)
        assert peer.found is None


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"stop_point_m": (9.0, 0.0)}, "its stop point jumped by 9.0 m in 0.05 s"),
        ({"stop_point_m": (60.0, 0.0)}, "its stop point is ahead of it by 60 m"),
        ({"position_ned_m": (3.0, 0.0, -8.0)}, "it jumped by 3.0 m in 0.05 s"),
        ({"velocity_ned_mps": (99.0, 0.0, 0.0)}, "it flies at 99 m/s"),
        ({"setpoint_mps": (SPEED * 1.1, 0.0)}, "its setpoint is"),
        ({"response_s": 60.0}, "it answers after 60 s"),
        ({"doubt_s": 60.0}, "it answers after"),
        ({"position_ned_m": (1e9, 0.0, 0.0)}, "it is more than 100 km away"),
        ({"time_s": 1e6}, "its clock stepped by 1e+06 s"),
        ({"time_s": -1e6}, "its clock stepped by 1e+06 s"),
    ],
)
def test_what_cannot_be_is_not_believed(changes: dict[str, Any], why: str) -> None:
    """The state before stays the believed one, and the peer is not counted on."""
    peers, peer, now = heard()
    before = peer.state
    assert not peer.hear(said(20, **changes), now)
    assert peer.state is before
    assert peers.suspects(now)[2].startswith(why)
    assert not peer.view(now).yields
    assert peer.view(now).fresh
    ((severity, text),) = peers.watch(now)
    assert (severity, text.startswith(f"agent 2 is not believed: {why}")) == ("warning", True)
    assert peers.watch(now) == []
    for k in range(20, 200):
        peer.hear(said(k + 1), TICK_S * (k + 1))
    assert peers.watch(TICK_S * 200 + SUSPECT_S) == [("info", "agent 2 is believed again")]


def test_both_places_are_kept_clear_of() -> None:
    """The told place counts as an aircraft for a while, unless that word was a figure without a
    place."""
    peers, peer, now = heard()
    peer.hear(said(20, position_ned_m=(8.0, 0.0, -8.0), stop_point_m=(8.0, 0.0)), now)
    (other,) = peers.snapshot(now).traffic
    assert (other.stop_point, other.yields, other.fresh) == (8 + 0j, False, False)
    assert peers.snapshot(now).peers[0].stop_point == 0j
    assert peers.snapshot(now + SUSPECT_S + 0.1).traffic == ()


def test_a_peer_that_insists_is_believed_unless_the_other_goes_on() -> None:
    """A corrected estimate: half a second later. A forger beside it: never."""
    for honest_goes_on in (False, True):
        _, peer, now = heard()
        believed = []
        for k in range(20, 60):
            there = said(k, position_ned_m=(9.0, 0.0, -8.0), stop_point_m=(9.0, 0.0))
            believed.append(peer.hear(there, now))
            if honest_goes_on:
                peer.hear(said(k), now)
            now += TICK_S
        assert any(believed) is not honest_goes_on
        if not honest_goes_on:
            assert believed.index(True) * TICK_S == pytest.approx(INSISTS_S, abs=TICK_S)
            assert all(believed[believed.index(True) :])


def test_before_the_flight_an_estimate_may_settle() -> None:
    """A receiver that finds its satellites moves by metres; no agent flies yet."""
    peers = Peers(PLAN, 1)
    peers.clocks.of[2].answered(0.0, 0.0, 0.0, 0.01)
    for k, north in enumerate((0.0, 6.0, 0.0, 6.0)):
        place = {"position_ned_m": (north, 0.0, 0.0), "stop_point_m": (north, 0.0)}
        assert peers.hear(said(k, phase=Phase.PREPARE, airborne=False, **place), TICK_S * k)
    assert peers.suspects(0.2) == {}


def test_jumps_add_up() -> None:
    """A forger that takes a little more each time is refused; the honest one that goes on is the
    believed one, or both places count."""
    _, peer, now = heard()
    believed = 0
    for k in range(40):
        forged = said(20, seq=121 + k, time_s=1.0 + 1e-4 * k, stop_point_m=(0.5 * k, 0.0))
        believed += peer.hear(forged, now)
    assert believed <= JUMP_M / 0.5 + 2


def counts(peer: Peer, now: float) -> bool:
    """Its part is over, by its word."""
    view = peer.view(now)
    return view.ends or view.left is not None or view.down


@pytest.mark.parametrize(
    "word",
    [{"phase": Phase.YIELD}, {"left": CommandKind.LAND}, {"down": True, "phase": Phase.ENDED}],
)
def test_a_word_that_ends_counts_once_it_lasts(word: dict[str, Any]) -> None:
    """Between honest states it never does; at once, a peer that says so is not counted on."""
    _, peer, _ = heard()
    for k in range(20, 101):
        peer.hear(said(k, **word if k % 2 else {}), TICK_S * k)
        assert not counts(peer, TICK_S * k)
    for k in range(101, 124):
        peer.hear(said(k, **word), TICK_S * k)
        assert counts(peer, TICK_S * k) is (TICK_S * (k - 101) >= LASTS_S)


def test_two_senders_are_told_by_their_numbers() -> None:
    """A state with the number of another one; a process that starts again counts from 1, once."""
    peers, peer, now = heard()
    peer.hear(said(20, time_s=0.98), now)
    peer.hear(said(20), now)
    assert peers.suspects(now) == {2: "two senders speak as it"}
    peers, peer, now = heard()
    for k in range(20, 60):
        assert peer.hear(said(k, seq=k - 19), TICK_S * k)
    assert peers.suspects(3.0) == {}


def test_forged_clock_messages_change_nothing() -> None:
    """The honest states say that the clock goes on as before."""
    peers, peer, now = heard()
    bounds = peer.clock.bounds(now)
    for k in range(20, 80):
        echo = ClockEcho(1, now - 0.01, 0.0)
        peers.hear_clock(ClockNews(2, now + 1e6, Answers.REGULAR, (echo,)), now)
        assert peer.hear(said(k), TICK_S * k)
        now += TICK_S
    assert peers.suspects(now)[2].startswith("its clock word steps by 1e+06 s")
    assert peer.clock.bounds(now) == pytest.approx(bounds, abs=0.01)


def test_an_expelled_peer_is_not_heard() -> None:
    """Its last place stays, and is no longer followed; after `readmit` it is heard again, and
    silent from then on."""
    peers, peer, now = heard()
    peers.expel({2}, now)
    assert not peer.hear(said(20), now)
    ages = peer.report(now).age_p99_s
    peers.count_ages(now + 20.0)
    assert peer.report(now).age_p99_s == ages
    view = peers.snapshot(now).peers[0]
    assert (view.expelled, view.fresh, view.followed, view.yields) == (True, False, False, False)
    peers.expel(set(), now + 20.0)
    later = peers.snapshot(now + 21.0).peers[0]
    assert (later.fresh, later.silent_s) == (False, pytest.approx(1.0))
    assert later.age_s > 20.0
    lost, again = peer.lost, round((now + 22.0) / TICK_S)
    assert peer.hear(said(again), now + 22.0)
    assert peer.lost == lost
    assert peers.snapshot(now + 22.0).peers[0].fresh


@given(
    st.tuples(FINITE, FINITE, FINITE), st.tuples(FINITE, FINITE), st.tuples(FINITE, FINITE), FINITE
)
def test_no_number_breaks_it(
    place: tuple[float, float, float],
    stop: tuple[float, float],
    setpoint: tuple[float, float],
    time_s: float,
) -> None:
    """Also numbers whose absolute value is not finite: an agent goes on, and its view is finite."""
    peers, peer, now = heard()
    changes = {"position_ned_m": place, "stop_point_m": stop, "setpoint_mps": setpoint}
    peer.hear(said(20, **changes, time_s=time_s), now)
    peer.hear(said(21), now + TICK_S)
    snapshot = peers.snapshot(now + TICK_S)
    for other in (*snapshot.peers, *snapshot.traffic):
        assert abs(other.stop_point) < 1e6
        assert abs(other.setpoint) <= SPEED * 1.1
    assert replace(snapshot).near(0j, 1.0)


@pytest.mark.parametrize(
    ("word", "named"),
    [
        ({"step": 255}, "step 255"),
        ({"frame": Frame((0.0, 0.0), scale=0.0)}, "scale 0"),
        ({"frame": Frame((0.0, 0.0), rate=-0.5)}, "-0.5"),
    ],
)
def test_what_the_plan_has_not_is_not_believed(word: dict[str, Any], named: str) -> None:
    found = LIMITS.absurd(state(2, **word))
    assert found is not None
    assert named in found.words


def test_jumps_that_add_up_are_told_as_their_sum() -> None:
    """Each of them alone is allowed: the words name what was exceeded, and its own limit."""
    peers, peer, now = heard()
    place, k = 0.0, 20
    while peers.suspects(now) == {} and k < 40:
        place += 1.5
        at = {"position_ned_m": (place, 0.0, -8.0), "stop_point_m": (place, 0.0)}
        peer.hear(said(k, **at), now)
        k, now = k + 1, now + TICK_S
    (words,) = peers.suspects(now).values()
    found = re.fullmatch(r"it jumped by (\d+\.\d) m in all; allowed: 2 m", words)
    assert found is not None
    assert float(found[1]) > JUMP_M


# --- places that drift away from their velocities ---


def crept(peers: Peers, peer: Peer, seconds: float, north_m: Callable[[float], float]) -> str:
    """What is said of a peer that turns in circles, and tells places so far north of its own."""
    said_of = ""
    for k in range(round(seconds / TICK_S)):
        t, rate = TICK_S * k, 0.5
        place = 3.0 * cmath.exp(1j * rate * t) - 3.0 + north_m(t)
        velocity = 1.5j * cmath.exp(1j * rate * t)
        word = said(
            20 + k,
            position_ned_m=(place.real, place.imag, -8.0),
            velocity_ned_mps=(velocity.real, velocity.imag, 0.0),
            stop_point_m=(place.real, place.imag),
        )
        now = TICK_S * (20 + k)
        assert peer.hear(word, now)
        said_of += "".join(text for _, text in peers.watch(now))
    return said_of


@pytest.mark.parametrize(("drift_mps", "after_s"), [(0.3, 15.0), (1.0, 5.0), (0.2, 30.0)])
def test_a_slow_drift_of_told_places_is_named(drift_mps: float, after_s: float) -> None:
    """No state jumps, and each is taken in: the peer is named once, and makes no way any more."""
    peers, peer, _ = heard()
    told = crept(peers, peer, after_s, lambda t: drift_mps * t)
    assert told.count("agent 2 is not believed: its places drift: 3.") == 1
    assert peer.found is not None
    assert peer.found.doubt is Doubt.CREEP
    assert not peer.view(TICK_S * 20 + after_s - TICK_S).yields


def test_what_an_honest_estimate_does_is_no_drift() -> None:
    """It is corrected by `JUMP_M` there and back, it swings by a metre, it errs by 0.1 m/s."""
    swings = [
        lambda t: 1.9 * (5.0 <= t < 20.0),
        lambda t: 1.0 * math.sin(0.7 * t),
        lambda t: 0.1 * t,
    ]
    for north_m in swings:
        peers, peer, _ = heard()
        assert crept(peers, peer, 60.0, north_m) == ""
    assert CREEP_M > JUMP_M
