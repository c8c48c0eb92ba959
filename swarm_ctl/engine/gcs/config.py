"""What `run` tells the process that serves ground control software."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RelayVehicle:
    """One vehicle, and where the relay reaches it."""

    agent: int
    sysid: int
    agent_sysid: int
    """What its agent speaks with: no GCS may."""
    endpoint: str
    """A link of the vehicle that its agent does not use; or, if `shared`, the agent's mirror."""
    shared: bool = False
    """The vehicle has one link alone, the agent's."""
    secret: str = ""
    """Hexadecimal: by it the agent's mirror knows the relay."""

    @property
    def port(self) -> int:
        """Of its endpoint."""
        return int(self.endpoint.rpartition(":")[2])


@dataclass(frozen=True, slots=True)
class GcsAddress:
    """Where a GCS listens, and the port that the relay has for it."""

    host: str
    port: int
    own_port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


@dataclass(frozen=True, slots=True)
class RelayConfig:
    """All that the relay is told."""

    vehicles: tuple[RelayVehicle, ...]
    stations: tuple[GcsAddress, ...]

    def mirror_of(self, agent: int) -> RelayVehicle | None:
        """Where this agent shares its vehicle's link; None: it need not."""
        return next((v for v in self.vehicles if v.agent == agent and v.shared), None)
