"""Agents that are killed leave our failsafe parameters on their vehicles: a later agent of the same
vehicle gives its own back."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from swarm_ctl.engine.vehicle_memory import VehicleMemory
from tests.on_demand import on_demand
from tests.scenarios.swarm import VirtualSwarm, landing_fast
from tests.scenarios.test_restart import GONE_S, texts
from tests.scenarios.test_steps import THIRD, trio

LAND = trio("hold: {duration_s: 5}", "land")


def parameters(swarm: VirtualSwarm, agent: int) -> dict[str, float]:
    """Of the agent's vehicle, those that agents change."""
    firmware = swarm.hub.world.vehicles[agent - 1].firmware
    names = swarm.members[agent].link._autopilot.parameters.names
    return {name: firmware.parameters[name] for name in names if name in firmware.parameters}


def test_an_agent_that_takes_its_vehicle_over_gives_its_own_values_back(tmp_path: Path) -> None:
    """Killed in flight and started again: the vehicle's own values are known, and no warning says
    that they are not."""
    swarm = landing_fast(VirtualSwarm(LAND, memory=tmp_path))
    own = parameters(swarm, 2)
    swarm.wait(lambda s: s.in_step(THIRD))
    assert parameters(swarm, 2) != own
    swarm.kill(2)
    swarm.run(GONE_S)
    swarm.restart(2)
    swarm.fly()
    assert swarm.outcomes() == dict.fromkeys((1, 2, 3), "completed")
    assert parameters(swarm, 2) == own
    assert "took over its vehicle" in texts(swarm)
    assert "still has our failsafe parameters of test" in texts(swarm)
    assert "not known any more" not in texts(swarm)
    assert VehicleMemory(tmp_path).entries() == []


@pytest.mark.parametrize("seed", [1, *(on_demand(seed) for seed in (0, *range(2, 30)))])
def test_after_a_kill_at_any_moment_the_next_flight_gives_the_own_values_back(
    seed: int, tmp_path: Path
) -> None:
    """All agents killed at a random moment between the first heartbeat and the landing; when the
    vehicles are down, others fly the same mission on them."""
    moment = random.Random(seed).uniform(0.1, 40.0)
    swarm = landing_fast(VirtualSwarm(LAND, memory=tmp_path))
    agents = tuple(swarm.members)
    own = {agent: parameters(swarm, agent) for agent in agents}
    swarm.run(moment)
    for agent in agents:
        swarm.kill(agent)
    swarm.wait(lambda s: s.all_down, swarm.now + 120)
    swarm.run(5.0)
    for agent in agents:
        swarm.restart(agent)
    swarm.fly(swarm.now + 300)
    assert {agent: parameters(swarm, agent) for agent in agents} == own
    assert VehicleMemory(tmp_path).entries() == []
