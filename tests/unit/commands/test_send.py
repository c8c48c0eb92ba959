"""Commands on their way: repeated until every agent that is meant has answered, or for ten
seconds."""

from __future__ import annotations

import pytest

from swarm_ctl.commands.send import GIVE_UP_WALL_S, REPEAT_WALL_S, CommandSender
from swarm_ctl.core.model.messages import Ack, Command


class Mesh:
    """Takes what is published; a speed-up of 2."""

    def __init__(self) -> None:
        self.published: list[Command] = []
        self.sender = CommandSender(self.published.append, (1, 2, 3), 2.0)


@pytest.fixture
def mesh() -> Mesh:
    return Mesh()


def test_a_command_leaves_at_once_and_is_repeated(mesh: Mesh) -> None:
    """Every half second of the wall clock."""
    mesh.sender.send(Command("c", "hold", (), 0.0), 10.0)
    assert len(mesh.published) == 1
    for k in range(1, 41):
        mesh.sender.turn(10.0 + 0.1 * k)
    assert len(mesh.published) == 1 + 4 / (REPEAT_WALL_S * 2.0)


def test_it_is_over_with_the_last_answer(mesh: Mesh) -> None:
    sent = mesh.sender.send(Command("c", "hold", (), 0.0), 0.0)
    for agent in (1, 3):
        mesh.sender.hear(Ack(agent, "c", True, ""))
    assert mesh.sender.turn(5.0) == []
    assert sent.silent == (2,)
    assert not sent.accepted
    mesh.sender.hear(Ack(2, "c", True, ""))
    assert mesh.sender.turn(5.1) == [sent]
    assert sent.accepted
    before = len(mesh.published)
    assert mesh.sender.turn(50.0) == []
    assert len(mesh.published) == before


def test_a_refusal_is_an_answer(mesh: Mesh) -> None:
    sent = mesh.sender.send(Command("c", "resume", (2,), 0.0), 0.0)
    mesh.sender.hear(Ack(2, "c", False, "not held"))
    mesh.sender.turn(0.1)
    assert sent.over
    assert sent.reasons == {2: "not held"}
    assert not sent.accepted


def test_silence_ends_it(mesh: Mesh) -> None:
    sent = mesh.sender.send(Command("c", "hold", (), 0.0), 0.0)
    mesh.sender.turn(GIVE_UP_WALL_S * 2.0)
    assert not sent.over
    mesh.sender.turn(GIVE_UP_WALL_S * 2.0 + 0.1)
    assert sent.over
    assert sent.silent == (1, 2, 3)
