"""A bundle: all that one host needs of a swarm, in one tar that goes there whole.

The plan with its hash, the keys of the host's agents and router, and a manifest. It is
data: the host itself makes its units (`services.py`), and nothing of it becomes a command. Its
digest names it: two bundles of one digest are the same byte for byte.
"""

from __future__ import annotations

import hashlib
import io
import re
import tarfile
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from swarm_ctl.archives import packed, plain_files
from swarm_ctl.core.model.fleet import Fleet, FleetAgent
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.text import printable
from swarm_ctl.engine.protection import agent_identity_folder, router_identity_folder
from swarm_ctl.errors import InputError
from swarm_ctl.files import read_bytes
from swarm_ctl.installed import version
from swarm_ctl.mission.compile.plan_file import (
    PlanFile,
    named_by_hash,
    plan_from_json,
    plan_to_json,
)
from swarm_ctl.trust.bundle import pack as pack_keys
from swarm_ctl.trust.identity import load_identity
from swarm_ctl.trust.names import address_of

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


MANIFEST: Final = "manifest.json"
KEYS: Final = ".bundle"
"""A member's keys, as `swarm-ctl trust` packs them: `agent-3.bundle`."""
MOST_BYTES: Final = 64_000_000
"""Of a bundle: the largest plan file, and room for keys."""


@dataclass(frozen=True, slots=True)
class Bundle:
    """One host's files by name; what they hold may be secret."""

    manifest: BundleManifest
    files: Mapping[str, bytes] = field(repr=False)

    @property
    def digest(self) -> str:
        """Twelve hexadecimal digits of all names and contents."""
        whole = hashlib.sha256()
        for name, data in sorted(self.files.items()):
            whole.update(f"{name}\0{len(data)}\0".encode() + data)
        return whole.hexdigest()[:12]

    def packed(self) -> bytes:
        """The tar of it, every file of mode 0600."""
        return packed(sorted(self.files.items()))


def bundles_of(
    plan: Plan, fleet: Fleet, *, open_mesh: bool = False, expect_station: bool = False
) -> dict[str, Bundle]:
    """The bundle of each host of a fleet.

    Raises:
        InputError: an agent has no host, no endpoint or no link to the mesh, or shares a radio.
        TrustError: the keys of an agent or a router are not there, or damaged.
    """
    for agent in fleet.agents:
        linked = {
            "host": agent.host,
            "endpoint": agent.endpoint,
            "mesh": agent.mesh or agent.router,
        }
        for name in (name for name, value in linked.items() if not value):
            raise InputError(
                f"agent {agent.id} has no `{name}` in the fleet; allowed: one for each agent that"
                " is deployed"
            )
        if agent.radio:
            raise InputError(
                f"agent {agent.id} shares a radio, whose swarm-ctl link is not deployed; allowed:"
                " an endpoint for each agent, or link and agents started by hand"
            )
    runs = own_routers(fleet)
    return {
        host: _bundle(plan, fleet, _Part(host, agents, runs.get(host), open_mesh, expect_station))
        for host, agents in fleet.hosts().items()
    }


def own_routers(fleet: Fleet) -> dict[str, str]:
    """Where the router of each host listens that has one of its own: it serves this host's agents
    alone, or its address is this host's name."""
    hosts = {host: agents[0].router for host, agents in fleet.hosts().items()}
    served = Counter(hosts.values())
    return {
        host: at
        for host, at in hosts.items()
        if at and (served[at] == 1 or address_of(at)[0] == host)
    }


def unpacked(data: bytes, name: str = "bundle") -> Bundle:
    """The bundle in a tar; InputError where it holds anything else than a bundle does, or its parts
    do not fit each other."""
    files: dict[str, bytes] = {}
    try:
        for entry, content in plain_files(io.BytesIO(data), MOST_BYTES):
            if not _fits(entry):
                raise InputError(f"{name}: holds {entry!r}; allowed: a bundle of deploy")
            files[entry] = content
        manifest = BundleManifest.model_validate_json(files[MANIFEST])
        plan = plan_from_json(files[PLAN], f"{name}: {PLAN}")
    except (tarfile.TarError, KeyError, ValidationError) as error:
        raise InputError(
            f"{name}: is no bundle: {printable(str(error))}; allowed: one of swarm-ctl deploy"
        ) from None
    misfit = "; ".join(_misfits(manifest, plan, files))
    if misfit:
        raise InputError(f"{name}: {misfit}; allowed: a bundle as swarm-ctl deploy made it")
    return Bundle(manifest, files)


def _misfits(manifest: BundleManifest, file: PlanFile, files: Collection[str]) -> Iterator[str]:
    """What of a bundle is not of one piece, in words."""
    if file.whole_hash != manifest.whole_hash or file.plan.name != manifest.swarm:
        yield f"its plan is {file.name}, its manifest has another one"
    if file.trust is not None:
        yield "its plan names a folder of keys"  # its manifest names the host's own
    endpoints = {agent.id: agent.endpoint for agent in file.fleet}
    if len(set(manifest.agents)) != len(manifest.agents) or manifest.endpoints != tuple(
        endpoints.get(agent) for agent in manifest.agents
    ):
        yield "its manifest has other agents or endpoints than its plan"
    keyed = {f"agent-{agent}" for agent in manifest.agents} | {manifest.router_keys}
    brought = {entry.removesuffix(KEYS) for entry in files if entry.endswith(KEYS)}
    if brought - keyed or (brought and manifest.trust is None):
        yield f"it brings keys that its manifest does not name ({', '.join(sorted(brought))})"


def read_bundle(path: Path) -> Bundle:
    """The bundle in a file; raises as `unpacked`, and OSError."""
    return unpacked(read_bytes(path, MOST_BYTES), str(path))


@dataclass(frozen=True, slots=True)
class _Part:
    """What one host runs."""

    host: str
    agents: tuple[FleetAgent, ...]
    router: str | None
    open_mesh: bool
    expect_station: bool


def _bundle(plan: Plan, fleet: Fleet, part: _Part) -> Bundle:
    keys, router_keys = _keys(fleet, part)
    swarms = {load_identity(folder).swarm for folder in keys}
    manifest = BundleManifest(
        host=part.host,
        swarm=plan.name,
        whole_hash=named_by_hash(plan, fleet).rpartition("@")[2],
        agents=tuple(agent.id for agent in part.agents),
        endpoints=tuple(agent.endpoint or "" for agent in part.agents),
        router=part.router,
        trust=min(swarms, default=None),
        router_keys=router_keys,
        open_mesh=part.open_mesh,
        expect_station=part.expect_station,
        swarm_ctl=version(),
    )
    files = {
        MANIFEST: manifest.model_dump_json(indent=1).encode() + b"\n",
        PLAN: plan_to_json(plan, replace(fleet, trust=None)).encode(),
        **{folder.name + KEYS: pack_keys(folder) for folder in keys},
    }
    return Bundle(manifest, files)


def _keys(fleet: Fleet, part: _Part) -> tuple[list[Path], str | None]:
    """The folders of this host's members alone, and the name of its router's."""
    found = [agent_identity_folder(fleet.trust, agent.id) for agent in part.agents]
    router = router_identity_folder(fleet.trust, part.router) if part.router else None
    return [folder for folder in (*found, router) if folder], router.name if router else None


def _fits(name: str) -> bool:
    member = name.removesuffix(KEYS)
    return name in (MANIFEST, PLAN) or (
        name != member and re.fullmatch(r"(agent|router)-[a-z0-9-]{1,20}", member) is not None
    )
