"""A seat at the barrier when its keeper goes."""

from __future__ import annotations

import socket
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import closing
from itertools import count, pairwise, repeat

import pytest

from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.lockstep.keeper import Keeper, Rules
from swarm_ctl.engine.lockstep.seat import take_seat
from swarm_ctl.engine.lockstep.words import TickPhase
from swarm_ctl.errors import LinkError

pytestmark = pytest.mark.timeout(20)


def test_without_its_keeper_time_goes_on_by_the_wall() -> None:
    """A member's loop ticks in mission time as fast as it can, and when the keeper has died at the
    wall clock's pace, from where it was: it neither hangs nor jumps."""
    address = f"test-{uuid.uuid4()}"
    keeper = Keeper(Rules(0.05, ("agent-1",)), address, lambda _: None)
    alive = True

    def keep() -> None:
        while alive:
            keeper.turn()
        keeper.close()

    thread = threading.Thread(target=keep)
    thread.start()
    with closing(take_seat(address, TickPhase.SWARM, 0.0, 10.0)) as place:
        place.join("agent-1", "test", 1)
        ticker = place.ticker(0.05, lambda: None)
        assert [round(ticker.wait(), 6) for _ in range(100)] == [
            round(0.05 * k, 6) for k in range(1, 101)
        ]
        alive = False
        began = time.monotonic()
        times = [ticker.wait() for _ in range(400)]
        thread.join()
        assert time.monotonic() - began < 15
        steps = [later - earlier for earlier, later in pairwise(times)]
        assert min(steps) > 0
        assert ticker.report().count > 400
        by_the_wall = ticker.wait()
        began = time.monotonic()
        for _ in range(10):
            last = ticker.wait()
        took = time.monotonic() - began
        assert last - by_the_wall == pytest.approx(10.0 * took, abs=0.2)


def answers(monkeypatch: pytest.MonkeyPatch, said: Iterator[str]) -> None:
    """What the resolver says, one after the other; '' for "not now"."""

    def answer(_host: str) -> str:
        if address := next(said):
            return address
        raise socket.gaierror(socket.EAI_AGAIN, "Temporary failure in name resolution")

    monkeypatch.setattr(socket, "gethostbyname", answer)


def test_a_resolver_that_fails_for_now_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a container engine's does while containers start."""
    said = iter(["", "127.0.0.1"])
    answers(monkeypatch, said)
    with closing(take_seat(None, TickPhase.SWARM, 0.0, 1.0).wire("udpout:vehicle-3:9")):
        assert next(said, None) is None


def test_a_resolver_that_goes_on_failing_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    answers(monkeypatch, repeat(""))
    seconds = count()
    monkeypatch.setattr(wall, "wall_s", lambda: float(next(seconds)))
    monkeypatch.setattr(wall, "pause", lambda _seconds: None)
    with pytest.raises(LinkError, match=r"udpout:vehicle-3:9: can't be opened: .*Temporary"):
        take_seat(None, TickPhase.SWARM, 0.0, 1.0).wire("udpout:vehicle-3:9")
