"""Orders to some agents concern them alone: they leave the formation, and the others do as
`policies.left_by_order` says."""

from __future__ import annotations

import math

import pytest

from swarm_ctl.core.model.messages import AgentStatus, Phase
from swarm_ctl.core.model.plan import Policy
from swarm_ctl.mission.compile.loader import LoadedMission
from tests.on_demand import on_demand
from tests.scenarios.swarm import VirtualSwarm, at_step
from tests.scenarios.test_steps import TAKEOFF, THIRD, quartet, shape_error_m

ORDERS = (on_demand("land"), "return", "kill")


def policy(left_by_order: Policy) -> str:
    return f"policies: {{left_by_order: {left_by_order}}}\n"


def in_third(mission: LoadedMission) -> VirtualSwarm:
    swarm = at_step(mission, THIRD)
    swarm.run(2)
    return swarm


def status(swarm: VirtualSwarm, agent: int) -> AgentStatus:
    found = swarm.members[agent].status
    assert found is not None
    return found


def assert_others_complete(swarm: VirtualSwarm, left: tuple[int, ...] = (3,)) -> None:
    swarm.fly(900)
    expected = {i: "aborted" if i in left else "completed" for i in swarm.members}
    assert swarm.outcomes() == expected
    assert swarm.all_down
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m


@pytest.mark.parametrize("kind", [on_demand("land"), "kill"])
def test_an_order_before_the_first_position_is_told_as_well(kind: str) -> None:
    """The others do not wait for an agent that has not said yet where its vehicle is."""
    swarm = VirtualSwarm(quartet("land"))
    swarm.command(kind, agents=(2,))
    swarm.run(1)
    swarm.wait(lambda s: all(status(s, i).step == TAKEOFF for i in (1, 3, 4)), 20)
    assert_others_complete(swarm, left=(2,))


@pytest.mark.parametrize("kind", ORDERS)
def test_the_others_go_on(kind: str) -> None:
    """In shape, through all further steps; the one that left says by which order, and when."""
    swarm = in_third(quartet("hold: {duration_s: 14}", "move: {by: [12, 0]}", "land"))
    swarm.command(kind, agents=(3,))
    ordered_s = swarm.now
    swarm.run(2)
    left = status(swarm, 3).left
    assert left is not None
    assert (left.order, round(left.time_s - ordered_s, 1)) == (kind, 0.1)
    swarm.wait(lambda s: all(status(s, i).step == THIRD + 1 for i in (1, 2, 4)))
    while status(swarm, 1).step == THIRD + 1:
        swarm.tick()
        # it waits for its turn to return beside them, and they keep clear of it
        assert shape_error_m(swarm, THIRD, live=(1, 2, 4)) < 1.5
    assert_others_complete(swarm)
    assert not [e.text for e in swarm.events if e.agent != 3 and e.level != "info"]


@pytest.mark.parametrize(("first", "second"), [on_demand("land", "kill"), ("return", "land")])
def test_another_order_to_one_that_has_left_is_not_the_others_concern(
    first: str, second: str
) -> None:
    """It has left all the time: it has not broken the mission off in between."""
    swarm = in_third(quartet("hold: {duration_s: 5}", "land"))
    swarm.command(first, agents=(3,))
    swarm.run(2)
    swarm.command(second, agents=(3,), name="second")
    assert_others_complete(swarm)


def test_the_others_hold_until_resume() -> None:
    """By policy: they stop at once, refuse `next`, and go on without it by `resume` alone."""
    mission = quartet("move: {by: [20, 0], timeout_s: 16}", "land", head=policy(Policy.HOLD))
    swarm = in_third(mission)
    swarm.command("land", agents=(3,))
    swarm.run(5)
    before = swarm.positions()
    swarm.run(16)  # longer than the step may take
    assert {status(swarm, i).phase for i in (1, 2, 4)} == {Phase.HOLD}
    assert all(math.dist(before[i], swarm.positions()[i]) < 0.5 for i in (1, 2, 4))
    swarm.acks.clear()
    swarm.command("next", name="n")
    swarm.command("resume", agents=(1, 2, 4), name="r")
    swarm.run(0.2)
    refused = {ack.reason for ack in swarm.acks if ack.command == "n" and ack.agent != 3}
    assert refused == {
        f"agent {i} is held by a policy; allowed now: resume, land, return, kill" for i in (1, 2, 4)
    }
    assert_others_complete(swarm)


@pytest.mark.parametrize("policy_of", [on_demand(Policy.LAND), Policy.RETURN])
def test_the_others_leave_as_well_by_policy(policy_of: Policy) -> None:
    """Aborted by the operator, not failed."""
    swarm = in_third(quartet("hold: {duration_s: 60}", "land", head=policy(policy_of)))
    swarm.command("land", agents=(3,))
    swarm.fly(900)
    assert set(swarm.outcomes().values()) == {"aborted"}
    assert status(swarm, 1).reason == (
        f"agent 3 was landed by the operator (policies.left_by_order: {policy_of})"
    )
    assert swarm.all_down


def test_an_order_to_all_leaves_no_agent_behind() -> None:
    """Whether no agent or every agent is named: none says that it has left the others."""
    for agents in ((), (1, 2, 3, 4)):
        swarm = in_third(quartet("hold: {duration_s: 15}", "land"))
        swarm.command("land", agents=agents)
        swarm.fly(900)
        assert set(swarm.outcomes().values()) == {"aborted"}
        assert all(status(swarm, i).left is None for i in swarm.members)


def test_an_agent_that_is_landed_before_take_off_is_flown_without() -> None:
    """It stays where it stands, and the others take off and form."""
    swarm = VirtualSwarm(quartet("land"))
    swarm.run(1)
    swarm.command("land", agents=(2,))
    assert_others_complete(swarm, left=(2,))
    assert math.dist(swarm.positions()[2], (0, 9)) < 0.5


def test_an_agent_that_left_and_fell_silent_is_not_lost() -> None:
    """Its process dies on the way back; the others fly on, and clear of its vehicle."""
    swarm = in_third(quartet("hold: {duration_s: 15}", "land"))
    swarm.command("return", agents=(3,))
    swarm.run(4)
    swarm.kill(3)
    swarm.fly(900)
    assert swarm.outcomes() == dict.fromkeys((1, 2, 4), "completed")
    assert swarm.closest_m > swarm.plan.law.r_in


@pytest.mark.parametrize("kind", ["kill", "hold", on_demand("land"), on_demand("return")])
def test_the_leader_of_a_move_leaves(kind: str) -> None:
    """The formation goes on to its end by another one's frame; a held leader stops it for the
    policy's time alone."""
    head = "policies: {override_pause_s: 5}\n"
    swarm = in_third(quartet("move: {by: [20, 0]}", "hold: {duration_s: 5}", "land", head=head))
    begun = swarm.centre()
    swarm.command(kind, agents=(1,))
    swarm.wait(lambda s: all(status(s, i).step == THIRD + 1 for i in (2, 3, 4)), swarm.now + 60)
    moved = [swarm.positions()[i][0] for i in (2, 3, 4)]
    assert sum(moved) / 3 > begun[0] + 15


def test_held_agents_stand_while_another_one_flies_on() -> None:
    """The mission goes on after the policy's pause for the agent that was not held; it pulls none
    of the held ones along."""
    head = "policies: {override_pause_s: 5}\n"
    swarm = in_third(quartet("move: {by: [20, 0]}", "hold: {duration_s: 5}", "land", head=head))
    swarm.command("hold", agents=(1, 2, 3))
    swarm.run(1)
    places = swarm.positions()
    swarm.wait(lambda s: status(s, 4).step == THIRD + 1, swarm.now + 60)
    moved = {i: math.dist(place, places[i]) for i, place in swarm.positions().items()}
    assert moved.pop(4) > 16.0
    assert max(moved.values()) < 1.0


def test_a_formation_may_stand_over_a_vehicle_that_has_landed_and_lands_beside_it() -> None:
    """On the ground it is in no agent's way; no vehicle comes down on it."""
    swarm = in_third(quartet("hold: {duration_s: 15}", "rotate: {angle_deg: 90}", "land"))
    swarm.command("land", agents=(3,))
    swarm.wait(lambda s: all(status(s, i).step == THIRD + 2 for i in (1, 2, 4)))
    place = swarm.positions()[3]
    over = min(math.dist(swarm.positions()[i], place) for i in (1, 2, 4))
    assert over < 1.0
    swarm.fly(900)
    apart = min(math.dist(swarm.positions()[i], place) for i in (1, 2, 4))
    assert apart > swarm.plan.law.r_in
    assert [swarm.outcomes()[i] for i in (1, 2, 4)] == ["completed"] * 3
