"""The model: messages in, one picture out."""

from __future__ import annotations

import copy
import itertools
from dataclasses import replace

import numpy as np
import pytest

from swarm_ctl.core.law.formation import formation_error
from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.messages import (
    Ack,
    Command,
    Echo,
    Event,
    ExchangeState,
    LinkReport,
    Phase,
    SigmaReport,
    StationBeacon,
    StepOutcome,
    StepResult,
    TargetWord,
)
from swarm_ctl.core.model.plan import Plan, Policies
from swarm_ctl.core.model.steps.follow import FollowStep
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.targets import TargetPlan
from swarm_ctl.errors import InputError
from swarm_ctl.station.picture.model import Model
from tests.unit.plans import REST, SCOUTS, SWEEPERS, groups_mission
from tests.unit.station.swarm import (
    HEXAGON,
    flying_model,
    grouped_model,
    hexagon_plan,
    report_of,
    state_of,
    status_of,
)

PLAN = hexagon_plan()


def test_exchanged_slots_are_those_of_the_role() -> None:
    """Agents 1 and 2 took each other's slots and stand in them: the shape stands, and the map shows
    theirs."""
    model = Model(PLAN)
    taken = {1: 1, 2: 0}
    for k, agent in enumerate(PLAN.agents):
        role = taken.get(agent.id, k)
        place = (5 * HEXAGON[role][0], 5 * HEXAGON[role][1], -10.0)
        model.fold(
            state_of(PLAN, agent.id, 30.0, position_ned_m=place, exchange=ExchangeState(role=role)),
            30.0,
        )
    view = model.view(30.0)
    assert view.error_m == pytest.approx(0.0, abs=1e-9)
    assert view.agent(1).target_m == pytest.approx((5 * HEXAGON[1][0], 5 * HEXAGON[1][1]))


def test_an_agent_is_lost_after_the_plans_time_and_no_longer_counts() -> None:
    plan = replace(PLAN, policies=Policies(agent_lost_after_s=3.0))
    model = flying_model(plan, 30.0)
    for agent in plan.agents:
        if agent.id != 5:
            model.fold(state_of(plan, agent.id, 33.0, seq=5000), 33.0)
    assert not model.view(32.7).agent(5).lost
    view = model.view(33.1)
    assert [agent.id for agent in view.agents if agent.lost] == [5]
    assert view.agent(5).error_m is None
    kept = [
        agent.state.position_ned_m[:2] for agent in view.agents if agent.state and agent.id != 5
    ]
    slots = [slot for k, slot in enumerate(HEXAGON) if k != 4]
    assert view.error_m == pytest.approx(float(formation_error(kept, 5.0 * np.array(slots))))


def test_late_messages_change_no_picture() -> None:
    model = flying_model(PLAN, 30.0)
    before = model.view(30.0)
    model.fold(state_of(PLAN, 1, 12.0, seq=3, position_ned_m=(0.0, 0.0, 0.0)), 30.0)
    model.fold(status_of(PLAN, 1, 12.0, phase=Phase.ARM), 30.0)
    after = model.view(30.0)
    assert after.agent(1).state == before.agent(1).state
    assert after.agent(1).status == before.agent(1).status
    assert after.agent(1).link.late == before.agent(1).link.late + 1


def test_an_agent_that_was_started_again_is_seen_at_once_whatever_its_clock_shows() -> None:
    """Its new process counts from 0: what it says counts, nothing of the one before does, and its
    states are as old as they are, not as old as the other clock makes them."""
    model = flying_model(PLAN, 30.0)
    model.fold(status_of(PLAN, 1, 30.0, echo=Echo("", 29.9, 0.05)), 30.0)
    for k in range(3):
        state = state_of(PLAN, 1, 0.1 + 0.05 * k, seq=k, phase=Phase.LAND)
        model.fold(state, 32.0 + 0.05 * k)
    agent = model.view(32.2).agent(1)
    assert (agent.phase, agent.link.restarts, agent.status) == (Phase.LAND, 1, None)
    assert agent.link.age_s == pytest.approx(0.1)
    answer = Echo("", 32.1, 0.05)
    model.fold(status_of(PLAN, 1, 0.3, phase=Phase.LAND, echo=answer), 32.2)
    model.fold(Event(1, 0.3, "info", "took over"), 32.2)
    view = model.view(32.2)
    assert view.agent(1).status is not None
    assert view.events[-1].time_s == pytest.approx(32.2, abs=0.06)
    assert len(view.histories.trails[1]) == 1 + len(
        flying_model(PLAN, 30.0).view(30.0).histories.trails[1]
    )


def test_what_an_agent_says_stands_where_it_was_said_by_the_stations_clock() -> None:
    """The log of a swarm on several hosts was in the order of their clocks. What comes twice is
    told once, and what comes late stands where it was said."""
    model = Model(PLAN)
    model.fold(Event(1, 5000.0, "info", "ready"), 10.0)
    model.fold(status_of(PLAN, 1, 5000.5, echo=Echo("", 10.4, 0.05)), 10.5)
    model.fold(state_of(PLAN, 1, 5000.5, seq=1), 10.5)
    for _ in range(2):
        model.fold(Event(1, 5001.0, "info", "step 1: takeoff"), 18.0)
    model.fold(Event(2, 11.0, "info", "step 1: takeoff"), 11.1)
    told = [event.time_s for event in model.view(18.0).events]
    assert told == pytest.approx([10.0, 11.0, 11.0], abs=0.06)


def test_a_view_never_changes_again() -> None:
    model = flying_model(PLAN, 30.0)
    model.fold(Command("c1", "land", (), 30.0), 30.0)
    view = model.view(30.0)
    kept = copy.deepcopy(view)
    model.fold(Ack(1, "c1", True, ""), 30.1)
    model.fold(Event(1, 30.1, "info", "landing"), 30.1)
    model.fold(StationBeacon("other", 30.1, 1), 30.1)
    for agent in PLAN.agents:
        model.fold(state_of(PLAN, agent.id, 31.0, seq=7000, phase=Phase.LAND), 31.0)
    assert model.view(31.0) != kept
    assert view == kept


def test_pairs_come_nearest_first() -> None:
    model = flying_model(PLAN, 30.0)
    model.fold(
        SigmaReport(1, 30.0, (0.0, 0.0), (0.0, 0.0), (report_of(3, 1.4), report_of(2, 0.9))), 30.0
    )
    assert [(pair.a, pair.b) for pair in model.view(30.0).pairs] == [(1, 2), (2, 6), (1, 3)]


def test_only_the_last_events_are_kept_and_all_are_counted() -> None:
    model = Model(PLAN)
    for k in range(1300):
        model.fold(Event(1, float(k), "info", f"event {k}"), float(k))
    view = model.view(1300.0)
    assert view.event_count == 1300
    assert [event.time_s for event in view.events] == [float(k) for k in range(300, 1300)]


def test_a_stranger_is_shown() -> None:
    model = Model(PLAN)
    model.fold(replace(state_of(PLAN, 1, 1.0), agent=42), 1.0)
    view = model.view(1.0)
    assert [agent.id for agent in view.agents if not agent.in_plan] == [42]
    assert view.agent(42).error_m is None
    with pytest.raises(KeyError) as unknown:
        view.agent(9)
    assert isinstance(unknown.value, InputError)
    assert str(unknown.value) == "agent 9: there is none; allowed: agents 1-6, 42"


def test_strangers_fill_no_memory() -> None:
    """Thousands of agents that are in no plan, of stations, and of peers that a status makes up:
    those that are shown are few, and the plan's agents are all among them."""
    model = flying_model(PLAN, 30.0)
    for k in range(2000):
        model.fold(replace(state_of(PLAN, 1, 30.0), agent=100 + k), 30.0)
        model.fold(StationBeacon(f"desk-{k}", 30.0, 1), 30.0 + k / 1000)
    links = dict.fromkeys(range(1000, 3000), LinkReport(0.1, 0.1, 0.1, 1, 0))
    model.fold(status_of(PLAN, 1, 31.0, links=links), 31.0)
    model.fold(
        SigmaReport(
            1, 31.0, (0, 0), (0, 0), tuple(report_of(k, 1.2, "paper") for k in range(1000, 3000))
        ),
        31.0,
    )
    view = model.view(31.0)
    assert [agent.id for agent in view.agents if agent.in_plan] == [1, 2, 3, 4, 5, 6]
    assert len(view.agents) == 6 + 32
    assert "desk-1999" in view.stations
    assert len(view.stations) <= 33
    assert all(set(key) <= set(range(1, 7)) for key in view.histories.links)
    assert all(set(key) <= set(range(1, 7)) for key in view.histories.pairs)


BOAT = TargetPlan("boat")


def _boat_word(plan: Plan, east_m: float, height_m: float = 2.0, **changes: object) -> TargetWord:
    """Of a boat that goes to the east 50 m north of the origin; it tells no velocity."""
    at = geodetic_from_ned((50.0, east_m, -height_m), plan.origin)
    word = TargetWord(
        "boat", at.lat_deg, at.lon_deg, 0.1, altitude_m=at.alt_m, accuracy_m=0.5, station="boat.1"
    )
    return replace(word, **changes)  # type: ignore[arg-type]


def test_a_target_is_where_agents_believe_it_to_be() -> None:
    """Carried on by its motion; a liar beside it moves nothing. The height that a mission gives
    counts, not the one that is told."""
    plan = replace(PLAN, targets=(replace(BOAT, height_m=4.0),))
    model = Model(plan)
    for k in range(50):
        now_s = 10.0 + 0.2 * k
        model.fold(_boat_word(plan, 0.6 * k), now_s)
        model.fold(_boat_word(plan, 0.6 * k + 60.0, age_s=0.05, station="liar.1"), now_s + 0.05)
    (boat,) = model.view(20.2).targets
    assert boat.at_m == pytest.approx((50.0, 0.6 * 49 + 3.0 * 0.5), abs=0.2)
    assert boat.age_s == pytest.approx(0.5)
    assert (boat.teller, boat.up_m, boat.fresh) == ("boat.1", 4.0, True)
    (boat,) = model.view(40.0).targets
    assert not boat.fresh
    assert boat.at_m[1] < 0.6 * 49 + 3.0 * 1.6


@pytest.mark.parametrize("ordered", [False, True])
def test_how_far_a_formation_is_off_its_place_about_a_target(ordered: bool) -> None:
    """6 m behind the boat, by the mission or by an order: with its centre 8 m behind and 1 m to
    the right it is 5 ** 0.5 m off. While another step is flown, or nothing is heard of the boat, it
    is off by nothing that is known."""
    follow = FollowStep("boat", (-6.0, 0.0), True, 5.0, 60.0, 90.0)
    (group,) = PLAN.groups
    steps = (*group.steps[:2], follow, *group.steps[2:])
    plan = replace(PLAN, targets=(BOAT,), groups=(replace(group, steps=steps),))
    order = Command("f1", "follow", (), 20.0, step=follow)
    model = Model(plan)
    model.fold(order, 20.0)
    flown = {"step": 4, "override": order.tag} if ordered else {"step": 3}
    for k in range(50):
        model.fold(_boat_word(plan, 0.6 * k), 10.2 + 0.2 * k)
    seqs = itertools.count(1)
    north, east = 50.0 - 1.0, 0.6 * 49 + 3.0 * 0.1 - 8.0

    def off_m(now_s: float, **changes: object) -> float | None:
        seq = next(seqs)
        for k, agent in enumerate(plan.agents):
            place = (north + 5 * HEXAGON[k][0], east + 5 * HEXAGON[k][1], -10.0)
            state = state_of(plan, agent.id, now_s, seq, position_ned_m=place, **changes)
            model.fold(state, now_s)
        (boat,) = model.view(now_s).targets
        return boat.off_m

    assert off_m(20.0, **flown) == pytest.approx(5**0.5, abs=0.05)
    begun = StepResult("follow boat", StepOutcome.RUNNING, 18.5, None)
    model.fold(status_of(plan, 1, 20.0, step=3, steps=(begun,)), 20.0)
    (follow,) = model.view(20.5).follows
    assert (follow.target, follow.agents) == ("boat", (1, 2, 3, 4, 5, 6))
    assert follow.for_s == pytest.approx(0.5 if ordered else 2.0)
    assert off_m(20.05, step=4) is None
    assert model.view(20.1).follows == ()
    assert off_m(30.0, **flown) is None


AT_RIDGE = {**dict.fromkeys(SCOUTS, (5, True)), **dict.fromkeys(SWEEPERS, (4, False))}
"""The scouts wait at the ridge for the sweepers."""
SPLIT = {**AT_RIDGE, **dict.fromkeys(REST, (3, True))}


def test_each_group_that_flies_has_its_step_and_those_that_it_waits_for() -> None:
    """Since its first agent was done: at a barrier for the group that has it on its way, at the
    join for all others; a group that flies waits for none."""
    scouts, sweepers, rest = grouped_model(SPLIT).view(61.0).groups
    assert (scouts.name, scouts.step, scouts.step_name) == ("scouts", 5, "barrier ridge")
    assert (scouts.agents, scouts.waits_for) == (SCOUTS, SWEEPERS)
    assert scouts.waits_s == pytest.approx(4.0 + 1.0)
    assert (sweepers.name, sweepers.step, sweepers.agents) == ("sweepers", 4, SWEEPERS)
    assert (sweepers.waits_for, sweepers.waits_s) == ((), None)
    assert (rest.agents, rest.waits_for) == (REST, (*SCOUTS, *SWEEPERS))
    assert rest.waits_s == pytest.approx(12.0 + 1.0)


def test_one_that_left_is_in_no_group_and_a_silent_one_is_named() -> None:
    model = grouped_model(SPLIT)
    plan = groups_mission().plan
    model.fold(state_of(plan, 2, 60.05, 2, step=5, left="land", phase=Phase.LAND), 60.05)
    for agent in (1, *SWEEPERS, *REST):
        step, done = SPLIT[agent]
        model.fold(state_of(plan, agent, 63.0, 2, step=step, done=done), 63.0)
    view = model.view(60.0 + plan.policies.agent_lost_after_s + 1.0)
    scouts, *_ = view.groups
    assert (scouts.agents, scouts.silent) == ((1, 3, 4), (3, 4))
    assert view.group_now(2) is None
    assert view.group_now(1) == scouts
    assert view.beside((1,)) == (*SWEEPERS, *REST)
    assert view.whom((1, 3, 4, 5)) == "scouts, agent 5"
    assert view.whom((1, 3)) == "agents 1, 3"


def test_before_anything_is_heard_the_whole_swarm_prepares() -> None:
    (group,) = Model(groups_mission().plan).view(0.0).groups
    assert (group.name, group.step, len(group.agents)) == ("all", 0, 12)
    assert (group.waits_for, group.waits_s) == ((), None)


def test_an_order_to_one_group_changes_no_other_ones_shape() -> None:
    """The scouts fly an ordered shape, in which each has its own slot; the sweepers' slots are
    still those of their roles."""
    plan = groups_mission().plan
    model = grouped_model(dict.fromkeys(SCOUTS, (4, False)) | dict.fromkeys(SWEEPERS, (4, False)))
    before = {agent.id: agent.target_m for agent in model.view(60.0).agents}
    shape = next(shape for shape in plan.shapes if (shape.name, len(shape.slots)) == ("line", 4))
    form = FormStep("line", shape.slots, 0.5, 5.0, 120.0)
    order = Command("f1", "form", SCOUTS, 60.0, step=form)
    model.fold(order, 60.0)
    for agent in SCOUTS:
        model.fold(state_of(plan, agent, 60.05, 2, step=4, override=order.tag), 60.05)
    after = {agent.id: agent.target_m for agent in model.view(60.1).agents}
    assert all(after[agent] == before[agent] for agent in SWEEPERS)
    assert all(after[agent] != before[agent] for agent in SCOUTS)


def test_homes_are_where_agents_stood_before_they_took_off() -> None:
    """Of one that is heard in the air alone none knows where it stood."""
    model = Model(PLAN)
    ground = {"phase": Phase.PREPARE, "step": 0, "airborne": False}
    for agent in (2, 3):
        model.fold(state_of(PLAN, agent, 5.0, 1, **ground), 5.0)
    for agent in (1, 2, 3):
        model.fold(state_of(PLAN, agent, 30.0, 2), 30.0)
    assert [*model.view(30.0).histories.homes] == [2, 3]
