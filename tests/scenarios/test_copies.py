"""What the scenarios' rows rest on: a copy of a flying swarm flies on as the swarm itself."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from swarm_ctl.mission.compile.loader import LoadedMission
from tests.scenarios.swarm import VirtualSwarm, flown_once
from tests.scenarios.test_pilot import HOLD, mission


@cache
def both() -> LoadedMission:
    """A pair of an ArduCopter and a PX4."""
    pair = mission("ardupilot")
    first, second = pair.fleet.agents
    return replace(
        pair, fleet=replace(pair.fleet, agents=(first, replace(second, autopilot="px4")))
    )


@flown_once
def climbing() -> VirtualSwarm:
    swarm = VirtualSwarm(both())
    swarm.wait(lambda s: all(s.hub.world.airborne()))
    return swarm


def test_a_copy_flies_as_the_swarm_that_was_copied() -> None:
    """To the last bit, beside another one that is broken."""
    first, second, broken = (climbing() for _ in range(3))
    broken.kill(1)
    broken.run(2)
    for swarm in (first, second):
        swarm.wait(lambda s: s.in_step(HOLD), 60)
    flown = VirtualSwarm(both())
    flown.wait(lambda s: s.in_step(HOLD))
    assert len(flown.hub.world.groups) == 2
    for swarm in (first, second):
        assert swarm.now == flown.now
        assert swarm.events == flown.events
        assert swarm.hub.world.positions().tobytes() == flown.hub.world.positions().tobytes()
        assert swarm.hub.world.velocities().tobytes() == flown.hub.world.velocities().tobytes()
