"""What a bundle says of itself, and the processes that a host runs of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

PLAN: Final = "plan.json"
_NAME: Final = r"^[A-Za-z0-9_-]{1,64}$"
ROOT: Final = ".local/share/swarm-ctl/host"
"""All that a host has of a deployment, in its user's home."""


class BundleManifest(BaseModel):
    """What a bundle is and runs. A bundle may come from elsewhere, and the host makes its units of
    this: each word that may stand in one is of letters, digits and `_.-:/[]` alone, which mean
    nothing to systemd."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    schema_version: Literal[1] = 1
    host: str = Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,252}$")
    swarm: str = Field(pattern=_NAME)
    whole_hash: str = Field(pattern=r"^[0-9a-f]{16}$")
    """Of plan, fleet and signing, as in the plan file."""
    agents: tuple[Annotated[int, Field(ge=1, le=65535)], ...] = Field(min_length=1, max_length=250)
    endpoints: tuple[str, ...]
    """Of the agents' vehicles, in their order, as the plan file has them."""
    router: str | None = Field(
        default=None,
        pattern=r"^(tcp|tls|udp|quic)/(\[[0-9A-Fa-f:.]{2,45}\]|[A-Za-z0-9_.-]{1,253}):[0-9]{1,5}$",
    )
    """Where the host's router listens."""
    trust: str | None = Field(default=None, pattern=_NAME)
    """Whose keys they are; None: the mesh is open."""
    router_keys: str | None = Field(default=None, pattern=r"^router-[a-z0-9-]{1,20}$")
    open_mesh: bool = False
    expect_station: bool = False
    """No agent arms before it has heard a ground station."""
    swarm_ctl: str = Field(pattern=r"^[0-9A-Za-z.+-]{1,40}$")
    """The version that made the bundle."""

    def services(self, root: str) -> Iterator[Service]:
        """The host's processes, its router first, with `root` for the folder of all."""
        if self.router:
            yield Service("router", "swarm-ctl-router.service", self.router_words(root))
        for agent in self.agents:
            words = self.agent_words(root, str(agent))
            yield Service(f"agent-{agent}", f"swarm-ctl-agent@{agent}.service", words)

    def agent_words(self, root: str, agent: str) -> tuple[str, ...]:
        """The command line of an agent."""
        keys = f"{root}/trust/{self.trust}/agent-{agent}" if self.trust else ""
        words = (f"{root}/bin/swarm-ctl", "agent", f"{root}/current/{PLAN}", "--id", agent)
        expects = ("--expect-station",) if self.expect_station else ()
        return (*words, "--record", f"{root}/flight", *expects, *self._access(keys))

    def router_words(self, root: str) -> tuple[str, ...]:
        """The command line of the router."""
        keys = f"{root}/trust/{self.trust}/{self.router_keys}" if self.router_keys else ""
        words = (f"{root}/bin/swarm-ctl", "router", f"{root}/current/{PLAN}")
        return (*words, "--listen", self.router or "", *self._access(keys))

    def _access(self, keys: str) -> tuple[str, ...]:
        identity = ("--identity", keys) if keys else ()
        return (*identity, "--open-mesh") if self.open_mesh else identity


@dataclass(frozen=True, slots=True)
class Service:
    """One process of a host."""

    name: str
    """`agent-3` or `router`."""
    unit: str
    """What systemd calls it."""
    words: tuple[str, ...]
    """Its command line."""
