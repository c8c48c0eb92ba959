"""The fleet: how each agent's vehicle is reached.

It is not part of the plan: the same mission flies with another fleet.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from swarm_ctl.core.model.plan import Response


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
    loopback port."""
    response: Response = field(default_factory=Response)
    """How this vehicle answers a velocity setpoint; its stop point is computed with it."""
    vehicle: VehicleKind = VehicleKind.SIMULATED
    """What `run` provides where there is no endpoint."""

    @property
    def started_as(self) -> VehicleKind | None:
        """What `run` has to start for this agent; None: the vehicle is there already."""
        return None if self.endpoint else self.vehicle


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
