"""An operator's commands on the virtual clock: acknowledged by each agent, idempotent, refused
where they can't be."""

from __future__ import annotations

import math
from typing import Any

import pytest

from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.move import MoveStep
from tests.on_demand import on_demand
from tests.scenarios.swarm import VirtualSwarm, assert_arrives, at_step
from tests.scenarios.test_steps import FORM, THIRD, quartet, shape_error_m

ROW = FormStep("row", ((0.0, 0.0), (0.0, 9.0), (0.0, 18.0), (0.0, 27.0)), 0.5, 2.0, 1e9)


def move_to(north: float, east: float, speed: float = 2.0) -> MoveStep:
    return MoveStep(((north, east),), speed, 0.5, 2.0, 1e9)


@pytest.fixture
def holding() -> VirtualSwarm:
    """Four agents in a square, two seconds into a hold of 12 s."""
    swarm = at_step(quartet("hold: {duration_s: 12}", "land"), THIRD)
    swarm.run(2)
    return swarm


def give(
    swarm: VirtualSwarm, kind: str, name: str = "", **more: Any
) -> list[tuple[int, bool, str]]:
    swarm.acks.clear()
    swarm.command(kind, name=name or f"{kind}-{swarm.now:.2f}", **more)
    swarm.run(0.2)
    return sorted((ack.agent, ack.accepted, ack.reason) for ack in swarm.acks)


def accepted(answers: list[tuple[int, bool, str]]) -> bool:
    return [answer[:2] for answer in answers] == [(i, True) for i in (1, 2, 3, 4)]


def test_hold_and_resume(holding: VirtualSwarm) -> None:
    """The step's time waits while the operator holds the swarm, and goes on after."""
    assert accepted(give(holding, "hold"))
    holding.run(16)
    assert holding.in_step(THIRD)
    assert accepted(give(holding, "resume"))
    begun = holding.now
    holding.wait(lambda s: s.in_step(THIRD + 1))
    assert 8 < holding.now - begun < 14
    assert_arrives(holding)


def test_hold_while_forming_stops_all() -> None:
    """No agent flies on towards its slot."""
    swarm = at_step(quartet("land"), FORM)
    swarm.run(2)
    assert accepted(give(swarm, "hold"))
    swarm.run(6)
    before = swarm.positions()
    swarm.run(8)
    assert all(math.dist(before[i], at) < 0.5 for i, at in swarm.positions().items())
    assert accepted(give(swarm, "resume"))
    assert_arrives(swarm)


def test_form_then_move_then_resume(holding: VirtualSwarm) -> None:
    """A commanded shape stands, goes where it is sent, and the mission goes on from there."""
    assert accepted(give(holding, "form", step=ROW, plan_hash=holding.plan.hash()))
    holding.run(14)
    assert accepted(give(holding, "move", step=move_to(20, 10), plan_hash=holding.plan.hash()))
    holding.run(20)
    assert math.dist(holding.centre(), (20, 10)) < 1.0
    at = holding.positions()
    assert max(abs((at[i][1] - at[1][1]) - 9 * (i - 1)) for i in at) < 1.0
    assert holding.in_step(THIRD)
    give(holding, "resume")
    assert_arrives(holding)


def test_next_ends_the_step_once(holding: VirtualSwarm) -> None:
    """Repeated and late copies of `next` for the same step do nothing more."""
    assert accepted(give(holding, "next", name="n", at_step=THIRD))
    holding.wait(lambda s: s.in_step(THIRD + 1))
    assert accepted(give(holding, "next", name="n", at_step=THIRD))
    status = holding.members[1].status
    assert status is not None
    assert [step.result for step in status.steps][-2:] == ["skipped", "running"]
    assert_arrives(holding)


def test_kill_stops_the_motors_at_once() -> None:
    """In the air, within a second, of either autopilot; `test_orders.py` has that the others go
    on."""
    entries = "{id: 1}, {id: 2}, {id: 3}, {id: 4, autopilot: px4}"
    mission = quartet("hold: {duration_s: 5}", "land", head=f"fleet: {{agents: [{entries}]}}\n")
    swarm = at_step(mission, THIRD)
    swarm.command("kill", agents=(3, 4))
    swarm.run(1.0)
    assert swarm.hub.world.armed() == [True, True, False, False]


def held_for_long(policy: str) -> VirtualSwarm:
    """Agent 2 is held in a step of 5 s, in which the others wait for it for 10 s at most."""
    policies = f"policies: {{left_by_order: {policy}, override_pause_s: 10}}\n"
    swarm = VirtualSwarm(
        quartet("hold: {duration_s: 5}", "move: {by: [10, 0]}", "land", head=policies)
    )
    swarm.wait(lambda s: s.in_step(THIRD))
    swarm.run(1)
    give(swarm, "hold", agents=(2,))
    swarm.run(9)
    assert swarm.in_step(THIRD)
    assert shape_error_m(swarm, FORM) < 1.0
    status = swarm.members[1].status
    assert status is not None
    assert status.reason == "waits for agent 2, held by a command: 10 s at most"
    swarm.run(3)
    return swarm


def test_one_agent_held_for_long_ends_the_mission_by_its_policy() -> None:
    """After the time of the policy the others land, and the held one with them."""
    swarm = held_for_long("land")
    said = [event.text for event in swarm.events]
    assert sum("land: a command has held agent 2 for 10 s" in text for text in said) == 3
    swarm.fly(900)
    assert swarm.all_down
    assert swarm.outcomes() == {1: "aborted", 2: "failed", 3: "aborted", 4: "aborted"}
    assert swarm.closest_m > swarm.plan.law.r_in


def test_a_mission_goes_on_without_an_agent_held_for_long_and_takes_it_in_again() -> None:
    """By policy `continue`; after `resume` the agent is in the others' step."""
    swarm = held_for_long("continue")
    swarm.wait(lambda s: all(status_step(s, i) == THIRD + 1 for i in (1, 3, 4)), swarm.now + 15)
    assert status_step(swarm, 2) == THIRD
    give(swarm, "resume", agents=(2,))
    swarm.wait(lambda s: s.in_step(THIRD + 1), swarm.now + 1)
    assert_arrives(swarm)


def status_step(swarm: VirtualSwarm, agent: int) -> int:
    status = swarm.members[agent].status
    return -1 if status is None else status.step


FAR: dict[str, dict[str, Any]] = {
    "hold": {},
    "land": {},
    "return": {},
    "move": {"step": move_to(30.0, 13.0)},
}


@pytest.mark.parametrize("order", [*FAR, "expel"])
@pytest.mark.parametrize(
    "step", ["land", on_demand("return"), on_demand("move: {to: [30, 13], speed_mps: 2}")]
)
def test_no_step_begins_under_an_order(order: str, step: str) -> None:
    """In the tick in which the step would begin. Of `expel`: on the agent that it is about."""
    last = ("land",) if step.startswith("move") else ()
    swarm = at_step(quartet("hold: {duration_s: 60}", step, *last), THIRD)
    swarm.command("next", name="next")
    swarm.command(order, name=order, **FAR.get(order, {"about": (2,)}))
    swarm.run(3.0)
    told = [m.status for i, m in swarm.members.items() if order != "expel" or i == 2]
    assert {status.step for status in told if status is not None} == {THIRD}
