"""A seat at the barrier when its keeper goes."""

from __future__ import annotations

import threading
import time
import uuid
from contextlib import closing
from itertools import pairwise

import pytest

from swarm_ctl.runtime.lockstep.keeper import Keeper, Rules
from swarm_ctl.runtime.lockstep.seat import seat
from swarm_ctl.runtime.lockstep.words import Phase

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
    with closing(seat(address, Phase.SWARM, 0.0, 10.0)) as place:
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
