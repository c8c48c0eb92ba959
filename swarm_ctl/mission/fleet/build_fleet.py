"""From the fleet section of a file to the fleet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from pathlib import Path
from typing import Final

from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.core.model.fleet import (
    AGENT_SYSID,
    LINK_PORT,
    RADIO_BAUD,
    Fleet,
    FleetAgent,
    RadioShare,
    agent_sysids,
)
from swarm_ctl.core.swarm.hearing import SMALL_SWARM
from swarm_ctl.mission.mission_file import MissionFile
from swarm_ctl.mission.sections.fleet_section import FleetEntry, FleetSection, VehicleResponse

ROUTER_PORT: Final = 7447
"""Where the router of a host listens; zenoh's own port."""
FIRST_AGENT_PORT: Final = 7448
"""Where the first agent of a host listens, in a mesh of peers; the next ones on the next ports."""
_BETWEEN_HOSTS: Final = "tcp"
"""It loses nothing that the link can carry. Where packets are lost, `udp` has the younger states if
few agents share a link: docs/do/deployment.md has the figures."""


def fleet_of(mission: MissionFile, folder: Path = Path()) -> Fleet:
    """The fleet's entries of the mission's agents; simulated ArduCopters where it has no fleet.
    `folder` has the file with the fleet."""
    entries = {entry.id: entry for entry in mission.fleet.agents} if mission.fleet else {}
    given = mission.vehicle.response if "response" in mission.vehicle.model_fields_set else None
    ids = sorted(agent.id for agent in mission.agents)
    flown = [entries.get(i) or FleetEntry(id=i) for i in ids]
    vehicles = {entry.vehicle_sysid for entry in (*entries.values(), *flown)}
    own = with_agent_sysids(flown, vehicles)
    return protected(tuple(fleet_agent(entry, given) for entry in own), mission.fleet, folder)


def protected(agents: tuple[FleetAgent, ...], section: FleetSection | None, folder: Path) -> Fleet:
    """The fleet of these agents, with the router and the keys that the section of a file in
    `folder` names."""
    if section is None:
        return Fleet(agents)
    linked = behind_radios(_linked(agents, section.router), section.radio_bytes_per_s)
    if section.trust is None:
        return Fleet(linked)
    return Fleet(linked, str(folder / section.trust), section.signs)


def behind_radios(
    agents: tuple[FleetAgent, ...], bytes_per_s: int | None
) -> tuple[FleetAgent, ...]:
    """Agents of one host that share an endpoint reach their vehicles through `swarm-ctl link`."""
    at = Counter((agent.endpoint, agent.host) for agent in agents if agent.endpoint)
    return tuple(
        agent
        if agent.endpoint is None or at[agent.endpoint, agent.host] < 2
        else replace(
            agent,
            endpoint=f"udpout:127.0.0.1:{LINK_PORT + agent.id}",
            radio=_share(agent.endpoint, bytes_per_s, at[agent.endpoint, agent.host]),
        )
        for agent in agents
    )


def _share(endpoint: str, bytes_per_s: int | None, vehicles: int) -> RadioShare:
    baud = endpoint.rpartition(":")[2]
    carries = bytes_per_s or int(baud if baud.isdecimal() else RADIO_BAUD) // 10
    return RadioShare(endpoint, carries, vehicles)


def _linked(agents: tuple[FleetAgent, ...], router: str | None) -> tuple[FleetAgent, ...]:
    """The agents, each with its place on the mesh. Where the fleet names only its host: in a large
    swarm the router of the host, else a port of the host for each of its agents."""
    if router or len(agents) > SMALL_SWARM or any(agent.router for agent in agents):
        return tuple(
            replace(agent, router=agent.router or router or _at(agent.host, ROUTER_PORT))
            for agent in agents
        )
    before = Counter[str | None]()
    linked = []
    for agent in agents:
        port = FIRST_AGENT_PORT + before[agent.host]
        linked.append(replace(agent, mesh=agent.mesh or _at(agent.host, port)))
        before[agent.host] += 1
    return tuple(linked)


def _at(host: str | None, port: int) -> str | None:
    return f"{_BETWEEN_HOSTS}/{host}:{port}" if host else None


def with_agent_sysids(
    entries: Sequence[FleetEntry], vehicles: AbstractSet[int]
) -> list[FleetEntry]:
    """The entries, each with the system id that its agent speaks with, which is none of the
    `vehicles`'."""
    taken = vehicles | {entry.agent_sysid for entry in entries if entry.agent_sysid is not None}
    chosen = iter(agent_sysids(sum(entry.agent_sysid is None for entry in entries), taken))
    return [
        entry.model_copy(update={"agent_sysid": next(chosen)})
        if entry.agent_sysid is None
        else entry
        for entry in entries
    ]


def fleet_agent(entry: FleetEntry, given: VehicleResponse | None = None) -> FleetAgent:
    """The agent of a fleet's entry.

    Its response is the entry's, else the mission's (`given`), else the autopilot's typical one.
    """
    response = entry.response or given
    known = response.planned() if response else AUTOPILOT_KINDS[entry.firmware].response
    true = entry.simulated_response
    return FleetAgent(
        id=entry.id,
        sysid=entry.vehicle_sysid,
        autopilot=entry.firmware,
        endpoint=entry.endpoint,
        mesh=entry.mesh,
        response=known,
        vehicle=entry.kind,
        simulated_response=true.planned() if true else None,
        agent_sysid=entry.agent_sysid or AGENT_SYSID,
        router=entry.router,
        host=entry.host,
    )
