"""Attacks on an open mesh: a forger speaks as an agent, or as a station. The flight ends as the
unharmed one, with the same distance within 5 %, and the log names whose word was not believed."""

from __future__ import annotations

import functools
import itertools
import math
import random
from dataclasses import dataclass, replace

import pytest

from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.model.messages import (
    AgentState,
    Answers,
    ClockEcho,
    ClockNews,
    ExchangeState,
    Phase,
)
from tests.scenarios.swarm import flown_once, low_hexagon
from tests.security.forger import Attacked, Forge

IDS = range(1, 7)
FORM = 2


@flown_once
def forming() -> Attacked:
    """What all flights share: up to the form step."""
    flight = Attacked(low_hexagon())
    flight.swarm.wait(lambda s: s.in_step(FORM), 60)
    return flight


@functools.cache
def unharmed_m() -> float:
    """The smallest distance of the flight that no forger disturbs."""
    flight = forming()
    flight.swarm.fly()
    assert set(flight.swarm.outcomes().values()) == {"completed"}
    assert "believed" not in flight.said()
    return flight.swarm.closest_m


def elsewhere(state: AgentState) -> AgentState:
    """Its position is true; its stop point is far off, so nothing seems to be in the way."""
    north, east = state.stop_point_m
    return replace(state, stop_point_m=(north + 40.0, east))


def far(state: AgentState) -> AgentState:
    """All of it is 300 m further north."""
    (n, e, d), (stop_n, stop_e) = state.position_ned_m, state.stop_point_m
    return replace(state, position_ned_m=(n + 300.0, e, d), stop_point_m=(stop_n + 300.0, stop_e))


def huge(state: AgentState) -> AgentState:
    """Finite numbers whose absolute value is not."""
    return replace(state, stop_point_m=(1.7e308, -1.7e308))


def words(**changes: object) -> Forge:
    return lambda state: replace(state, **changes)  # type: ignore[arg-type]


def ahead(state: AgentState) -> AgentState:
    return replace(state, time_s=state.time_s + 1e6)


@dataclass(frozen=True)
class Row:
    """What a forger says, as whom, to whom, and how often for each honest state."""

    name: str
    word: Forge
    says: str
    speaks_as: tuple[int, ...] = (3,)
    to: tuple[int, ...] = tuple(IDS)
    times: int = 1
    for_s: float = 30.0
    moved: bool = False
    """It makes agents fly other ways: another smallest distance, but none under `r_in`."""

    def __str__(self) -> str:
        return self.name


def any_exchange(state: AgentState) -> AgentState:
    """Words of slot exchange, another one each tick."""
    drawn = random.Random(state.seq)
    place, version = (
        functools.partial(drawn.randrange, -1, 6),
        functools.partial(drawn.randrange, 3),
    )
    exchange = ExchangeState(
        drawn.randrange(6), version(), place(), place(), version(), place(), version(), place()
    )
    return replace(state, exchange=exchange)


ONCE = 0.1
OTHERS = (1, 2, 3, 5, 6)
ROWS = (
    Row("stop points, to 4 and 5", elsewhere, "its stop point", (1, 2, 3, 6), (4, 5)),
    Row("positions + 300 m", far, "it jumped by"),
    Row("one state: it yields", words(phase=Phase.YIELD), "two senders", for_s=ONCE),
    Row("it yields, on and on", words(phase=Phase.YIELD), "two senders", times=3),
    Row("it is down", words(phase=Phase.ENDED, down=True), "two senders", to=(4, 5)),
    Row("it carries out a command", words(override=77), "two senders"),
    Row("all others are done, to 4", words(done=True), "two senders", OTHERS, (4,), 3),
    Row(
        "all others land, to 4",
        words(step=4, done=True),
        "two senders",
        OTHERS,
        (4,),
        3,
        moved=True,
    ),
    Row("it has not begun", words(step=1, done=False), "two senders", times=3),
    Row("it has agent 4's slots", words(exchange=ExchangeState(3, 50)), "two senders", moved=True),
    Row("it exchanges slots", any_exchange, "two senders", moved=True),
    Row("from 1e6 s ahead", ahead, "its clock stepped by 1e+06 s"),
    Row("slow", words(response_s=60.0), "it answers after 60 s"),
    Row("fast", words(setpoint_mps=(50.0, 0.0)), "its setpoint is 50 m/s"),
    Row("huge", huge, "its stop_point_m is 1.7e+308; allowed: up to 1e+12"),
)


IN_SHORT = ("stop points, to 4 and 5", "it yields, on and on")
MARKED = [
    pytest.param(row, marks=() if row.name in IN_SHORT else pytest.mark.long, id=row.name)
    for row in ROWS
]


@pytest.mark.parametrize("row", MARKED)
def test_forged_states(row: Row) -> None:
    flight = forming()
    flight.forge(row.speaks_as, row.to, row.word, row.times)
    flight.swarm.run(row.for_s)
    flight.forge((), (), row.word, 0)
    r_in_m = flight.swarm.plan.law.r_in * flight.swarm.plan.unit_m
    least_m = r_in_m if row.moved else 0.95 * unharmed_m()
    ends_unharmed(flight, f"agent {row.speaks_as[0]} is not believed: {row.says}", least_m)


@pytest.mark.long
def test_forged_clock_words() -> None:
    """Each tells that agent 3 is 1e6 s ahead."""
    flight = forming()
    swarm = flight.swarm
    for _ in range(300):
        swarm.tick()
        echoes = tuple(ClockEcho(i, swarm.now - 0.01, 0.0) for i in IDS)
        flight.say(
            "clock", 3, (1, 2, 4, 5, 6), ClockNews(3, swarm.now + 1e6, Answers.REGULAR, echoes)
        )
    told = "agent 3 is not believed: its clock word steps by 1e+06 s"
    ends_unharmed(flight, told, 0.95 * unharmed_m())


def ends_unharmed(flight: Attacked, says: str, least_m: float) -> None:
    flight.swarm.fly(300.0)
    assert set(flight.swarm.outcomes().values()) == {"completed"}
    assert flight.swarm.closest_m >= least_m
    assert says in flight.said()


@pytest.mark.parametrize("changes", [{"scale": 0.1}, {"angle_rad": 1.0}], ids=["scale", "angle"])
def test_a_leader_that_lies_of_its_frame_collapses_nothing(
    changes: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the hold, by the agent that leads: the shape stands, and the log names it."""
    flight = Attacked(low_hexagon())
    flight.swarm.wait(lambda s: s.in_step(FORM + 1), 120)
    before_m = nearest_m(flight)

    leader = flight.swarm.members[1].agent
    honest = leader._state

    def lie(tick: Tick, fix: OwnFix) -> AgentState:
        state = honest(tick, fix)
        frame = state.frame
        return state if frame is None else replace(state, frame=replace(frame, **changes))

    monkeypatch.setattr(leader, "_state", lie)
    flight.swarm.run(6.0)
    assert "agent 1 is not believed: its formation" in flight.said()
    assert nearest_m(flight) > before_m - 1.0


def nearest_m(flight: Attacked) -> float:
    """Between two agents, now."""
    at = [place[:2] for place in flight.swarm.hub.world.positions()]
    return min(math.dist(a, b) for a, b in itertools.combinations(at, 2))
