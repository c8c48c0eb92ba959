"""The process beside an agent: it gets what the agent says and hears, and can't hold it up."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections.abc import Iterator
from typing import ClassVar

import pytest

from swarm_ctl.commands.parse import parse
from swarm_ctl.engine.companion import Companion, CompanionConfig, received
from swarm_ctl.engine.station import attachments
from swarm_ctl.engine.station.companion_process import show_agent
from swarm_ctl.errors import InputError
from swarm_ctl.extension import Answer, Extension, StationHandle
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryHub, MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.payloads import encode
from swarm_ctl.station.picture.view import SwarmView
from tests.unit.station.swarm import hexagon_plan, state_of

PLAN = hexagon_plan()


def config() -> CompanionConfig:
    return CompanionConfig(
        plan=PLAN, agent=3, epoch_s=time.monotonic(), speedup=1.0, stepped=False, attach=("any",)
    )


class Looking(Extension):
    """Keeps what it sees, and tries to order."""

    views: ClassVar[list[SwarmView]] = []
    answers: ClassVar[list[Answer]] = []
    agents: ClassVar[list[int | None]] = []

    def __init__(self, argument: str, station: StationHandle) -> None:
        self.agents.append(station.agent)
        station.order(parse("land", station.plan), self.answers.append)

    def take(self, view: SwarmView) -> None:
        self.views.append(view)


@pytest.fixture
def agent(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Companion, socket.socket]]:
    """Its side, and the other end, with no process there."""
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    monkeypatch.setattr("socket.socketpair", lambda *_: ends)
    monkeypatch.setattr("subprocess.Popen", lambda *_, **__: None)
    with ends[0], ends[1].dup() as other:
        other.setblocking(False)
        yield Companion(config()), other


def test_a_node_tells_what_it_says_and_what_it_believes(
    agent: tuple[Companion, socket.socket],
) -> None:
    """Nothing that it refuses, and all of a tick at its end."""
    beside, end = agent
    hub = MemoryHub(lambda: 1.0)
    own, peer = (Node(MemoryTransport(hub), PLAN.name, i) for i in (3, 4))
    own.listen(keys.STATE, agents=[1, 2, 3, 4])
    own.overheard = beside.take
    own.send(keys.STATE, state_of(PLAN, 3, 1.0))
    peer.send(keys.STATE, state_of(PLAN, 4, 1.0))
    peer.send(keys.STATE, state_of(PLAN, 2, 1.0))  # under the key of 4
    assert len(own.take(keys.STATE)) == 1
    assert not list(received(end))
    beside.send()
    assert [key for key, _ in received(end)] == [keys.STATE.key(PLAN.name, i) for i in (3, 4)]


def test_its_picture_is_the_agents_and_it_orders_nothing(
    agent: tuple[Companion, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its slot lies under the formation of those that the agent hears, far words among them."""
    beside, end = agent
    monkeypatch.setattr(attachments, "wanted", lambda word: ("any", Looking, ""))
    for kept in (Looking.views, Looking.answers, Looking.agents):
        kept.clear()
    told = [state_of(PLAN, i, 0.0, step=2) for i in (3, 4, 5)]
    for state, channel in zip(told, (keys.STATE, keys.STATE, keys.FAR), strict=True):
        beside.take(channel.key(PLAN.name, state.agent), encode(state))
    beside.send()
    until = time.monotonic() + 20.0

    def ended() -> bool:
        assert time.monotonic() < until
        return any(view.agents[4].state for view in Looking.views) and bool(Looking.answers)

    show_agent(config(), end, ended)
    view = Looking.views[-1]
    assert [each.id for each in view.agents if each.state] == [3, 4, 5]
    assert view.agents[2].target_m not in (None, told[0].position_ned_m[:2])
    assert Looking.agents == [3]
    (answer,) = Looking.answers
    assert isinstance(answer, InputError)
    assert str(answer) == "agent-3 may only watch; allowed: an operator's keys"


@pytest.mark.realtime
def test_one_that_hangs_or_dies_does_not_hold_up_the_agent() -> None:
    beside = Companion(config())
    try:
        os.kill(beside.process.pid, signal.SIGSTOP)
        begin = time.monotonic()
        for _ in range(2000):
            beside.take("swarm/hexagon/agent/3/state", bytes(200))
            beside.send()
        assert time.monotonic() - begin < 2.0
    finally:
        beside.process.kill()
        beside.process.wait()
    with beside._socket, pytest.raises(ConnectionError):
        beside.send()
