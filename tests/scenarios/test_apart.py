"""Some agents alone: sent to a place while the others go on without them, and back among them."""

from __future__ import annotations

import cmath
import itertools
import math
from functools import cache

import pytest

from swarm_ctl.core.law.formation import formation_error
from swarm_ctl.core.model.messages import Outcome, Phase
from swarm_ctl.core.model.steps.goto import GotoStep
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from tests.on_demand import on_demand
from tests.scenarios.swarm import VirtualSwarm, assert_arrives, at_step, flown_once, landing_fast

TEXT = """\
version: 1
name: apart
origin: {lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}
lengths: metres
tick_s: 0.1
law: {r: 40, r_out: 7.5, r_in: 2.5}
policies: {left_by_order: land}
agents:
  - {id: 1, start: [0, 0]}
  - {id: 2, start: [0, 10]}
  - {id: 3, start: [10, 0]}
  - {id: 4, start: [10, 10]}
shapes:
  block: {kind: grid, spacing: 10, columns: 2}
  row: {kind: line, spacing: 9}
steps:
  - takeoff: {height_m: 4}
  - form: {shape: block, settle_s: 1}
  - hold: {duration_s: 16}
  - form: {shape: row, settle_s: 1}
  - hold: {duration_s: 12}
  - return
"""
HOLD, ROW, LAST = 3, 4, 6
PLACE = (-16.0, -12.0)


@cache
def mission() -> LoadedMission:
    return loads(TEXT)


def sent(*agents: int) -> VirtualSwarm:
    """A swarm that holds, of which these agents are sent away, side by side."""
    swarm = at_step(mission(), HOLD)
    places = tuple((i, (PLACE[0], PLACE[1] - 10.0 * k)) for k, i in enumerate(agents))
    swarm.command("goto", agents, step=GotoStep(places, 4.0, 1e9))
    return swarm


def step(swarm: VirtualSwarm, agent: int) -> int:
    """0 until it has told of one."""
    status = swarm.members[agent].status
    return status.step if status is not None else 0


def row_error_m(swarm: VirtualSwarm, *ids: int) -> float:
    group, at = swarm.plan.groups[0], swarm.positions()
    form = group.steps[ROW - 1].new_shape
    assert form is not None
    unit = swarm.plan.unit_m
    slots = [(n * unit, e * unit) for n, e in form.slots]
    roles = {i: swarm.members[i].status.roles for i in ids}  # type: ignore[union-attr]
    of = {i: roles[i][-1][1] if roles[i] else group.ids.index(i) for i in ids}
    return formation_error([at[i] for i in ids], [slots[of[i]] for i in ids])


def test_one_is_sent_away_and_the_others_go_on_without_it() -> None:
    """They wait for it in no step, whatever `left_by_order` says, and leave its slot free; by
    `resume` it comes back to that, and all return."""
    swarm = sent(1)
    swarm.wait(lambda s: math.dist(s.positions()[1], PLACE) < 1.0)
    swarm.wait(lambda s: step(s, 2) == ROW + 1)
    assert step(swarm, 1) == HOLD
    assert row_error_m(swarm, 2, 3, 4) < 0.5
    assert math.dist(swarm.positions()[1], PLACE) < 1.0
    swarm.command("resume", (1,), name="c2")
    swarm.run(10.0)
    assert step(swarm, 1) == step(swarm, 2)
    assert row_error_m(swarm, 1, 2, 3, 4) < 1.0
    assert_arrives(swarm)


def test_two_that_are_sent_away_keep_apart_and_come_home_with_the_others() -> None:
    """Nobody calls them back: as the others return, they do."""
    swarm = sent(2, 4)
    swarm.run(18.0)
    at = swarm.positions()
    assert math.dist(at[2], PLACE) < 1.0
    assert math.dist(at[4], (PLACE[0], PLACE[1] - 10.0)) < 1.0
    swarm.fly()
    assert set(swarm.outcomes().values()) == {Outcome.COMPLETED}
    assert swarm.closest_m > 2.5
    at = swarm.positions()
    for agent in swarm.plan.agents:
        start = (agent.start[0] * swarm.plan.unit_m, agent.start[1] * swarm.plan.unit_m)
        assert math.dist(at[agent.id], start) < 1.0


def test_it_is_refused_where_it_can_not_be_done() -> None:
    """For all, outside the fence, too fast, to an agent without a place: none moves."""
    swarm = at_step(mission(), HOLD)
    whole = (1, 2, 3, 4)
    for agents, where, speed in (
        (whole, PLACE, 4.0),
        ((1,), (4000.0, 0.0), 4.0),
        ((1,), PLACE, 90.0),
        ((1,), (math.nan, 0.0), 4.0),
    ):
        places = tuple((i, where) for i in agents)
        swarm.command(
            "goto", agents, name=f"c{speed}{where}{len(agents)}", step=GotoStep(places, speed, 1e9)
        )
    swarm.command("goto", (3,), name="none", step=GotoStep(((1, PLACE),), 4.0, 1e9))
    swarm.run(6.0)
    assert swarm.phases() == {Phase.FLY}
    assert swarm.in_step(HOLD)
    assert math.dist(swarm.positions()[1], PLACE) > 18.0


def test_the_last_that_flies_with_the_others_is_waited_for_by_none() -> None:
    """All but one are sent away: that one goes on alone, and all come home with it."""
    swarm = sent(1, 2, 3)
    swarm.wait(lambda s: step(s, 4) == LAST)
    swarm.fly()
    assert set(swarm.outcomes().values()) == {Outcome.COMPLETED}
    assert swarm.closest_m > 2.5


# --- one that waits on the ground ---


@cache
def with_one_waiting() -> LoadedMission:
    return loads(TEXT.replace("start: [10, 10]}", "start: [10, 10], waits: true}"))


@flown_once
def three_hold() -> VirtualSwarm:
    """Three hold the shape, and the fourth waits on the ground."""
    swarm = landing_fast(VirtualSwarm(with_one_waiting()))
    swarm.wait(lambda s: step(s, 1) == HOLD)
    return swarm


def test_one_that_waits_is_launched_and_joins_the_others() -> None:
    """It stays on the ground while the others form without it, is refused before they fly, takes
    off by `launch`, and is in its slot within 15 s of being up; all return."""
    swarm = three_hold()
    assert swarm.members[4].status is not None
    assert swarm.members[4].status.reason == "waits to be launched"
    swarm.command("launch", (4,))
    swarm.wait(lambda s: step(s, 4) == step(s, 1))
    up_s = swarm.now
    swarm.wait(lambda s: step(s, 1) == ROW + 1)
    assert swarm.now - up_s < 40.0
    assert row_error_m(swarm, 1, 2, 3, 4) < 0.5
    assert_arrives(swarm)


def test_one_that_is_never_launched_ends_with_the_others() -> None:
    """They complete without it, its slot free; it has not moved, and the mission is completed."""
    swarm = three_hold()
    before = swarm.positions()[4]
    swarm.fly()
    assert set(swarm.outcomes().values()) == {Outcome.COMPLETED}
    assert math.dist(swarm.positions()[4], before) < 1.0


def test_no_one_is_launched_before_or_twice_or_that_does_not_wait() -> None:
    swarm = VirtualSwarm(with_one_waiting())
    swarm.run(1.0)
    swarm.command("launch", (4,), name="early")
    swarm.command("launch", (1,), name="none")
    swarm.wait(lambda s: step(s, 1) == 2)
    assert step(swarm, 4) == 0


# --- a shape that closes its gaps ---


@cache
def closing() -> LoadedMission:
    """Six in a ring, which closes; then it moves."""
    agents = "".join(
        f"  - {{id: {i}, start: [{10 * (i // 5)}, {10 * (i % 4)}]}}\n" for i in range(1, 7)
    )
    text = (
        TEXT.partition("agents:")[0]
        + f"agents:\n{agents}"
        + """\
shapes:
  ring: {kind: ring, side: 9}
steps:
  - takeoff: {height_m: 4}
  - form: {shape: ring, settle_s: 1, on_gap: close}
  - hold: {duration_s: 42}
  - move: {by: [20, 0], speed_mps: 3}
  - land
"""
    )
    return loads(text.replace("left_by_order: land", "left_by_order: continue"))


def ring_error_m(swarm: VirtualSwarm, ids: tuple[int, ...]) -> float:
    """By truth: of a regular ring of so many, in whatever order they fly in it."""
    at = [complex(*swarm.positions()[i]) for i in ids]
    centre = sum(at) / len(at)
    form = swarm.plan.groups[0].steps[1].new_shape
    assert form is not None
    slots = form.slots if len(ids) == 6 else form.closed[5 - len(ids)]
    radius_m = abs(complex(*slots[0]) - sum(complex(*s) for s in slots) / len(slots))
    radius_m *= swarm.plan.unit_m
    turns = sorted(cmath.phase(z - centre) for z in at)
    turns.append(turns[0] + 2 * math.pi)
    even = [abs(b - a - 2 * math.pi / len(at)) * radius_m for a, b in itertools.pairwise(turns)]
    return max(*even, *(abs(abs(z - centre) - radius_m) for z in at))


@pytest.mark.parametrize("how", ["sent away", on_demand("landed")])
def test_a_third_leaves_and_the_ring_stands_again_within_15_s(how: str) -> None:
    """Two of six are sent away, or landed: four form the smaller ring; where they come back, it is
    of six again within 15 s of being near, and no pair comes under r_in."""
    swarm = at_step(closing(), HOLD)
    swarm.run(1.0)
    gone, left = (3, 6), (1, 2, 4, 5)
    if how == "landed":
        swarm.command("land", gone)
        swarm.wait(lambda s: set(gone) <= set(s.outcomes()))
    else:
        places = ((3, (-25.0, 0.0)), (6, (-25.0, 15.0)))
        swarm.command("goto", gone, step=GotoStep(places, 4.0, 1e9))
    swarm.run(15.0)
    assert ring_error_m(swarm, left) < 1.0
    if how == "sent away":
        swarm.command("resume", gone, name="back")
        swarm.run(15.0 + 40.0 / 4.0)
        assert ring_error_m(swarm, (1, 2, 3, 4, 5, 6)) < 1.0
    swarm.wait(lambda s: all(step(s, i) == HOLD + 1 for i in left))
    assert swarm.closest_m > 2.5


# --- back in the middle, and left behind ---


@cache
def moving() -> LoadedMission:
    """Four in a block, which flies north by two legs."""
    head = TEXT.partition("  - hold: {duration_s: 16}")[0]
    return loads(f"{head}  - move: {{along: [[26, 5], [52, 5]], speed_mps: 2}}\n  - land\n")


@pytest.mark.parametrize("agent", [1, on_demand(4)])
def test_one_comes_back_to_the_others_where_they_are_in_their_move(agent: int) -> None:
    """Also the lowest id, by whose frame all fly: it takes the others' place and leg, and leads
    none of them back to where it left them."""
    swarm = at_step(moving(), HOLD)
    swarm.run(3.0)
    swarm.command("goto", (agent,), step=GotoStep(((agent, (-10.0, -10.0)),), 4.0, 1e9))
    swarm.run(15.0)
    others = [i for i in (1, 2, 3, 4) if i != agent]
    furthest_m = {i: swarm.positions()[i][0] for i in others}
    assert min(furthest_m.values()) > 26.0
    swarm.command("resume", (agent,), name="c2")
    while swarm.members[2].status.step == HOLD:  # type: ignore[union-attr]
        swarm.tick()
        for i, (north_m, _) in swarm.positions().items():
            if i in others:
                assert north_m > furthest_m[i] - 4.0
                furthest_m[i] = max(furthest_m[i], north_m)
    assert_arrives(swarm)


def test_one_that_is_away_stays_where_an_order_to_hold_finds_it() -> None:
    """It does not fly back to its slot in order to hold there."""
    swarm = sent(1)
    swarm.run(12.0)
    swarm.command("hold", (1,), name="c2")
    swarm.run(5.0)
    assert math.dist(swarm.positions()[1], PLACE) < 1.5
    swarm.command("resume", (1,), name="c3")
    assert_arrives(swarm)


def test_one_that_is_away_flies_on_when_none_of_the_others_does() -> None:
    """They are landed by an order, by which it has to do nothing; then nobody would call it."""
    text = TEXT.replace("left_by_order: land", "left_by_order: continue")
    swarm = at_step(loads(text), HOLD)
    swarm.command("goto", (1,), step=GotoStep(((1, PLACE),), 4.0, 1e9))
    swarm.run(5.0)
    swarm.command("land", (2, 3, 4), name="c2")
    swarm.fly(300.0)
    assert swarm.outcomes()[1] == Outcome.COMPLETED
    assert swarm.all_down


# --- under the others ---


@cache
def over_one_waiting() -> LoadedMission:
    """Three move until one of them is over the fourth, which waits."""
    text = TEXT.replace("start: [10, 10]}", "start: [10, 10], waits: true}")
    text = text.replace("height_m: 4", "height_m: 6")
    return loads(text.replace("hold: {duration_s: 16}", "move: {by: [10, 0], speed_mps: 3}"))


def test_others_fly_over_one_that_waits_and_make_room_for_its_climb() -> None:
    """It stands in nobody's way; launched, it waits until none is over it."""
    swarm = landing_fast(VirtualSwarm(over_one_waiting()))
    swarm.wait(lambda s: step(s, 1) == ROW)
    assert math.dist(swarm.positions()[2], swarm.positions()[4]) < 1.0
    swarm.command("launch", (4,))
    swarm.wait(lambda s: step(s, 4) == step(s, 1))
    assert_arrives(swarm)
