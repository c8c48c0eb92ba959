"""The router of a large swarm: what it passes on, and what follows when it dies or hangs."""

from __future__ import annotations

import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from swarm_ctl.engine.launch.forked import HostRouter
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.mesh.keys import NEWEST
from swarm_ctl.mesh.transport import Inlet
from swarm_ctl.mesh.zenoh_config import MeshPart
from swarm_ctl.mesh.zenoh_transport import Router, ZenohTransport
from tests.system.running import Running
from tests.system.test_run import assert_apart, assert_truth_ends_on_the_ground
from tests.unit.report.run_folders import write_routed

SEVENTEEN = Path(__file__).with_name("seventeen.yaml")
STATE = "swarm/x/agent/{}/state"
PATIENCE_S = 30.0


def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_ports(1, socket.SOCK_STREAM)[0]}"


def client(at: str) -> ZenohTransport:
    return ZenohTransport([], [at], time.monotonic, part=MeshPart.CLIENT)


def hears(inlet: Inlet, other: ZenohTransport, meanwhile: Callable[[], object] = bool) -> bool:
    """Whether what `other` publishes comes, in the end."""
    inlet.drain()
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        other.publish(STATE.format(2), b"here", NEWEST)
        meanwhile()
        time.sleep(0.02)
        if inlet.drain():
            return True
    return False


@contextmanager
def host_router(folder: Path, at: str, said: list[str]) -> Iterator[HostRouter]:
    write_routed(folder, at, swarm="x")
    host = HostRouter(folder, said.append, 0.5)
    try:
        yield host
    finally:
        host.child.kill()


def test_a_client_opens_before_its_router() -> None:
    """An agent that starts while the router is down flies: it drops what it says, hears nothing,
    and has both as soon as the router is there."""
    at = endpoint()
    with closing(client(at)) as early:
        inlet = early.subscribe(STATE.format("*"))
        gone = early.subscribe(STATE.format(3))
        early.publish(STATE.format(1), b"dropped", NEWEST)
        assert inlet.drain() == []
        gone.end()
        with closing(Router([at], [])), closing(client(at)) as other:
            assert hears(inlet, other)
            assert hears(other.subscribe(STATE.format(2)), early)
            assert gone.drain() == []


def test_what_a_client_is_called_back_by_ends_with_it() -> None:
    """The interpreter waits for the threads in which zenoh calls back, whether the router was there
    first or last: a daemon that wakes while the interpreter ends aborts the process."""
    at, before = endpoint(), set(threading.enumerate())

    def calling() -> list[threading.Thread]:
        others = set(threading.enumerate()) - before
        return [each for each in others if "_open" not in each.name and each.name != "links"]

    with closing(client(at)) as late:
        inlet = late.subscribe(STATE.format("*"), timed=True)
        with closing(Router([at], [])), closing(client(at)) as other:
            other.subscribe(STATE.format("*"), timed=True)
            assert hears(inlet, other)
            assert len(calling()) == 5  # links of three sessions, and two subscriptions
            assert not any(each.daemon for each in calling())
    until = time.monotonic() + PATIENCE_S
    while calling() and time.monotonic() < until:
        time.sleep(0.02)
    assert calling() == []


def test_a_client_that_was_closed_before_its_router_came() -> None:
    """It links to no router any more."""
    at = endpoint()
    gone = client(at)
    inlet = gone.subscribe(STATE.format("*"), timed=True)
    gone.close()
    with closing(Router([at], [])) as there, closing(client(at)) as other:
        until = time.monotonic() + 2.0
        while time.monotonic() < until:
            other.publish(STATE.format(2), b"here", NEWEST)
            time.sleep(0.02)
        until = time.monotonic() + PATIENCE_S
        while there.clients() != 1 and time.monotonic() < until:
            time.sleep(0.02)
        assert there.clients() == 1
        assert inlet.drain() == []


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_router_is_started_again(number: signal.Signals, tmp_path: Path) -> None:
    """One that is killed, and one that hangs: on the same port, and the clients hear each other
    again without a word of theirs."""
    at, said = endpoint(), list[str]()
    with (
        host_router(tmp_path, at, said) as host,
        closing(client(at)) as one,
        closing(client(at)) as two,
    ):
        inlet = one.subscribe(STATE.format("*"))
        assert hears(inlet, two)
        first = host.child.pid
        os.kill(first, number)
        while host.child.pid == first:
            host.look()
            time.sleep(0.05)
        assert hears(inlet, two, host.look)
        why = "hangs" if number == signal.SIGSTOP else "has ended, exit code -9"
        assert said[0] == f"the router {why}: the mesh is cut; it is started again"
        assert said[1:] in ([], ["the router is there again"])


def test_a_router_that_can_not_start_again(tmp_path: Path) -> None:
    """It is said once, it is tried again, and in the end the router is there."""
    at, said = endpoint(), list[str]()
    with host_router(tmp_path, at, said) as host:
        while not host.child.poll_ready():
            time.sleep(0.02)
        host.child.kill()
        with socket.create_server(("127.0.0.1", int(at.rpartition(":")[2]))):
            until = time.monotonic() + 3.0
            while time.monotonic() < until:
                host.look()
                time.sleep(0.05)
        assert len(said) == 2
        assert "the mesh does not open" in said[1]
        assert said[1].endswith("the mesh stays cut, each agent does as its policy says; trying on")
        until = time.monotonic() + PATIENCE_S
        while said[-1] != "the router is there again":
            assert time.monotonic() < until
            host.look()
            time.sleep(0.05)


@pytest.mark.parametrize("key", [STATE.format(9), "swarm/x/agent/9/event"])
def test_a_flood_delays_no_others_states(key: str) -> None:
    """One client says as much as it can, on a key to which another one listens: the states of a
    third one arrive all the same, nine of ten."""
    at = endpoint()
    with (
        closing(Router([at], [])),
        closing(client(at)) as hearing,
        closing(client(at)) as honest,
        closing(client(at)) as flooding,
    ):
        states, flood = hearing.subscribe(STATE.format(2)), hearing.subscribe(key)
        assert hears(states, honest)
        states.drain()
        heard, sent = 0, 0
        for _ in range(100):
            until = time.monotonic() + 0.02
            while time.monotonic() < until:
                flooding.publish(key, bytes(150), NEWEST)
            honest.publish(STATE.format(2), b"state", NEWEST)
            sent += 1
            heard += len(states.drain())
            flood.drain()
        time.sleep(0.2)
        heard += len(states.drain())
        assert heard >= 0.9 * sent


@pytest.mark.long
@pytest.mark.lockstep
@pytest.mark.timeout(600)
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_router_dies_in_flight(tmp_path: Path, number: signal.Signals) -> None:
    """Seventeen agents form: the mesh is cut, and is there again; all land, none too near another,
    and nothing is left behind."""
    rest = ("--lockstep", "--speedup", "3", "--headless", "--no-report")
    with Running("run", SEVENTEEN, *rest, cwd=tmp_path) as running:
        running.wait_for_event("step 2", 17)
        first = running.pids["router"]
        running.kill("router", number)
        running.wait_for(lambda: running.pids["router"] != first)
        running.wait(400)
        running.assert_nothing_left()
        assert "the mesh is cut" in running.output
        assert "the router is there again" in running.output
        assert running.summary()["outcome"] in ("completed", "failed")
        assert_apart(running.folder)
        assert_truth_ends_on_the_ground(running.folder)
