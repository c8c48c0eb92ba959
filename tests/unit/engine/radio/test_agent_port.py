"""At an agent's port of the link one sender is heard, of the link's own user."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarm_ctl.core.model.fleet import FleetAgent
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.engine.radio.link_process import AgentPort, owners
from swarm_ctl.engine.radio.switch import RadioRoute, Switch
from swarm_ctl.mavlink.wires import memory_wires
from tests.unit.engine.radio.test_switch import drained, heartbeat, setpoint

AGENT, VEHICLE = 250, 1
STRANGER = os.getuid() + 1


class Bench:
    """A link with one agent's port, the far end of its radio, and two programs of the machine."""

    def __init__(self, opened: contextlib.ExitStack) -> None:
        (self.port,) = free_ports(1, socket.SOCK_DGRAM)
        self.users: dict[int, int] | None = {}
        """By port, of the sockets that are another user's; None: the table can't be read."""
        self.wire = opened.enter_context(contextlib.closing(AgentPort(1, self.port, self.table)))
        near, self.radio = memory_wires()
        entry = FleetAgent(1, VEHICLE, "ardupilot", agent_sysid=AGENT)
        self.switch = Switch(near, [RadioRoute(entry, self.wire, 100.0)], "serial:/dev/x", 57600)
        self.agent, self.other = (opened.enter_context(self.program()) for _ in range(2))
        self.now = 0.0

    def program(self) -> socket.socket:
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.bind(("127.0.0.1", 0))
        return made

    def table(self) -> str:
        if self.users is None:
            raise FileNotFoundError
        mine = {self.port, *(each.getsockname()[1] for each in (self.agent, self.other))}
        users = dict.fromkeys(mine, os.getuid()) | self.users
        rows = (
            f"1: 0100007F:{port:04X} 00000000:0000 07 0:0 0:0 0 {user} 0 1 2 0 0"
            for port, user in users.items()
        )
        return "\n".join(["header", *rows])

    def passed(self, *said: tuple[socket.socket, bytes], after_s: float = 0.1) -> list[bytes]:
        """What reaches the radio of this."""
        self.now += after_s
        for program, data in said:
            program.sendto(data, ("127.0.0.1", self.port))
        self.switch.turn(self.now)
        for k in range(4):
            self.switch.turn(self.now + 0.02 * (k + 1))
        return drained(self.radio)


@pytest.fixture
def bench() -> Iterator[Bench]:
    with contextlib.ExitStack() as opened:
        yield Bench(opened)


def name(program: socket.socket) -> str:
    return f"127.0.0.1:{program.getsockname()[1]}"


def test_while_the_agent_speaks_no_other_sender_reaches_the_vehicle(bench: Bench) -> None:
    """Whatever it says: as the agent, or as ground control software. Both are named, once."""
    assert bench.passed((bench.agent, heartbeat(AGENT))) == [heartbeat(AGENT)]
    for _ in range(5):
        said = (bench.agent, setpoint(1)), (bench.other, setpoint(1, -9.0))
        assert bench.passed(*said, (bench.other, heartbeat(255))) == [setpoint(1)]
    (told,) = bench.wire.news()
    assert told == (
        f"agent 1's port {bench.port}: {name(bench.other)} is not heard: the agent speaks from"
        f" {name(bench.agent)}"
    )


def test_an_agent_that_was_silent_may_speak_from_elsewhere_and_that_is_told(bench: Bench) -> None:
    bench.passed((bench.agent, heartbeat(AGENT)))
    for _ in range(2):
        bench.passed(after_s=0.3)
    assert bench.passed((bench.other, setpoint(1))) == [setpoint(1)]
    (told,) = bench.wire.news()
    assert told == (
        f"agent 1's port {bench.port}: the agent speaks from {name(bench.other)} now; before, from"
        f" {name(bench.agent)}"
    )


def test_another_user_is_never_heard_though_it_speaks_first(bench: Bench) -> None:
    """Nor one whose socket is closed before anyone can look."""
    assert bench.users is not None
    bench.users[bench.other.getsockname()[1]] = STRANGER
    assert bench.passed((bench.other, heartbeat(AGENT))) == []
    (told,) = bench.wire.news()
    assert told.endswith(
        f"{name(bench.other)} is not heard: it is user {STRANGER}'s; allowed: user"
        f" {os.getuid()}, as the link's, and root"
    )
    with bench.program() as gone:
        assert bench.passed((gone, heartbeat(AGENT))) == []
    assert bench.passed((bench.agent, heartbeat(AGENT))) == [heartbeat(AGENT)]


def test_a_flood_of_ports_is_looked_at_a_bounded_number_of_times(bench: Bench) -> None:
    """And the agent that was heard before stays heard."""
    bench.passed((bench.agent, heartbeat(AGENT)))
    looks, table = [], bench.wire._table
    bench.wire._table = lambda: looks.append(1) or table()  # type: ignore[func-returns-value]
    with contextlib.ExitStack() as opened:
        many = [opened.enter_context(bench.program()) for _ in range(200)]
        flood = [(each, heartbeat(AGENT)) for each in many]
        assert bench.passed(*flood, (bench.agent, setpoint(1))) == [setpoint(1)]
    assert len(looks) <= 100


def test_where_users_are_not_known_the_first_who_speaks_as_the_agent_has_the_port(
    bench: Bench,
) -> None:
    bench.users = None
    bench.passed((bench.agent, heartbeat(AGENT)))
    assert bench.passed((bench.other, setpoint(1))) == []


def test_the_table_of_this_machine_has_this_process_s_sockets() -> None:
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
            own.bind(("", 0))
            table = Path("/proc/net/udp").read_text()
            assert os.getuid() in owners(table)[own.getsockname()[1]]
    except FileNotFoundError:
        pytest.skip("no Linux")
