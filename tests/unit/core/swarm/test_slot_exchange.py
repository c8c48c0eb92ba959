"""Slot exchange between agents, each with its own knowledge, over a mesh that loses and delays."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.core.model.messages import AgentState, ExchangeState, Phase
from swarm_ctl.core.model.plan import LawParameters, Point
from swarm_ctl.core.swarm.peers import Peers
from swarm_ctl.core.swarm.slot_exchange import SlotExchange
from tests.unit.core.builders import plan

FLYING = ("all", 2, 0)
PLAN = plan(agents=4, unit_m=1.0, law=LawParameters(r=20.0, r_out=6.0, r_in=2.5))
IDS = [agent.id for agent in PLAN.agents]
ALL_LINKED = {i: tuple(j for j in IDS if j != i) for i in IDS}
TICK_S, SPEED = 0.05, 1.0


@dataclass
class Swarm:
    """Points that fly straight to their slots; states that are late (up to `delay` ticks) and lost
    (`loss`)."""

    slots: list[Point]
    at: dict[int, complex]
    seed: int = 1
    loss: float = 0.0
    delay: int = 0
    dead: set[int] = field(default_factory=set)
    now: float = 0.0
    new: bool = True

    def __post_init__(self) -> None:
        self.random = np.random.default_rng(self.seed)
        self.peers = {i: Peers(PLAN, i) for i in IDS}
        self.dealers = {i: SlotExchange(PLAN, PLAN.groups[0], i, self.peers[i]) for i in IDS}
        for dealer in self.dealers.values():
            dealer.begin(self.slots)
        self.way: list[tuple[int, int, AgentState]] = []
        self.seq = 0

    def tick(self) -> None:
        self.now += TICK_S
        self.seq += 1
        for i, dealer in self.dealers.items():
            if i in self.dead:
                continue
            self.tell_time(i)
            dealer.hear()
            dealer.look(
                self.now, (self.at[i].real, self.at[i].imag), FLYING, ALL_LINKED, new=self.new
            )
            for j in IDS:
                if j != i and self.random.random() >= self.loss:
                    self.way.append(
                        (self.seq + int(self.random.integers(0, self.delay + 1)), j, self.state(i))
                    )
        for _, to, state in [each for each in self.way if each[0] <= self.seq]:
            self.peers[to].hear(state, self.now)
        self.way = [each for each in self.way if each[0] > self.seq]
        self.move()

    def tell_time(self, i: int) -> None:
        """All have one clock; they have to find that out."""
        news = self.peers[i].clocks.say(self.now)
        for j in IDS:
            if news is not None and j != i:
                self.peers[j].clocks.hear(news, self.now)

    def state(self, i: int) -> AgentState:
        place = (self.at[i].real, self.at[i].imag)
        return AgentState(
            *(i, self.seq, self.now, PLAN.hash(), Phase.FLY, 2, False, True),
            *((*place, -8.0), (0.0, 0.0, 0.0), place, (0.0, 0.0)),
            exchange=self.dealers[i].exchange,
        )

    def move(self) -> None:
        errors = {i: self.at[i] - complex(*self.slots[self.dealers[i].exchange.role]) for i in IDS}
        mean = sum(errors.values()) / len(errors)
        for i, error in errors.items():
            way = mean - error
            if i not in self.dead:
                self.at[i] += way / max(abs(way), 1e-9) * min(SPEED * TICK_S, abs(way))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            self.tick()

    @property
    def roles(self) -> list[int]:
        return [self.dealers[i].exchange.role for i in IDS]


def row() -> dict[int, complex]:
    return {i: complex(0, 9 * k) for k, i in enumerate(IDS)}


SWAPPED: list[Point] = [(0.0, 27.0), (0.0, 18.0), (0.0, 9.0), (0.0, 0.0)]
"""Each agent has to go past each other one."""


def test_a_row_that_is_to_turn_round_stays_where_it_is() -> None:
    """Only the shape counts: the outer two and the inner two swap roles; all know it; none has to
    fly far."""
    swarm = Swarm(SWAPPED, row())
    swarm.run(20)
    assert swarm.roles == [3, 2, 1, 0]
    assert all(
        dealer.roles == dict(zip(IDS, swarm.roles, strict=True))
        for dealer in swarm.dealers.values()
    )
    assert all(dealer.settled(swarm.now) for dealer in swarm.dealers.values())
    assert all(abs(swarm.at[i] - at) < 9.0 for i, at in row().items())


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 1000), st.floats(0.0, 0.6), st.integers(0, 6), st.permutations(SWAPPED))
def test_whatever_is_lost_or_late_each_agent_ends_with_a_role_of_its_own(
    seed: int, loss: float, delay: int, slots: list[Point]
) -> None:
    """Lost and late news delay exchanges; in the end the roles are a permutation, and no agent
    waits for another."""
    swarm = Swarm(slots, row(), seed, loss, delay)
    swarm.run(40)
    swarm.new = False
    swarm.run(10)
    assert sorted(swarm.roles) == [0, 1, 2, 3]
    assert all(dealer.settled(swarm.now) for dealer in swarm.dealers.values())


class Restless(SlotExchange):
    """Runs each round."""

    def _at_rest(self) -> bool:
        return False


@settings(max_examples=6, deadline=None)
@given(
    st.integers(0, 1000),
    st.floats(0.0, 0.6),
    st.lists(st.floats(0.2, 4.0), min_size=2, max_size=6),
    st.permutations(SWAPPED),
)
def test_a_round_that_is_left_out_would_have_changed_nothing(
    seed: int, loss: float, spans_s: list[float], slots: list[Point]
) -> None:
    """Steps in which offers may be made, and steps in which exchanges only end, in turns."""
    resting, restless = Swarm(slots, row(), seed, loss, 3), Swarm(slots, row(), seed, loss, 3)
    restless.dealers = {i: Restless(PLAN, PLAN.groups[0], i, restless.peers[i]) for i in IDS}
    for dealer in restless.dealers.values():
        dealer.begin(slots)
    for turn, span_s in enumerate(spans_s):
        resting.new = restless.new = turn % 2 == 0
        for _ in range(round(span_s / TICK_S)):
            resting.tick()
            restless.tick()
            for i in IDS:
                assert resting.dealers[i].exchange == restless.dealers[i].exchange
                assert resting.dealers[i].taken == restless.dealers[i].taken


@settings(max_examples=6, deadline=None)
@given(st.floats(0.2, 6.0), st.sampled_from(IDS), st.permutations(SWAPPED))
def test_an_agent_that_dies_in_an_exchange_blocks_none(
    after_s: float, dead: int, slots: list[Point]
) -> None:
    """The living end with roles of their own, and settle."""
    swarm = Swarm(slots, row())
    swarm.run(after_s)
    swarm.dead.add(dead)
    swarm.run(30)
    living = [role for i, role in zip(IDS, swarm.roles, strict=True) if i != dead]
    assert len(set(living)) == 3
    assert all(swarm.dealers[i].settled(swarm.now) for i in IDS if i != dead)


def test_a_restarted_agent_takes_the_role_that_is_free() -> None:
    """It knows nothing of the exchanges it took part in; the others' roles tell."""
    swarm = Swarm(SWAPPED, row())
    swarm.run(20)
    fresh = SlotExchange(PLAN, PLAN.groups[0], IDS[1], swarm.peers[IDS[1]])
    fresh.rejoin(100.0)
    assert fresh.exchange.role == 2
    assert fresh.exchange.version > swarm.dealers[IDS[1]].exchange.version
    assert fresh.taken == [(100.0, 2)]


@pytest.mark.parametrize(
    "deal",
    [
        ExchangeState(role=-1),
        ExchangeState(role=4),
        ExchangeState(role=0, lock=9),
        ExchangeState(role=1, offer_to=-2),
    ],
)
def test_an_exchange_state_that_makes_no_sense_counts_as_none(deal: ExchangeState) -> None:
    """Its sender counts as having its own role, and nothing breaks. -1 is said by one that flies
    another plan; a place that no plan of so many agents has is not believed at all."""
    swarm = Swarm(SWAPPED, row())
    swarm.tick()
    at_s = swarm.now + TICK_S
    news = replace(swarm.state(IDS[2]), seq=swarm.seq + 1, time_s=at_s, exchange=deal)
    assert swarm.peers[IDS[0]].hear(news, at_s) == (deal == ExchangeState(role=-1))
    own = swarm.dealers[IDS[0]]
    own.hear()
    own.look(swarm.now + 1, (0.0, 0.0), ("all", 2, 0), ALL_LINKED, new=True)
    assert own.roles[IDS[2]] == 2
