"""The fleet: how each agent's vehicle is reached.

It is not part of the plan: the same mission flies with another fleet.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from swarm_ctl.core.model.plan import Response


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
