"""zenoh itself, two sessions on loopback: a timed message has the time when it came, another one
the time of `drain`."""

from __future__ import annotations

import itertools
import socket
import time
from contextlib import ExitStack, closing
from types import SimpleNamespace

import pytest

from swarm_ctl.mesh.keys import NEWEST
from swarm_ctl.mesh.transport import Inlet
from swarm_ctl.mesh.zenoh_config import read_settings
from swarm_ctl.mesh.zenoh_transport import RingInlet, TimedInlet, ZenohTransport

PATIENCE_S = 20.0


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def read(inlet: Inlet) -> list[tuple[float, str, bytes]]:
    """What has come, with its bytes."""
    return [(received_s, key, bytes(data)) for received_s, key, data in inlet.drain()]


def test_the_time_of_receipt() -> None:
    """By a clock that stands still: at 1 while messages come, at 9 when `drain` is called."""
    shows = [1.0]
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    here = ZenohTransport([endpoint], [], lambda: shows[0])
    there = ZenohTransport([], [endpoint], lambda: 0.0)
    try:
        timed, looked_for = here.subscribe("test/*/word", timed=True), here.subscribe("test/*/word")
        assert isinstance(timed, TimedInlet)
        until = time.monotonic() + PATIENCE_S
        # A message sent before the link is up is lost.
        while not timed._queue._waiting and time.monotonic() < until:
            there.publish("test/2/word", b"first", NEWEST)
            time.sleep(0.05)
        shows[0] = 9.0
        assert read(timed)[0] == (1.0, "test/2/word", b"first")
        assert read(looked_for)[0] == (9.0, "test/2/word", b"first")
    finally:
        there.close()
        here.close()


def test_a_loop_that_is_stopped_while_it_reads_hears_nothing_from_the_future() -> None:
    """What is sent meanwhile has not come before it was sent: else an agent of the same clock takes
    it for the word of a second sender."""
    clock = itertools.count(1.0)
    sent = [SimpleNamespace(key_expr="test/2/word", payload=b"") for _ in range(3)]

    def receive() -> SimpleNamespace | None:
        next(clock)
        return sent.pop() if sent else None

    subscriber = SimpleNamespace(try_recv=receive, undeclare=None)
    heard = RingInlet(subscriber, lambda: next(clock)).drain()
    assert [received_s for received_s, _, _ in heard] == [5.0, 5.0, 5.0]


@pytest.mark.parametrize("gossip", [False, True])
def test_a_users_own_settings(gossip: bool) -> None:
    """Of two sessions that know a third one alone, each hears the other once a user's file lets
    zenoh gossip, and not without."""
    first, second = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    text = "{scouting: {gossip: {enabled: true}}}"
    own = read_settings(text, "own.json5", guarded=True) if gossip else None
    with ExitStack() as opened:

        def session(listen: list[str], connect: list[str]) -> ZenohTransport:
            one = ZenohTransport(listen, connect, time.monotonic, own=own)
            return opened.enter_context(closing(one))

        hub = session([first], [])
        here, there = session([second], [first]), session([], [first])
        inlet, known = there.subscribe("test/here"), hub.subscribe("test/here")
        until = time.monotonic() + (PATIENCE_S if gossip else 1.5)
        heard, linked = False, False
        while not (heard and linked) and time.monotonic() < until:
            here.publish("test/here", b"word", NEWEST)
            time.sleep(0.05)
            heard, linked = heard or bool(inlet.drain()), linked or bool(known.drain())
        assert linked
        assert heard is gossip
