"""From a mission file to a plan and a fleet, or to every mistake in it at once.

The way of a file: document (`input/yaml_file.py`), fleet file and CSV slots put in, sections
(`sections/`, `steps/`), checks, lengths in units (`input/units.py`), plan, checks of the plan,
warnings.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from itertools import cycle
from pathlib import Path
from typing import Any, cast

from pydantic import ValidationError, create_model

from swarm_ctl.core.model.fleet import Fleet, VehicleKind
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.text import agents_named, ids_of
from swarm_ctl.errors import InputError, MissionError, Problem
from swarm_ctl.mission.checks import envelope
from swarm_ctl.mission.checks.mission_checks import check
from swarm_ctl.mission.checks.plan_checks import check_plan
from swarm_ctl.mission.checks.warnings import warnings
from swarm_ctl.mission.compile.build_plan import plan_of
from swarm_ctl.mission.fleet.build_fleet import fleet_of
from swarm_ctl.mission.input import csv_slots, error_messages, yaml_file, zone_files
from swarm_ctl.mission.input.document import Document
from swarm_ctl.mission.input.near_matches import nearest
from swarm_ctl.mission.mission_file import MissionFile
from swarm_ctl.mission.sections.fleet_section import FleetEntry, FleetSection
from swarm_ctl.mission.sections.section import Section


@dataclass(frozen=True)
class LoadedMission:
    """A mission that may fly."""

    plan: Plan
    fleet: Fleet
    source: Path
    file: MissionFile
    """What was written, defaults filled in."""
    document: Document
    """Says where in the file each value stands."""
    warnings: tuple[str, ...] = ()
    """What is allowed but worth a second look, each with file, line and field."""


def load(
    path: Path | str, *, fleet: Path | str | None = None, vehicles: str | None = None
) -> LoadedMission:
    """Read and check a mission; `fleet` replaces the fleet it names, `vehicles` (`px4`) the kinds
    of the vehicles that `run` starts.

    Raises:
        MissionError: with all problems, in the order of the file.
        InputError: `vehicles` names no kind, or no agent.
    """
    path = Path(path)
    return _build(yaml_file.read(path), path, None if fleet is None else Path(fleet), vehicles)


def loads(text: str, name: str = "mission.yaml", *, vehicles: str | None = None) -> LoadedMission:
    """Load a mission from text, as `load`; a fleet file is looked for in the directory of
    `name`."""
    return _build(yaml_file.parse(text, name), Path(name), None, vehicles)


def dumps(file: MissionFile) -> str:
    """A mission as text that loads to the same: what was given, not the defaults."""
    return yaml_file.write(file.model_dump(mode="json", exclude_unset=True, by_alias=True))


def _build(
    source: Document, path: Path, fleet: Path | None, vehicles: str | None = None
) -> LoadedMission:
    folder = _graft_fleet(source, path, fleet)
    known = csv_slots.graft(source, path.parent)
    sound = zone_files.graft(source, path.parent)
    unknown = ({"shapes"} if not known else set()) | ({"zones"} if not sound else set())
    written, broken = _sections(source, unknown)
    findings = check(written, frozenset(broken))
    plan = None if broken or findings else plan_of(written.in_units())
    if plan is not None and (slower := envelope.with_usual_speed(written, plan)) is not written:
        written, plan = slower, plan_of(slower.in_units())
    findings += [*check_plan(plan, written), *envelope.refused(plan)] if plan else []
    problems = source.problems + [source.problem(*finding) for finding in findings]
    if problems or plan is None:
        raise MissionError(tuple(sorted(problems, key=_line)))
    flown = written if vehicles is None else with_vehicles(written, vehicles)
    noted = [source.problem(*finding) for finding in warnings(flown, plan)]
    return LoadedMission(
        plan=plan,
        fleet=fleet_of(flown, folder),
        source=path,
        file=written,
        document=source,
        warnings=tuple(f"{each.where}: {each.field}: {each.what}" for each in noted),
    )


def _line(problem: Problem) -> tuple[str, int]:
    name, _, line = problem.where.rpartition(":")
    return (name, int(line)) if line.isdigit() else (problem.where, 0)


def _graft_fleet(source: Document, path: Path, fleet: Path | None) -> Path:
    """Put a fleet file's content where the mission names the file; the folder of the fleet."""
    if not isinstance(source.data, dict):
        return path.parent
    named, given = source.data.get("fleet"), fleet is not None
    if fleet is None and isinstance(named, str):
        fleet = path.parent / named
    if fleet is None:
        return path.parent
    try:
        source.graft(("fleet",), yaml_file.read(fleet, what="fleet"))
    except MissionError as error:
        # Without a line in the fleet file, the mission's line that names it is the place to look.
        source.problems += [
            Problem(p.where, "fleet", p.what, p.allowed)
            if given or p.where != str(fleet)
            else source.problem(("fleet",), f"{fleet} {p.what}", p.allowed)
            for p in error.problems
        ]
        source.data.pop("fleet", None)
    return fleet.parent


def _sections(source: Document, broken: set[str]) -> tuple[MissionFile, set[str]]:
    """The mission without its broken sections, and their names; their problems go to `source`.

    `broken` names sections that are broken already. No code may ask for a broken section.
    """
    try:
        mission = MissionFile.model_validate(source.data)
        return (_partial(source.data, broken) if broken else mission), broken
    except ValidationError as error:
        found = [each for each in error.errors() if not _follows(each)]
        source.problems += error_messages.problems_of(map(dict, found), source, _json_schema())
        names = {str(each["loc"][0]) if each["loc"] else "" for each in found}
        # a misspelt section is broken under its own name, too
        broken = (
            broken | names | {nearest(name, MissionFile.model_fields) for name in names if name}
        )
        if "" in broken:
            raise MissionError(tuple(source.problems)) from None
        return _partial(source.data, broken), broken


def _follows(error: Mapping[str, Any]) -> bool:
    """Whether pydantic calls a list too short only because it left bad entries out."""
    return error["type"] == "too_short" and bool(len(error["input"]) >= error["ctx"]["min_length"])


def _partial(data: Mapping[str, Any], broken: set[str]) -> MissionFile:
    infos = MissionFile.model_fields.items()
    fields = {name: (info.annotation, info) for name, info in infos if name not in broken}
    model = create_model("PartialMission", __base__=Section, **cast("Any", fields))
    sections = {name: value for name, value in data.items() if name in fields}
    return cast("MissionFile", model.model_validate(sections))


@cache
def _json_schema() -> dict[str, Any]:
    return MissionFile.model_json_schema()


ALLOWED = (
    f"{', '.join(VehicleKind)}; several of them, in turn, as arducopter,px4;"
    " or by agent, as 1-3=arducopter,4-6=px4"
)


def with_vehicles(mission: MissionFile, given: str) -> MissionFile:
    """The mission with `given` in its fleet.

    A list of kinds is dealt to the agents that have no endpoint, in the order of their ids, again
    and again; an assignment names agents.

    Raises:
        InputError: no known kind, an agent that is not there or has an endpoint.
    """
    entries = {entry.id: entry for entry in mission.fleet.agents} if mission.fleet else {}
    flying = {a.id: entries.get(a.id) or FleetEntry(id=a.id) for a in mission.agents}
    free = sorted(i for i, entry in flying.items() if entry.endpoint is None)
    if not free:
        raise InputError(f"--vehicles {given}: every vehicle of the fleet has an endpoint")
    kinds = kinds_of(given, free)
    if wrong := kinds.keys() - set(free):
        why = "has an endpoint" if min(wrong) in flying else "is not in this mission"
        raise InputError(f"--vehicles {given}: agent {min(wrong)} {why}; allowed: {free}")
    chosen = {i: _as(entries.get(i) or flying[i], kind) for i, kind in kinds.items()}
    agents = tuple(sorted((entries | flying | chosen).values(), key=lambda entry: entry.id))
    section = mission.fleet or FleetSection(agents=agents)
    return mission.model_copy(update={"fleet": section.model_copy(update={"agents": agents})})


def kinds_of(given: str, free: list[int]) -> dict[int, VehicleKind]:
    """The kind of each agent that `given` names, or of all in `free` where it names none."""
    if "=" not in given:
        kinds = [_kind(word, given) for word in given.split(",")]
        return dict(zip(free, cycle(kinds), strict=False))
    found: dict[int, VehicleKind] = {}
    ids: list[str] = []
    for word in given.split(","):
        name, equals, kind = word.partition("=")
        ids.append(name)
        if equals:
            named = dict.fromkeys(ids_of(",".join(ids), "--vehicles"), _kind(kind, given))
            if twice := found.keys() & named.keys():
                who = agents_named(sorted(twice))
                raise InputError(f"--vehicles {given}: {who} twice; allowed: one kind for each")
            found |= named
            ids = []
    if ids:
        who = agents_named(ids_of(",".join(ids), "--vehicles"))
        raise InputError(f"--vehicles {given}: no kind for {who}; allowed: {ALLOWED}")
    return found


def _kind(word: str, given: str) -> VehicleKind:
    try:
        return VehicleKind(word.strip())
    except ValueError:
        raise InputError(f"--vehicles {given}: no kind {word!r}; allowed: {ALLOWED}") from None


def _as(entry: FleetEntry, kind: VehicleKind) -> FleetEntry:
    """The entry for a vehicle of this kind; a response of another autopilot's does not count."""
    firmware = kind.autopilot or entry.firmware
    response = entry.response if firmware == entry.firmware else None
    changes = {"vehicle": kind.value, "autopilot": firmware, "response": response}
    return FleetEntry.model_validate(entry.model_dump(exclude_unset=True) | changes)
