"""What an operator is told of an order."""

from __future__ import annotations

from dataclasses import replace

import pytest

from swarm_ctl.commands.answers import answers, others
from swarm_ctl.commands.send import SentCommand
from swarm_ctl.core.model.messages import Ack, Command
from swarm_ctl.core.model.plan import Plan, Policy
from tests.unit.core.builders import plan

THREE = plan()
"""Agents 1 to 3."""


def policy(left_by_order: Policy) -> Plan:
    return replace(THREE, policies=replace(THREE.policies, left_by_order=left_by_order))


def test_what_expel_does() -> None:
    """The others' part, and what they do from then on."""
    found = SentCommand(Command("c", "expel", (), 0.0, about=(3,)), (1, 2))
    found.acks = {i: Ack(i, "c", True, "") for i in (1, 2)}
    told = "agents 1-2: listen to agent 3 no more, and keep clear; agents 1-2 go on without it"
    assert list(answers(found, THREE)) == [f"{told} (policies.left_by_order)"]


def test_what_readmit_does() -> None:
    """That the one that it is about goes on is no news of the others."""
    found = SentCommand(Command("c", "readmit", (), 0.0, about=(3,)), (1, 2, 3))
    found.acks = {i: Ack(i, "c", True, "") for i in (1, 2, 3)}
    assert list(answers(found, THREE)) == ["agents 1-2: listen to agent 3 again"]


def sent(kind: str, agents: tuple[int, ...], refused: str = "") -> SentCommand:
    meant = agents or (1, 2, 3)
    found = SentCommand(Command("c", kind, agents, 0.0), meant)
    found.acks = {i: Ack(i, "c", not refused, refused.format(i)) for i in meant}
    return found


@pytest.mark.parametrize(
    ("kind", "agents", "told"),
    [
        ("land", (3,), "agent 3: landing; agents 1-2 go on without it (policies.left_by_order)"),
        (
            "return",
            (2, 3),
            "agents 2-3: flying home; agent 1 goes on without them (policies.left_by_order)",
        ),
        (
            "hold",
            (2,),
            (
                "agent 2: holding; agents 1, 3 wait for it 120 s at most, then go on without it"
                " (policies.override_pause_s, left_by_order)"
            ),
        ),
        ("next", (2,), "agent 2: accepted"),
        ("land", (), "agents 1-3: accepted"),
        ("kill", (1, 2, 3), "agents 1-3: accepted"),
    ],
)
def test_what_the_others_do(kind: str, agents: tuple[int, ...], told: str) -> None:
    assert list(answers(sent(kind, agents), THREE)) == [told]


@pytest.mark.parametrize(
    ("policy_of", "does"),
    [
        (Policy.HOLD, "hold until `resume`"),
        (Policy.LAND, "land, too"),
        (Policy.RETURN, "return, too"),
    ],
)
def test_as_the_mission_says(policy_of: Policy, does: str) -> None:
    told = others("land", [3], policy(policy_of))
    assert told == f"agents 1-2 {does} (policies.left_by_order)"


def test_agents_that_have_left_are_no_others() -> None:
    assert others("land", [3], THREE, left={2}).startswith("agent 1 goes on without it")
    assert others("land", [3], THREE, left={1, 2}) == ""


def test_a_refusal_says_nothing_of_the_others() -> None:
    """One line for a reason, without the agent's own name in it."""
    told = list(answers(sent("land", (2, 3), "agent {} is landing already"), THREE))
    assert told == ["agents 2-3: refused: landing already"]
