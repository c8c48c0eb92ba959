"""`run.json`: plan, fleet and time of a run. `run` writes it before it starts any process."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Final, Literal, Self

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError, model_validator

from swarm_ctl.core.model.plan import Plan
from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.fleet import FleetAgent
from swarm_ctl.report.folder.files import explained, write_whole

MANIFEST: Final = "run.json"


class _StrictModel(BaseModel):
    """No unknown field, no silent conversion, in the plan's dataclasses as well."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, use_attribute_docstrings=True
    )


class _PlanDocument(_StrictModel):
    plan: Plan


class Manifest(_StrictModel):
    """The manifest of one run."""

    schema_version: Literal[1] = 1
    mission: str
    """The mission file as the command line names it."""
    swarm: str
    """The swarm's name on the mesh."""
    started_at: AwareDatetime
    speedup: float = Field(gt=0)
    epoch_s: float
    """Zero of the mission clock on this machine's monotonic clock."""
    headless: bool
    plan: Plan
    plan_hash: str = Field(pattern=r"^[0-9a-f]{16}$")
    """`fingerprint(plan)`; hexadecimal, as many JSON readers round 64-bit integers."""
    fleet: tuple[FleetAgent, ...]
    """One entry per agent, with the endpoints in use."""
    station_mesh: str | None = None
    """Where the station listens on the mesh."""
    record_hz: dict[str, float] = Field(default_factory=dict)
    """Limits on the messages of a topic that are recorded from each agent."""
    versions: dict[str, str] = Field(default_factory=dict)
    """Of this program, Python and some libraries."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        found = fingerprint(self.plan)
        if self.plan_hash != found:
            raise ValueError(f"plan_hash is {self.plan_hash}, the plan's is {found}")
        _refuse_repeated("agent id", (agent.id for agent in self.fleet))
        _refuse_repeated("sysid", (agent.sysid for agent in self.fleet))
        if {agent.id for agent in self.fleet} != {agent.id for agent in self.plan.agents}:
            raise ValueError("fleet and plan name different agents")
        return self

    @property
    def agents_mesh(self) -> list[str]:
        """Where the agents listen on the mesh."""
        return [agent.mesh for agent in self.fleet if agent.mesh]

    @property
    def whole_mesh(self) -> list[str]:
        """Where agents and the run's station listen: a process that joins later connects to all."""
        return self.agents_mesh + ([self.station_mesh] if self.station_mesh else [])

    @property
    def agent_of_sysid(self) -> dict[int, int]:
        """The agent that flies each vehicle."""
        return {agent.sysid: agent.id for agent in self.fleet}


def fingerprint(plan: Plan) -> str:
    """The plan's hash as 16 hexadecimal digits."""
    return f"{plan.hash():016x}"


def plan_to_json(plan: Plan) -> str:
    """The plan as JSON: `{"plan": {...}}`, every field by its name, steps told apart by `kind`."""
    return _PlanDocument(plan=plan).model_dump_json()


def plan_from_json(text: str | bytes) -> Plan:
    """The plan that `plan_to_json` wrote; InputError names each field that is wrong."""
    try:
        return _PlanDocument.model_validate_json(text).plan
    except ValidationError as error:
        raise InputError(f"plan: {explained(error)}") from error


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write `run.json` into the run folder, whole or not at all."""
    write_whole(folder / MANIFEST, manifest.model_dump_json(indent=2) + "\n")


def read_manifest(folder: Path) -> Manifest:
    """Read `run.json`; InputError where it is missing, torn or not a manifest."""
    path = folder / MANIFEST
    try:
        return Manifest.model_validate_json(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    except ValidationError as error:
        raise InputError(f"{path}: {explained(error)}") from error


def _refuse_repeated(what: str, numbers: Iterable[int]) -> None:
    repeated = sorted(number for number, times in Counter(numbers).items() if times > 1)
    if repeated:
        raise ValueError(f"fleet: {what} {', '.join(map(str, repeated))} more than once")
