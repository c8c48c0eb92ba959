"""Which peers are near: none comes within the filter's reach unheard."""

from __future__ import annotations

import cmath
import math
from collections import deque
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.core.kernel.boundary import FOLLOW_TICKS, LOOK_S, near_m
from swarm_ctl.core.kernel.constraints import margins_of
from swarm_ctl.core.model.messages import AgentState, Phase
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.timeouts import FAR_EVERY_S
from swarm_ctl.core.swarm.hearing import SMALL_SWARM, Hearing, hears_all
from swarm_ctl.mission.compile.loader import load, loads

TICK_S = 0.05
WORDS = round(FAR_EVERY_S / TICK_S)
OWN, PEER = 3, 12
WEDGE = Path(__file__).parents[4] / "missions" / "thirtytwo.yaml"


def mission(count: int) -> Plan:
    agents = "".join(f"  - {{id: {k + 1}, start: [0, {9 * k}]}}\n" for k in range(count))
    return loads(
        "version: 1\nname: row\norigin: {lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}\n"
        f"unit_m: 1\nlaw: {{r: 10, r_out: 6, r_in: 2.5}}\nagents:\n{agents}"
        "shapes:\n  row: {kind: line, spacing: 9}\n"
        "steps:\n  - takeoff: {height_m: 4}\n  - form: {shape: row}\n  - land\n"
    ).plan


PLAN = mission(SMALL_SWARM + 1)
SPEED = PLAN.limits.speed_mps
REACH_M = margins_of(PLAN.law, PLAN.response, SPEED, PLAN.unit_m).farthest
STATE = AgentState(PEER, 1, 0.0, 1, Phase.FLY, 1, False, True, (0, 0, 0), (0, 0, 0), (0, 0), (0, 0))


@dataclass
class Heard:
    """The peer, as its newest word has it."""

    id: int = PEER
    state: AgentState | None = None
    earliest_s: float = -math.inf


@dataclass
class Flight:
    """Two stop points, tick by tick, and what the one agent hears of the other."""

    own: complex
    peer: complex
    phase: int = 0
    """In which tick of a period the peer says its far word."""
    lost: tuple[bool, ...] = ()
    """Of the far words, in turn."""
    delay: int = FOLLOW_TICKS
    """Ticks until a subscription works."""

    def __post_init__(self) -> None:
        self.hearing = Hearing(PLAN, OWN, REACH_M)
        self.heard = Heard(state=self.told(), earliest_s=0.0)
        self.tick = 0
        self.words = 0
        self.near: deque[bool] = deque([False] * (self.delay + 2), maxlen=self.delay + 2)

    def told(self) -> AgentState:
        return replace(STATE, stop_point_m=(self.peer.real, self.peer.imag))

    @property
    def now(self) -> float:
        return self.tick * TICK_S

    @property
    def follows(self) -> bool:
        """A state that was sent in the tick before is heard in this one."""
        return all(self.near)

    def fly(self, own: complex, peer: complex) -> None:
        """A tick at these shares of the top speed."""
        said, sent_s = self.told(), self.now
        word = self.tick % WORDS == self.phase
        if word:
            word = not (self.words < len(self.lost) and self.lost[self.words])
            self.words += 1
        self.tick += 1
        self.own += own * SPEED * TICK_S
        self.peer += peer * SPEED * TICK_S
        if word or self.follows:
            self.heard.state, self.heard.earliest_s = said, sent_s
        found = self.hearing.look(
            self.now, (self.own.real, self.own.imag), [self.heard], frozenset()
        )
        self.near.append(self.near[-1] if found is None else PEER in found)

    @property
    def unheard_m(self) -> float:
        """How far within the reach the peer has come unheard; negative: it has not."""
        return -math.inf if self.follows else REACH_M - abs(self.own - self.peer)


TURNS = st.lists(
    st.tuples(
        st.integers(1, 30), *(st.sampled_from([0.0, 0.5, 1.0]), st.floats(-math.pi, math.pi)) * 2
    ),
    min_size=1,
    max_size=12,
)


@settings(max_examples=150, deadline=None)
@given(
    turns=TURNS,
    at=st.floats(0.0, 60.0),
    phase=st.integers(0, WORDS - 1),
    lost=st.lists(st.booleans(), max_size=8).map(tuple),
    delay=st.integers(0, FOLLOW_TICKS),
)
def test_no_flight_brings_a_far_peer_within_reach_unheard(
    turns: list[tuple[int, float, float, float, float]],
    at: float,
    phase: int,
    lost: tuple[bool, ...],
    delay: int,
) -> None:
    """However both turn, at any speed up to the limit, whichever far words are lost, and however
    late within its time a subscription works. Headings are relative to the line between both: 0 is
    straight at each other."""
    flight = Flight(0j, complex(REACH_M + 12.0 + at, 0.0), phase, lost, delay)
    for ticks, *wishes in turns:
        own_share, own_turn, peer_share, peer_turn = wishes
        for _ in range(ticks):
            towards = flight.peer - flight.own
            towards /= max(abs(towards), 1e-9)
            flight.fly(
                own_share * towards * cmath.exp(1j * own_turn),
                -peer_share * towards * cmath.exp(1j * peer_turn),
            )
            assert flight.unheard_m <= 0.0


@pytest.mark.parametrize("lost", range(9))
def test_head_on_the_peer_is_heard_just_in_time(lost: int) -> None:
    """The worst flight: both straight at each other, with so many far words lost in a row before
    the boundary. The peer is heard in time at each phase of words and looks; and the boundary is no
    wider than the two metres that an estimate may jump and a few ticks of flight."""
    rooms = []
    for phase in range(WORDS):
        for start in range(20):
            flight = Flight(0j, complex(REACH_M + 40.0 + 0.1 * SPEED * start, 0.0), phase)
            silent = round(lost * WORDS)
            before = math.ceil(
                (abs(flight.peer) - near_m(0.0, flight.hearing.boundary)) / (0.1 * SPEED)
            )
            first = max(0, (before - silent) // WORDS)
            flight.lost = (False,) * first + (True,) * lost
            while not flight.follows:
                flight.fly(1.0, -1.0)
                assert flight.unheard_m <= 0.0
            rooms.append(abs(flight.own - flight.peer) - REACH_M)
    most_m = 2.0 + SPEED * (2.0 * (LOOK_S + 3 * TICK_S) + FAR_EVERY_S)
    assert 0.0 < min(rooms) < most_m


def test_the_boundary_of_one_swarm() -> None:
    """The wedge of 32 at 4 m/s: who is farther away than 24.5 m is far."""
    plan = load(WEDGE).plan
    reach_m = margins_of(plan.law, plan.response, plan.limits.speed_mps, plan.unit_m).farthest
    assert reach_m == pytest.approx(15.7, abs=0.05)
    assert near_m(0.0, Hearing(plan, 1, reach_m).boundary) == pytest.approx(24.5, abs=0.05)


def test_far_words_are_spread_over_the_ticks() -> None:
    """Twice a second, and agents that start together say theirs in different ticks."""
    said = {}
    for agent in PLAN.agents[:WORDS]:
        hearing = Hearing(PLAN, agent.id, REACH_M)
        ticks = [tick for tick in range(100) if hearing.says(tick * TICK_S)]
        assert all(b - a == WORDS for a, b in pairwise(ticks[1:]))
        said[agent.id] = ticks[1] % WORDS
    assert sorted(said.values()) == list(range(WORDS))


def test_small_swarms_hear_all() -> None:
    assert hears_all(mission(SMALL_SWARM))
    assert not hears_all(PLAN)
