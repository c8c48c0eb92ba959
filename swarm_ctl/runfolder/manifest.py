"""`run.json`: plan, fleet and time of a run. `run` writes it before it starts any process, a
station that judges when it hears the first agent."""

from __future__ import annotations

import platform
from importlib import metadata
from pathlib import Path
from typing import Any, Final

from pydantic import AwareDatetime, Field

from swarm_ctl.core.model.fleet import routers_of
from swarm_ctl.installed import commit
from swarm_ctl.mission.compile.plan_file import PlanAndFleet
from swarm_ctl.runfolder.files import read_model, write_model

MANIFEST: Final = "run.json"
_PACKAGES: Final = (
    "swarm-ctl",
    "eclipse-zenoh",
    "numpy",
    "pydantic",
    "pymavlink",
    "rich",
    "textual",
)
"""Their versions stand in the manifest."""


class Manifest(PlanAndFleet):
    """The manifest of one run: its plan, its fleet with the endpoints in use, and its start."""

    mission: str
    """The mission file as the command line names it."""
    swarm: str
    """The swarm's name on the mesh."""
    started_at: AwareDatetime
    speedup: float = Field(gt=0)
    epoch_s: float
    """Zero of the mission clock on this machine's monotonic clock."""
    lockstep: str | None = None
    """Where the keeper of mission time is, of a run in lockstep; its `speedup` is 1 if it goes as
    fast as it can, and `epoch_s` says nothing."""
    headless: bool
    simulated: tuple[int, ...] | None = None
    """The agents whose vehicles this run simulates: the truth has these alone. None: all (a run of
    an earlier version)."""
    elsewhere: bool = False
    """The agents were started elsewhere: each has a clock of its own."""
    process: int | None = None
    """The id of `run` itself; those of the processes that it starts are in `processes.json`."""
    process_space: str | None = None
    """Where these ids mean something: a container has a space of its own."""
    station_mesh: str | None = None
    """Where the station listens on the mesh of a small swarm."""
    identity: str | None = None
    """The folder of the operator who flies it; None: the mesh is open."""
    open_mesh: bool = False
    """Other computers can reach it, and it has no keys."""
    zenoh: dict[str, Any] = Field(default_factory=dict)
    """A user's own zenoh settings (`--zenoh-config`), for all processes of the run."""
    record_hz: dict[str, float] = Field(default_factory=dict)
    """Limits on the messages of a topic that are recorded from each agent."""
    versions: dict[str, str] = Field(default_factory=dict)
    """Of this program, Python and some libraries."""

    @property
    def flown_by(self) -> Path | None:
        """The folder with the identity of the run's own station."""
        return Path(self.identity) if self.identity else None

    @property
    def routers(self) -> tuple[str, ...]:
        """Where its routers listen; none of a mesh of peers."""
        return routers_of(self.fleet)

    @property
    def guarded(self) -> bool:
        """It has keys, or other computers may reach it."""
        return self.open_mesh or self.trust is not None

    @property
    def agents_mesh(self) -> list[str]:
        """Where a process connects to hear the agents: to each, or to their router."""
        return list(dict.fromkeys(at for a in self.fleet if (at := a.router or a.mesh)))

    @property
    def whole_mesh(self) -> list[str]:
        """What a process that joins later connects to."""
        return self.agents_mesh + ([self.station_mesh] if self.station_mesh else [])

    @property
    def in_truth(self) -> frozenset[int]:
        """The agents whose vehicles the truth has."""
        ids = (agent.id for agent in self.fleet) if self.simulated is None else self.simulated
        return frozenset(ids)

    @property
    def agent_of_sysid(self) -> dict[int, int]:
        """The agent that flies each vehicle."""
        return {agent.sysid: agent.id for agent in self.fleet}


def package_versions() -> dict[str, str]:
    """Of Python, this program, with its commit where that is known, and some libraries."""
    built_of = {"commit": known} if (known := commit()) else {}
    versions = {name: metadata.version(name) for name in _PACKAGES}
    return {"python": platform.python_version()} | built_of | versions


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write `run.json` into the run folder, whole or not at all."""
    write_model(folder / MANIFEST, manifest)


def read_manifest(folder: Path) -> Manifest:
    """Read `run.json`; InputError where it is missing, torn or not a manifest."""
    return read_model(folder / MANIFEST, Manifest)
