"""Agents hear words whose fields are out of all ranges, under right keys: nothing
breaks, what the plan has not is named, and the flight goes on."""

from __future__ import annotations

import functools
import struct
from dataclasses import replace
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swarm_ctl.core.model.messages import (
    AgentState,
    Answers,
    ClockEcho,
    ClockNews,
    Command,
    CommandKind,
    ExchangeState,
    Gains,
    Payload,
    Phase,
    StationBeacon,
    Tuning,
)
from swarm_ctl.core.model.planned_formation import Frame
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.swarm.in_plan import InPlan
from swarm_ctl.errors import PayloadError
from swarm_ctl.mesh.payloads import decode, encode
from tests.odd_words import odd_changes, odd_fields
from tests.scenarios.swarm import flown_once, low_hexagon
from tests.security.forger import Attacked
from tests.unit.plans import steps_of
from tests.unit.station.swarm import hexagon_plan, state_of

IDS = range(1, 7)
FORM = 2
FULL = state_of(hexagon_plan(), 3, 1.0, frame=Frame((0.0, 0.0)), exchange=ExchangeState(2))
CLOCK = ClockNews(3, 1.0, Answers.REGULAR, (ClockEcho(1, 1.0, 0.0),))
SLOTS = steps_of(low_hexagon().plan)[FORM - 1]
STATION: list[tuple[str, Any]] = [
    ("beacon", StationBeacon("x", 1.0, 1)),
    ("command", Command("n", CommandKind.NEXT, (), 1.0, at_step=2, number=1)),
    ("command", Command("e", CommandKind.EXPEL, (), 1.0, number=2, about=(3,))),
    ("command", Command("f", CommandKind.FORM, (), 1.0, SLOTS, number=3)),  # type: ignore[arg-type]
    (
        "command",
        Command("m", "move", (), 1.0, MoveStep(((1.0, 1.0),), 1.0, 0.5, 2.0, 60.0), number=4),
    ),
    (
        "command",
        Command("t", "tune", (), 1.0, tuning=Tuning(Gains(0.1, 2.0, 0.05, 10.0), 1.0, ((1, 0.0),))),
    ),
]
"""Each said with odd fields, at the time that it is."""


@flown_once
def forming() -> Attacked:
    flight = Attacked(low_hexagon())
    flight.swarm.wait(lambda s: s.in_step(FORM), 60)
    return flight


def on_the_wire(payload: Payload) -> Payload | None:
    """What a hearer makes of it; None: no bytes say it."""
    try:
        return decode(type(payload), encode(payload))
    except (struct.error, PayloadError, OverflowError):
        return None


@settings(max_examples=8, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    st.lists(odd_changes(FULL), min_size=3, max_size=12), st.lists(odd_fields(CLOCK), max_size=3)
)
def test_no_word_of_a_peer_breaks_an_agent(
    changes: list[dict[str, Any]], clocks: list[ClockNews]
) -> None:
    """Agent 3 says odd states between its own ones: all others fly on, and name it if a word
    names what the plan has not."""
    flight = forming()
    swarm, in_plan = flight.swarm, InPlan(low_hexagon().plan)
    said: list[AgentState] = []

    def word(state: AgentState, changed: dict[str, Any]) -> AgentState:
        heard = on_the_wire(replace(state, **changed))
        if isinstance(heard, AgentState) and heard.agent == 3:
            said.append(heard)
            return heard
        return state

    for changed in changes:
        flight.forge((3,), IDS, functools.partial(word, changed=changed), 1)
        swarm.run(0.1)
    flight.forge((), (), lambda state: state, 0)
    for news in clocks:
        if on_the_wire(news) is not None:
            flight.say("clock", 3, (1, 2, 4, 5, 6), news)
    swarm.run(1.0)
    ours = swarm.plan.hash()
    if any(in_plan.unknown(each) for each in said if each.plan_hash == ours):
        assert "agent 3 is not believed" in flight.said()
    for agent, member in swarm.members.items():
        assert member.status is not None
        assert member.alive
        assert member.status.phase is Phase.FLY, (agent, member.status.reason)


@settings(max_examples=8, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    st.lists(
        st.sampled_from(STATION).flatmap(
            lambda each: st.tuples(st.just(each[0]), odd_changes(each[1]), st.just(each[1]))
        ),
        min_size=3,
        max_size=10,
    )
)
def test_no_word_of_a_station_breaks_an_agent(said: list[tuple[str, dict[str, Any], Any]]) -> None:
    """Odd orders and beacons may be refused or obeyed: no agent ends, and none comes near."""
    flight = forming()
    swarm = flight.swarm
    for k, (channel, changes, payload) in enumerate(said):
        now: dict[str, Any] = {"time_s": swarm.now}
        if isinstance(payload, Command):
            now |= {"id": f"{payload.id}{k}", "number": 10 + k}
        word = replace(payload, **now | changes)
        if on_the_wire(word) is not None:
            for transport in flight._transports.values():
                key = f"swarm/test/station/x/{channel}"
                for inlet in transport.inlets(key):
                    inlet.put(swarm.now, key, encode(word))
        swarm.run(0.5)
    swarm.run(2.0)
    assert all(member.alive for member in swarm.members.values())
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m
