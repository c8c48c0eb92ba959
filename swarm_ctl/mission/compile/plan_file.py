"""A plan as a file: all that an agent needs of a mission, slots dealt, as JSON.

A drone's computer reads it without YAML, shapes or the assignment of slots. The plan's hash stands
in the file, so that no edited or damaged plan flies.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import SchemaValidator

from swarm_ctl.core.model.fleet import Fleet, FleetAgent, SigningPolicy
from swarm_ctl.core.model.plan import Plan, fingerprint_of
from swarm_ctl.errors import InputError, MissionError
from swarm_ctl.files import read_bytes
from swarm_ctl.mission.input.document import Document
from swarm_ctl.mission.input.error_messages import problem_of, show

_MOST_BYTES: Final = 32_000_000
"""The largest mission's plan, and room."""
_MOST_FIELDS: Final = 100
"""Of one object: three times what any here has."""
_MOST_PROBLEMS: Final = 20
"""That are told: a file of other things has one for each of its bytes."""


class PlanAndFleet(BaseModel):
    """What a plan file and a run's manifest both say. Strict: no unknown field, no silent
    conversion, in the plan's own dataclasses as well."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=True,
        defer_build=True,  # a run needs its manifest alone
    )

    schema_version: Literal[3] = 3
    """In 1, the plan had no shapes; in 2, neither zones nor groups."""
    plan: Plan
    plan_hash: str = Field(pattern=r"^[0-9a-f]{16}$")
    """`Plan.fingerprint`: hexadecimal, because many JSON readers lose a 64-bit integer's last
    digits."""
    fleet: tuple[FleetAgent, ...]
    """One entry per agent of the plan."""
    trust: str | None = None
    """The fleet's folder with the swarm's keys."""
    signing: SigningPolicy = SigningPolicy.OFF

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.plan_hash != self.plan.fingerprint():
            raise ValueError(
                f"plan_hash is {self.plan_hash}, the plan's is {self.plan.fingerprint()}: it was"
                " changed after it was checked; allowed: a plan as it was written"
            )
        _refuse_repeated("fleet: agent id", (agent.id for agent in self.fleet))
        _refuse_repeated("fleet: sysid", (agent.sysid for agent in self.fleet))
        ids, groups = [agent.id for agent in self.plan.agents], self.plan.groups
        _refuse_repeated("plan: agent id", ids)
        starts = (f"{group.name} after step {group.before}" for group in groups)
        _refuse_repeated("plan: group", starts)
        for agent in ids:
            ends = [0, *(group.last for group in groups if agent in group.ids)]
            begins = [group.before for group in groups if agent in group.ids]
            if begins != ends[:-1]:
                raise ValueError(
                    f"plan: the groups of agent {agent} begin after steps {begins}; allowed: each"
                    " where the one before ends"
                )
        if not groups or not all(group.agents for group in groups):
            raise ValueError("plan: no agents in a group; allowed: groups of one and more")
        if {agent.id for agent in self.fleet} != set(ids):
            raise ValueError(
                "fleet and plan name different agents; allowed: one entry in the fleet for each of"
                f" {', '.join(map(str, ids))}"
            )
        return self


class PlanFile(PlanAndFleet):
    """What a plan file says."""

    whole_hash: str = Field(pattern=r"^[0-9a-f]{16}$")
    """The digits of `named_by_hash`: of fleet and signing, too, which `plan_hash` leaves out."""

    @property
    def name(self) -> str:
        """As of `named_by_hash`."""
        return named_by_hash(self.plan, Fleet(self.fleet, None, self.signing))

    @model_validator(mode="after")
    def _unchanged(self) -> Self:
        found = self.name.rpartition("@")[2]
        if self.whole_hash != found:
            raise ValueError(
                f"whole_hash is {self.whole_hash}, that of plan, fleet and signing is {found}: they"
                " were changed after they were checked; allowed: a plan file as it was written"
            )
        return self


def named_by_hash(plan: Plan, fleet: Fleet) -> str:
    """`hexagon@3fa9c1d2e4f60718`: a mission's name, and the digits of all that its agents act on:
    the plan, each agent's vehicle, endpoints and place, and signing. Not of the folder of keys,
    which is each computer's own. `Plan.fingerprint` is another one: it is of the plan alone, which
    may fly with other fleets."""
    return f"{plan.name}@{fingerprint_of((plan, fleet.agents, fleet.signing))}"


def plan_to_json(plan: Plan, fleet: Fleet) -> str:
    """The text of a plan file."""
    file = PlanFile(
        plan=plan,
        plan_hash=plan.fingerprint(),
        whole_hash=named_by_hash(plan, fleet).rpartition("@")[2],
        fleet=fleet.agents,
        trust=fleet.trust,
        signing=fleet.signing,
    )
    return file.model_dump_json(indent=1) + "\n"


def is_plan_file(path: Path) -> bool:
    """Whether the file is meant as a plan file, torn or not: a mission has no `schema_version`.

    InputError where it can't be read.
    """
    data = _read(path)
    return data.lstrip().startswith(b"{") and b'"schema_version"' in data


def read_plan(path: Path) -> PlanFile:
    """Read a plan file.

    Raises:
        InputError: it can't be read, is no JSON, or what it says is inconsistent.
        MissionError: with every field that is missing, unknown or wrong.
    """
    return plan_from_json(_read(path), str(path))


def plan_from_json(text: str | bytes, name: str = "plan") -> PlanFile:
    """The plan file in a text that errors call `name`; raises as `read_plan`, with the first
    mistake of each list."""
    data = _plain(text, name)
    try:
        found: PlanFile = _validator().validate_json(text)
    except ValidationError as error:
        mistakes = error.errors(include_url=False)
    else:
        return found
    for each in mistakes:
        if each["type"] == "json_invalid":
            raise InputError(
                f"{name}: not JSON: {each['ctx']['error']}; allowed: a whole plan file"
            )
        if each["type"] == "value_error" and not each["loc"]:
            raise InputError(f"{name}: {each['ctx']['error']}")
    document, schema = Document(name, data), PlanFile.model_json_schema()
    # Of another version, other fields may be right: only the version is told.
    for each in mistakes:
        if each["loc"] == ("schema_version",) and each["type"] == "literal_error":
            what = f"{show(each['input'])} is of another version of swarm-ctl"
            allowed = f"{each['ctx']['expected']}, in a file that `swarm-ctl plan` makes anew"
            raise MissionError((document.problem(each["loc"], what, allowed),))
    told = mistakes[:_MOST_PROBLEMS]
    raise MissionError(tuple(problem_of(dict(each), document, schema) for each in told))


def _plain(text: str | bytes, name: str) -> Any:
    """JSON as a `Document` has it; InputError where it is none, or where an object has so many
    fields that to tell each would take all memory."""

    def plain(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        if len(pairs) > _MOST_FIELDS:
            raise InputError(
                f"{name}: has an object of {len(pairs)} fields; allowed: at most {_MOST_FIELDS}"
            )
        return dict(pairs)

    try:
        return _tuples(json.loads(text, object_pairs_hook=plain))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{name}: not JSON: {error}; allowed: a whole plan file") from None


@cache
def _validator() -> SchemaValidator:
    """As PlanFile's own, but it leaves each list at its first mistake: a small file may have a
    million, and each takes memory before any is told."""
    PlanFile.model_rebuild()
    schema = deepcopy(PlanFile.__pydantic_core_schema__)
    _leave_early(schema)
    return SchemaValidator(schema)


def _leave_early(schema: Any) -> None:
    if isinstance(schema, dict):
        if schema.get("type") == "tuple":
            schema["fail_fast"] = True
        for each in schema.values():
            _leave_early(each)
    elif isinstance(schema, list | tuple):
        for each in schema:
            _leave_early(each)


def _read(path: Path) -> bytes:
    try:
        return read_bytes(path, _MOST_BYTES)
    except OSError as error:
        allowed = "a readable plan, mission or fleet file"
        raise InputError(f"{path}: can't be read: {error.strerror}; allowed: {allowed}") from None


def _tuples(data: Any) -> Any:
    """JSON as a `Document` has it."""
    if isinstance(data, dict):
        return {key: _tuples(value) for key, value in data.items()}
    return tuple(map(_tuples, data)) if isinstance(data, list) else data


def _refuse_repeated(what: str, names: Iterable[int] | Iterable[str]) -> None:
    repeated = sorted(str(name) for name, times in Counter(names).items() if times > 1)
    if repeated:
        raise ValueError(f"{what} {', '.join(repeated)} more than once")
