"""From the fleet section of a file to the fleet."""

from __future__ import annotations

from swarm_ctl.core.law.stop_point import TYPICAL
from swarm_ctl.core.model.fleet import Fleet, FleetAgent
from swarm_ctl.core.model.plan import Response
from swarm_ctl.mission.input.schema import FleetEntry, MissionFile, VehicleResponse


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
    known = Response(**response.model_dump()) if response else TYPICAL[entry.firmware]
    way = (entry.endpoint, entry.mesh, known, entry.kind)
    return FleetAgent(entry.id, entry.vehicle_sysid, entry.firmware, *way)
