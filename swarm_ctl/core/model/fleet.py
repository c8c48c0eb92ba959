"""The fleet: how each agent's vehicle is reached.

It is not part of the plan: the same mission flies with another fleet.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from swarm_ctl.core.model.plan import Response

AGENT_SYSID: Final = 250
"""The system id that an agent speaks with where the fleet gives none: the first of
`agent_sysids`."""
LINK_PORT: Final = 17000
"""The agent ID of a shared radio reaches the link at this UDP port plus ID, on the loopback
interface."""
RADIO_BAUD: Final = 57600
"""The default of telemetry radios."""
GROUND_STATION_SYSIDS: Final = frozenset({245, 255})
"""What ground stations speak with as delivered: QGroundControl, Mission Planner, MAVProxy and
DroneKit with 255, MAVSDK with 245."""


def plain_endpoint(text: str) -> str:
    """A vehicle's endpoint as this project spells it, from that or from a URL as MAVSDK has it:
    `udpin:0.0.0.0:14540` of `udpin://:14540`, `serial:/dev/ttyACM0` of `serial:///dev/ttyACM0`."""
    scheme, colon, rest = text.partition(":")
    where = rest.removeprefix("//")
    if rest.startswith("//:"):
        where = f"0.0.0.0{where}"  # noqa: S104 - as MAVSDK; without keys it is refused
    return {"udp": "udpin", "tcpout": "tcp"}.get(scheme, scheme) + colon + where


class VehicleKind(StrEnum):
    """What `run` starts for an agent whose vehicle has no endpoint."""

    SIMULATED = "simulated"
    """A vehicle of our own simulator, which plays the autopilot."""
    ARDUCOPTER = "arducopter"
    """ArduCopter itself, built for software in the loop (SITL)."""
    PX4 = "px4"
    """PX4 itself, built for software in the loop, with its own simulation in hardware (SIH)."""

    @property
    def autopilot(self) -> str | None:
        """The firmware family that it is; None: any."""
        return {VehicleKind.ARDUCOPTER: "ardupilot", VehicleKind.PX4: "px4"}.get(self)


class SigningPolicy(StrEnum):
    """Whether the frames between agents and vehicles are signed (MAVLink 2)."""

    REQUIRED = "required"
    OFF = "off"


@dataclass(frozen=True, slots=True)
class RadioShare:
    """A radio that carries the frames of several vehicles; `swarm-ctl link` opens it."""

    endpoint: str
    bytes_per_s: int
    """Of both directions together."""
    vehicles: int
    """How many share it."""


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
    provides the vehicle."""
    mesh: str | None = None
    """Where this agent listens on the mesh (`tcp/192.168.1.11:7447`); None: `run` chooses a
    loopback port, or the swarm has routers."""
    response: Response = field(default_factory=Response)
    """How this vehicle answers a velocity setpoint; its stop point is computed with it."""
    vehicle: VehicleKind = VehicleKind.SIMULATED
    """What `run` provides where there is no endpoint."""
    simulated_response: Response | None = None
    """How a simulated vehicle truly answers; None: as its autopilot does."""
    agent_sysid: int = AGENT_SYSID
    """The MAVLink system id that the agent speaks with, 1..254: by its heartbeats alone an
    ArduCopter knows that the agent lives."""
    router: str | None = None
    """Where the router listens whose client it is; None: `run` chooses a loopback port, or the
    swarm is a mesh of peers."""
    host: str | None = None
    """The computer that the agent runs on, by the name that SSH and the mesh reach it by; None: the
    fleet does not say."""

    radio: RadioShare | None = None
    """What its vehicle shares with others; `endpoint` is then its port at the link."""

    @property
    def reached_at(self) -> str | None:
        """The endpoint that the fleet's file names: the radio's, or the vehicle's own."""
        return self.radio.endpoint if self.radio else self.endpoint

    @property
    def started_as(self) -> VehicleKind | None:
        """What `run` has to start for this agent; None: the vehicle is there already."""
        return None if self.endpoint else self.vehicle


@dataclass(frozen=True, slots=True)
class Fleet:
    """One entry per agent of the plan, sorted by id."""

    agents: tuple[FleetAgent, ...]
    trust: str | None = None
    """The folder with the swarm's keys (`swarm-ctl trust new`); None: the mesh is open."""
    signing: SigningPolicy = SigningPolicy.OFF

    @property
    def routers(self) -> tuple[str, ...]:
        """Where the routers of the agents' hosts listen, each once."""
        return routers_of(self.agents)

    def hosts(self) -> dict[str, tuple[FleetAgent, ...]]:
        """The agents of each host that the fleet names, in the fleet's order."""
        names = dict.fromkeys(agent.host for agent in self.agents if agent.host)
        return {name: tuple(a for a in self.agents if a.host == name) for name in names}

    def radios(self) -> dict[str, tuple[FleetAgent, ...]]:
        """The agents behind each radio that several share, by its endpoint and their host."""
        found: dict[str, tuple[FleetAgent, ...]] = {}
        for agent in self.agents:
            if agent.radio is not None:
                name = agent.radio.endpoint + (f" of {agent.host}" if agent.host else "")
                found[name] = (*found.get(name, ()), agent)
        return found

    def agent(self, agent_id: int) -> FleetAgent:
        """The entry of `agent_id`; KeyError where the fleet has no such agent."""
        for agent in self.agents:
            if agent.id == agent_id:
                return agent
        raise KeyError(agent_id)


def routers_of(agents: Iterable[FleetAgent]) -> tuple[str, ...]:
    """Where the routers of the agents' hosts listen, each once."""
    return tuple(dict.fromkeys(agent.router for agent in agents if agent.router))


def agent_sysids(count: int, taken: Collection[int]) -> list[int]:
    """System ids for `count` agents to speak with: 250, 249, ..., 1, then 254 ... 251, without
    those `taken` (by vehicles, or given in the fleet) and those of ground stations; again from the
    first one when they run out."""
    free = [i for i in (*range(250, 0, -1), *range(254, 250, -1)) if i not in taken]
    own = [i for i in free if i not in GROUND_STATION_SYSIDS] or [AGENT_SYSID]
    return list(itertools.islice(itertools.cycle(own), count))
