"""The fleet: how each agent's vehicle is reached.

It is not part of the plan: the same mission flies with another fleet.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from swarm_ctl.core.law.stop_point import TYPICAL
from swarm_ctl.core.model.plan import Response
from swarm_ctl.mission.input.schema import FleetEntry, MissionFile, VehicleResponse


@dataclass(frozen=True, slots=True)
class FleetAgent:
    """One agent's vehicle and the agent's endpoint on the mesh."""

    id: int
    sysid: int
    """The vehicle's MAVLink system id, 1..250."""
    autopilot: str
    """`ardupilot` or `px4`."""
    endpoint: str | None = None
    """The vehicle's MAVLink endpoint as pymavlink writes it (`udpout:127.0.0.1:14601`); None: `run`
    simulates the vehicle."""
    mesh: str | None = None
    """Where this agent listens on the mesh (`tcp/192.168.1.11:7447`); None: `run` chooses a
    loopback port."""
    response: Response = field(default_factory=Response)
    """How this vehicle answers a velocity setpoint; its stop point is computed with it."""


@dataclass(frozen=True, slots=True)
class Fleet:
    """One entry per agent of the plan, sorted by id."""

    agents: tuple[FleetAgent, ...]

    def agent(self, agent_id: int) -> FleetAgent:
        """The entry of `agent_id`; KeyError where the fleet has no such agent."""
        for agent in self.agents:
            if agent.id == agent_id:
                return agent
        raise KeyError(agent_id)


def fleet_of(mission: MissionFile) -> Fleet:
    """The fleet's entries of the mission's agents; simulated ArduCopters where it has no fleet."""
    entries = {entry.id: entry for entry in mission.fleet.agents} if mission.fleet else {}
    given = mission.vehicle.response if "response" in mission.vehicle.model_fields_set else None
    ids = sorted(agent.id for agent in mission.agents)
    return Fleet(tuple(fleet_agent(entries.get(i) or FleetEntry(id=i), given) for i in ids))


def fleet_agent(entry: FleetEntry, given: VehicleResponse | None = None) -> FleetAgent:
    """The agent of a fleet's entry.

    Its response is the entry's, else the mission's (`given`), else the autopilot's typical one.
    """
    response = entry.response or given
    known = Response(**response.model_dump()) if response else TYPICAL[entry.autopilot]
    return FleetAgent(
        entry.id, entry.vehicle_sysid, entry.autopilot, entry.endpoint, entry.mesh, known
    )
