"""A swarm that parts into groups and is one again: each flies its own steps, waits for none of the
others but where they meet, and for no one for ever."""

from __future__ import annotations

from functools import cache

import pytest

from swarm_ctl.core.law.formation import formation_error
from swarm_ctl.core.model.messages import AgentStatus, Outcome, StepOutcome
from swarm_ctl.core.model.steps.goto import GotoStep
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from tests.on_demand import on_demand
from tests.scenarios.swarm import VirtualSwarm, assert_arrives, at_step

HEAD = """\
version: 1
name: parted
origin: {lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}
lengths: metres
tick_s: 0.1
law: {r: 40, r_out: 7.5, r_in: 2.5}
agents:
  - {id: 1, start: [0, 0]}
  - {id: 2, start: [0, 10]}
  - {id: 3, start: [10, 0]}
  - {id: 4, start: [10, 10]}
  - {id: 5, start: [20, 0]}
  - {id: 6, start: [20, 10]}
groups: {west: [1, 3], east: [2, 4], one: [5]}
shapes:
  block: {kind: grid, spacing: 10, columns: 2}
  row: {kind: line, spacing: 9}
policies: {agent_lost: POLICY}
steps:
  - takeoff: {height_m: 4}
  - form: {shape: block, settle_s: 1}
"""
MEET = """\
  - split:
      west:
        - form: {shape: row, settle_s: 1}
        - move: {by: [0, -20], speed_mps: 4, settle_s: 1}
        - barrier: {name: ridge}
        - move: {by: [15, 0], speed_mps: 4, settle_s: 1}
      east:
        - move: {by: [0, 12], speed_mps: 4, settle_s: 1}
        - hold: {duration_s: 6}
        - barrier: {name: ridge}
  - form: {shape: row, settle_s: 1}
  - land
"""
HOME = """\
  - split:
      west: [return]
      one:
        - hold: {duration_s: 4}
  - form: {shape: row, settle_s: 1}
  - move: {by: [20, 0], speed_mps: 4}
  - land
"""
FORM, SPLIT = 2, 3
WEST, EAST, REST = (1, 3), (2, 4), (5, 6)
ALL = (1, 2, 3, 4, 5, 6)


@cache
def parted(steps: str = MEET, policy: str = "land") -> LoadedMission:
    return loads(HEAD.replace("POLICY", policy) + steps)


def status(swarm: VirtualSwarm, agent: int) -> AgentStatus:
    found = swarm.members[agent].status
    assert found is not None
    return found


def began_s(swarm: VirtualSwarm, agent: int, step: int) -> float:
    return status(swarm, agent).steps[step].start_s


def name(swarm: VirtualSwarm, agent: int) -> str:
    number = status(swarm, agent).step
    return swarm.plan.group_of(agent, number).step_name(number)


def shape_error_m(swarm: VirtualSwarm, ids: tuple[int, ...] = ALL) -> float:
    """Of the last shape."""
    at, group = swarm.positions(), swarm.plan.groups[-1]
    form = next(step.new_shape for step in group.steps if step.new_shape is not None)
    slots = {i: form.slots[status_role(swarm, i)] for i in ids}
    metres = [(n * swarm.plan.unit_m, e * swarm.plan.unit_m) for n, e in slots.values()]
    return formation_error([at[i] for i in slots], metres)


def status_role(swarm: VirtualSwarm, agent: int) -> int:
    """Which slot of the last shape it flies to."""
    ids, since_s = swarm.plan.groups[-1].ids, swarm.plan.groups[-1].before + 1
    began = began_s(swarm, agent, since_s)
    roles = [role for at_s, role in status(swarm, agent).roles if at_s >= began]
    return roles[-1] if roles else ids.index(agent)


def test_a_group_goes_on_when_the_time_of_its_barrier_is_over() -> None:
    """It says without whom, tells the step as timed out, and flies its next one alone; at the end
    of the split it waits for the others, and the mission is completed."""
    late = MEET.replace("{name: ridge}", "{name: ridge, timeout_s: 8, on_timeout: continue}", 1)
    swarm = at_step(parted(late.replace("duration_s: 6", "duration_s: 30")), SPLIT)
    assert_arrives(swarm)
    for agent in WEST:
        waited = status(swarm, agent).steps[5]
        assert waited.result is StepOutcome.TIMEOUT
        assert waited.end_s == pytest.approx(waited.start_s + 8.0, abs=0.2)
        assert began_s(swarm, agent, 6) == waited.end_s < began_s(swarm, EAST[0], 5) - 5.0
    told = {(e.agent, e.text) for e in swarm.events if "time is over" in e.text}
    assert told == {
        (i, "barrier ridge: its time is over, goes on without agents 2, 4") for i in WEST
    }
    last = swarm.plan.groups[-1].before + 1
    assert min(began_s(swarm, i, last) for i in ALL) > began_s(swarm, EAST[0], 5)


def test_groups_meet_at_a_barrier_and_are_one_again() -> None:
    """Nobody passes the ridge before all of both groups are there, the rest waits for all; then all
    six form one row, dealt anew, and land."""
    swarm = at_step(parted(), SPLIT)
    swarm.wait(lambda s: name(s, 1) == "barrier ridge" or name(s, 2) == "barrier ridge")
    assert {name(swarm, i) for i in REST} == {"join 1"}
    last = swarm.plan.groups[-1].before + 1
    swarm.wait(lambda s: s.in_step(last + 1))
    there_s = max(began_s(swarm, 1, 5), began_s(swarm, 2, 5))
    assert min(began_s(swarm, i, 6) for i in (*WEST, *EAST)) >= there_s
    joined_s = max(began_s(swarm, i, last - 1) for i in WEST)
    assert min(began_s(swarm, i, last) for i in ALL) >= joined_s
    assert shape_error_m(swarm) < 0.5
    swarm.fly()
    assert set(swarm.outcomes().values()) == {Outcome.COMPLETED}
    assert swarm.closest_m > 2.5
    assert swarm.all_down


def test_a_loss_is_its_own_groups_until_the_others_wait_for_it() -> None:
    """By the policy `land` the mate of a dead agent lands at once; the other group flies its steps,
    and lands where it would have waited for those."""
    swarm = at_step(parted(), SPLIT)
    swarm.kill(1)
    swarm.wait(lambda s: 3 in s.outcomes())
    assert swarm.outcomes()[3] == Outcome.FAILED
    swarm.fly()
    assert {swarm.outcomes()[i] for i in (*EAST, *REST)} == {Outcome.FAILED}
    for agent in EAST:
        assert "ridge" in status(swarm, agent).steps[-1].name
        assert "agent 1" in status(swarm, agent).reason or "agent 3" in status(swarm, agent).reason
    assert swarm.closest_m > 2.5


def test_a_group_that_returns_is_waited_for_by_none() -> None:
    """It flies home and completes; the others go on as one, without its places."""
    swarm = at_step(parted(HOME), SPLIT)
    swarm.wait(lambda s: set(s.outcomes()) == set(WEST))
    assert {swarm.outcomes()[i] for i in WEST} == {Outcome.COMPLETED}
    swarm.fly()
    assert set(swarm.outcomes().values()) == {Outcome.COMPLETED}
    assert swarm.closest_m > 2.5
    at = swarm.positions()
    for agent in swarm.plan.agents:
        north, east = (x * swarm.plan.unit_m for x in agent.start)
        if agent.id in WEST:
            assert abs(at[agent.id][0] - north) + abs(at[agent.id][1] - east) < 1.0
    assert shape_error_m(swarm, (*EAST, *REST)) < 1.0


@pytest.mark.parametrize("agent", [3, on_demand(5)])
def test_an_agent_that_starts_again_comes_back_to_its_group(agent: int) -> None:
    """In the middle of a split, a member of a group of two and one of the rest."""
    swarm = at_step(parted(), SPLIT)
    swarm.run(3.0)
    swarm.kill(agent)
    swarm.run(1.0)
    swarm.restart(agent)
    swarm.run(4.0)
    assert status(swarm, agent).step >= SPLIT
    assert_arrives(swarm)


def test_one_alone_in_its_group_starts_again() -> None:
    """What the others do proves which step it is in."""
    swarm = at_step(parted(HOME), SPLIT)
    swarm.run(1.0)
    swarm.kill(5)
    swarm.run(1.0)
    swarm.restart(5)
    swarm.fly()
    assert swarm.outcomes()[5] == Outcome.COMPLETED
    assert swarm.closest_m > 2.5


def test_an_order_to_one_group_holds_that_group_alone() -> None:
    """The others fly on; at the barrier they wait for those that are held, and after `resume` all
    go on."""
    swarm = at_step(parted(), SPLIT)
    swarm.command("hold", WEST)
    swarm.wait(lambda s: name(s, 2) == "barrier ridge")
    assert {name(swarm, i) for i in WEST} == {"form row"}
    swarm.run(2.0)
    assert {name(swarm, i) for i in EAST} == {"barrier ridge"}
    swarm.command("resume", WEST, name="c2")
    assert_arrives(swarm)


def test_an_order_for_a_whole_group_forms_and_moves_it() -> None:
    """A shape of two for the group of two; for all it would have too few slots, and is refused."""
    swarm = at_step(parted(), SPLIT)
    form = next(s.new_shape for s in swarm.plan.groups[1].steps if s.new_shape is not None)
    swarm.wait(lambda s: name(s, 2) == "hold")
    swarm.command("form", EAST, step=form)
    swarm.run(9.0)
    at = swarm.positions()
    slots = [(n * swarm.plan.unit_m, e * swarm.plan.unit_m) for n, e in form.slots]
    assert formation_error([at[i] for i in EAST], slots) < 0.5
    swarm.command("resume", EAST, name="c2")
    assert_arrives(swarm)


def test_one_that_was_away_before_the_split_comes_back_into_its_group() -> None:
    """It is sent away while all are one, and joins the other one of its group."""
    swarm = at_step(parted(policy="continue"), FORM)
    swarm.command("goto", (1,), step=GotoStep(((1, (-30.0, -30.0)),), 4.0, 1e9))
    swarm.wait(lambda s: status(s, 3).step == SPLIT + 1)
    assert status(swarm, 1).step == FORM
    swarm.command("resume", (1,), name="c2")
    swarm.run(2.0)
    assert status(swarm, 1).step == SPLIT + 1
    assert_arrives(swarm)
