"""Words that name what the plan has not: each field of each payload, drawn out of range. They raise
nothing, change no picture, and their sender is named."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.core.model.messages import (
    AgentState,
    AgentStatus,
    Command,
    CommandKind,
    ExchangeState,
    PairReport,
    Payload,
    SafetyReport,
    SigmaReport,
)
from swarm_ctl.core.model.planned_formation import Frame
from swarm_ctl.core.swarm.in_plan import InPlan
from swarm_ctl.station.picture.alarms import alarms
from swarm_ctl.station.picture.journal import Journal
from swarm_ctl.station.picture.summaries import answers, command_words, verdict, waiting
from swarm_ctl.station.picture.view import SwarmView
from tests.odd_words import odd_fields
from tests.unit.plans import steps_of
from tests.unit.station.swarm import flying_model, hexagon_plan, report_of, state_of, status_of

PLAN = hexagon_plan()
IN_PLAN = InPlan(PLAN)
AT_S = 30.5


def state(**changes: Any) -> AgentState:
    return replace(state_of(PLAN, 2, AT_S, 1000), **changes)


def status(**changes: Any) -> AgentStatus:
    return replace(status_of(PLAN, 2, AT_S), **changes)


def pair(peer: int, **changes: Any) -> PairReport:
    return report_of(peer, 1.0, **changes)


NAMED: list[tuple[Payload, str]] = [
    (state(step=255), "step 255; the plan has 4 steps"),
    (state(stage=9), "stage 9"),
    (state(frame=Frame((0.0, 0.0), leg=200)), "200 waypoints"),
    (state(exchange=ExchangeState(6)), "place 6"),
    (state(exchange=ExchangeState(0, offer_to=77)), "place 77"),
    (state(exchange=ExchangeState(0, answer_role=-5)), "place -5"),
    (state(position_ned_m=(1e300, 0.0, 0.0)), "position_ned_m is 1e+300"),
    (state(time_s=float("nan")), "time_s is nan"),
    (state(frame=Frame((float("inf"), 0.0))), "point_m is inf"),
    (status(step=5), "step 5"),
    (status(nearest_agent=9), "agent 9"),
    (status(neighbours=(1, 40)), "agent 40"),
    (status(without=(0,)), "agent 0"),
    (status(doubted={12: "x"}), "agent 12"),
    (status(roles=((1.0, 6),)), "place 6"),
    (status(safety=SafetyReport(kept_from=(0, 3, 17))), "agent 17"),
    (status(battery_percent=float("inf")), "battery_percent is inf"),
    (SigmaReport(2, AT_S, (0.0, 0.0), (0.0, 0.0), (pair(44),)), "agent 44"),
    (SigmaReport(2, AT_S, (0.0, 0.0), (0.0, 0.0), (pair(3, sigma=float("nan")),)), "sigma is nan"),
    (Command("c", CommandKind.NEXT, (), AT_S, at_step=255), "step 255"),
]


@pytest.mark.parametrize(("payload", "words"), NAMED, ids=[words for _, words in NAMED])
def test_what_the_plan_has_not_is_named(payload: Payload, words: str) -> None:
    assert words in IN_PLAN.unknown(payload)


def test_what_the_plan_has_is_believed() -> None:
    for step in range(len(steps_of(PLAN)) + 1):
        assert IN_PLAN.unknown(state(step=step)) == ""
        assert IN_PLAN.unknown(status(step=step)) == ""
    for role in range(-1, 6):
        assert IN_PLAN.unknown(state(exchange=ExchangeState(role, offer_to=role))) == ""
    assert IN_PLAN.unknown(status(neighbours=(1, 6), nearest_agent=3)) == ""
    report = SigmaReport(2, AT_S, (0.0, 0.0), (0.0, 0.0), (pair(3),))
    assert IN_PLAN.unknown(report) == ""


def test_an_agent_of_another_plan_is_seen_but_for_its_mission() -> None:
    """Its steps are not this plan's: where it is counts, and that it has another plan."""
    model = flying_model(PLAN)
    model.fold(state(plan_hash=7, step=200, frame=Frame((0.0, 0.0), leg=90)), AT_S)
    view = model.view(AT_S)
    told = view.agent(2).state
    assert told is not None
    assert (told.step, told.frame, told.plan_hash) == (0, None, 7)
    assert "other plan" in {alarm.name for alarm in alarms(view)}


@pytest.mark.parametrize(("payload", "words"), NAMED[:-1], ids=[words for _, words in NAMED[:-1]])
def test_a_station_does_not_believe_it_and_says_of_whom(payload: Payload, words: str) -> None:
    model = flying_model(PLAN)
    before = model.view(AT_S)
    model.fold(payload, AT_S)
    view = model.view(AT_S)
    assert view.step == before.step
    assert view.agent(2).state == before.agent(2).state
    found = [alarm for alarm in alarms(view) if alarm.name == "not believed"]
    assert [alarm.agents for alarm in found] == [(2,)]
    assert words in found[0].words


FULL: list[Payload] = [
    state(frame=Frame((0.0, 0.0)), exchange=ExchangeState(1)),
    status(neighbours=(1, 3), nearest_agent=1, nearest_m=5.0, roles=((1.0, 2),), without=(4,)),
    SigmaReport(2, AT_S, (0.0, 0.0), (0.0, 0.0), (pair(3),)),
    Command("c", CommandKind.HOLD, (1,), AT_S, at_step=2, about=(3,), number=4),
]


@settings(max_examples=100, deadline=None)
@given(st.sampled_from(FULL).flatmap(odd_fields))
def test_no_word_raises_in_a_station(payload: Payload) -> None:
    """Whatever is in range or not: the picture and all alarms are made, and figures are finite."""
    model, journal = flying_model(PLAN, states=20), Journal()
    journal.update(model.view(AT_S - 0.1))
    model.fold(payload, AT_S)
    view: SwarmView = model.view(AT_S)
    journal.update(view)
    verdict(view, alarms(view))
    waiting(view)
    for command in view.commands:
        assert isinstance(command_words(command.command) + answers(command, view), str)
    assert 0 <= view.step <= len(steps_of(PLAN))
    for agent in view.agents:
        assert agent.state is None or IN_PLAN.unknown(agent.state) == ""
