"""What the scenarios' rows rest on: a copy of a flying swarm flies on as the swarm itself."""

from __future__ import annotations

import pytest

from tests.scenarios.swarm import VirtualSwarm, flown_once
from tests.scenarios.test_pilot import HOLD, mission


@flown_once
def climbing(autopilot: str) -> VirtualSwarm:
    swarm = VirtualSwarm(mission(autopilot))
    swarm.wait(lambda s: all(s.hub.world.airborne()))
    return swarm


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_copy_flies_as_the_swarm_that_was_copied(autopilot: str) -> None:
    """To the last bit, beside another one that is broken."""
    first, second, broken = (climbing(autopilot) for _ in range(3))
    broken.kill(1)
    broken.run(2)
    for swarm in (first, second):
        swarm.wait(lambda s: s.in_step(HOLD), 60)
    flown = VirtualSwarm(mission(autopilot))
    flown.wait(lambda s: s.in_step(HOLD))
    for swarm in (first, second):
        assert swarm.now == flown.now
        assert swarm.events == flown.events
        assert swarm.hub.world.positions().tobytes() == flown.hub.world.positions().tobytes()
        assert swarm.hub.world.velocities().tobytes() == flown.hub.world.velocities().tobytes()
