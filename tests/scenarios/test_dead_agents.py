"""A dead agent's vehicle always comes down, whenever the agent is killed, beside a ground station
that sends the heartbeats of id 255."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.mission.compile.loader import loads
from tests.scenarios.swarm import VirtualSwarm

LANDS_S = 6.0
DOWN_S = 40.0
"""From 6 m, as slow as LAND_SPEED (0.5 m/s), and the land detectors' seconds."""
STANDS_S = 12.0
"""An armed vehicle that never left the ground disarms by itself within 10 s."""
LIFTED_M = 0.3
WHOLE_S = 40.0
HEARD_S = 2.0
"""From then on the ground station speaks. A PX4 answers the first one that does on its link, and
that is its agent: spoken to earlier, it would never take off."""
LANDING = {"LAND", "AUTO.LAND"}
MISSION = loads(
    """
version: 1
name: kills
origin: {lat_deg: 47.397742, lon_deg: 8.545594, alt_m: 488}
lengths: metres
tick_s: 0.1
law: {r: 60, r_out: 7, r_in: 2.5}
policies: {agent_lost: continue}
agents:
  - {id: 1, start: [0, 0]}
  - {id: 2, start: [4, 14]}
  - {id: 3, start: [8, 28]}
  - {id: 4, start: [20, 0]}
shapes:
  row: {kind: line, spacing: 10}
steps:
  - takeoff: {height_m: 6}
  - form: {shape: row, tolerance_m: 1, settle_s: 1}
  - move: {to: [20, 10], speed_mps: 2}
  - land
fleet:
  agents: [{id: 1}, {id: 2}, {id: 3, autopilot: px4}, {id: 4, autopilot: px4}]
"""
)


class Watched(VirtualSwarm):
    """All agents are killed, each at its own moment; a ground station speaks to every vehicle."""

    def __init__(self, seed: int) -> None:
        super().__init__(MISSION, seed)
        draw = random.Random(seed)
        # Before all stand ready none arms: most moments are later.
        earliest = 0.5 if draw.random() < 0.1 else 3.0
        self.moments = {i: draw.uniform(earliest, WHOLE_S) for i in self.members}
        self.landing_s: dict[int, float] = {}
        self.down_s: dict[int, float] = {}
        self.flew: set[int] = set()
        self._codec = dialect.MAVLink(None, 255, dialect.MAV_COMP_ID_MISSIONPLANNER)

    def tick(self) -> None:
        if self.now >= HEARD_S and round(self.now / self.plan.tick_s) % 10 == 0:
            self._beat()
        for agent, moment in self.moments.items():
            if self.now >= moment and self.members[agent].alive:
                self.kill(agent)
        super().tick()
        self._watch()

    def _beat(self) -> None:
        message = dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_GCS, 8, 0, 0, 4, 3)
        for place in range(len(self.members)):
            self.hub.receive(place, message.pack(self._codec), ("ground station", 1))

    def vehicles(self) -> Iterator[tuple[int, Any]]:
        """Each agent's, in the order of the plan."""
        return zip(self.members, self.hub.world.vehicles, strict=True)

    def _watch(self) -> None:
        for agent, vehicle in self.vehicles():
            firmware = vehicle.firmware
            if self.now < self.moments[agent] or self.members[agent].alive:
                continue
            since = self.now - self.moments[agent]
            if firmware.mode.name in LANDING or not firmware.armed:
                self.landing_s.setdefault(agent, since)
            if not firmware.armed:
                self.down_s.setdefault(agent, since)
            elif -firmware.sensed.position_ned_m[2] > LIFTED_M:
                self.flew.add(agent)


def assert_all_come_down(seed: int) -> int:
    """How many of the killed agents' vehicles flew."""
    swarm = Watched(seed)
    while swarm.now < WHOLE_S + LANDS_S + DOWN_S and len(swarm.down_s) < len(swarm.members):
        swarm.tick()
    for agent in swarm.members:
        moments = f"seed {seed}, agent {agent}, killed at {swarm.moments[agent]:.2f} s"
        flew = agent in swarm.flew
        assert swarm.landing_s.get(agent, math.inf) <= (LANDS_S if flew else STANDS_S), moments
        longest = LANDS_S + DOWN_S if flew else STANDS_S
        assert swarm.down_s.get(agent, math.inf) <= longest, moments
    return len(swarm.flew)


def assert_most_flew(seeds: range) -> None:
    """Each agent's vehicle comes down, and most were killed in the air."""
    flew = sum(assert_all_come_down(seed) for seed in seeds)
    assert flew > 2 * len(seeds)


def test_a_dead_agents_vehicle_comes_down_beside_a_ground_station() -> None:
    assert_most_flew(range(1))


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("block", range(10))
def test_it_does_so_at_a_thousand_moments(block: int) -> None:
    assert_most_flew(range(1000 + 25 * block, 1025 + 25 * block))
