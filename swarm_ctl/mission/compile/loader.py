"""From a mission file to a plan and a fleet, or to every mistake in it at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, cast

from pydantic import ValidationError, create_model

from swarm_ctl.core.law import graph
from swarm_ctl.core.law.stop_point import TYPICAL
from swarm_ctl.core.model import plan
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.errors import MissionError, Problem
from swarm_ctl.mission.compile import checks
from swarm_ctl.mission.compile.fleet import Fleet, FleetAgent
from swarm_ctl.mission.compile.planned_states import Stand, course, fence_box
from swarm_ctl.mission.compile.warnings import warnings
from swarm_ctl.mission.input import csv_slots, document, error_messages
from swarm_ctl.mission.input.document import Document
from swarm_ctl.mission.input.schema import (
    FleetEntry,
    Form,
    Hold,
    MissionFile,
    Move,
    Return,
    Rotate,
    Scale,
    Step,
    Takeoff,
)
from swarm_ctl.mission.input.section import Section
from swarm_ctl.mission.input.units import in_units


@dataclass(frozen=True)
class LoadedMission:
    """A mission that may fly."""

    plan: Plan
    fleet: Fleet
    source: Path
    file: MissionFile
    """What was written, defaults filled in."""
    warnings: tuple[str, ...] = ()
    """What is allowed but worth a second look, each with file, line and field."""


def load(path: Path | str, *, fleet: Path | str | None = None) -> LoadedMission:
    """Read and check a mission; `fleet` replaces the fleet it names. Raises MissionError with all
    problems."""
    path = Path(path)
    return _build(document.read(path), path, None if fleet is None else Path(fleet))


def loads(text: str, name: str = "mission.yaml") -> LoadedMission:
    """The same from text; a fleet file is looked for in the directory of `name`."""
    return _build(document.parse(text, name), Path(name), None)


def dumps(file: MissionFile) -> str:
    """A mission as text that loads to the same: what was given, not the defaults."""
    return document.write(file.model_dump(mode="json", exclude_unset=True, by_alias=True))


def _build(source: Document, path: Path, fleet: Path | None) -> LoadedMission:
    _graft_fleet(source, path, fleet)
    known = csv_slots.graft(source, path.parent)
    mission, problems = _validate(source, frozenset() if known else frozenset({"shapes"}))
    if problems or mission is None:
        raise MissionError(tuple(sorted(problems, key=_line)))
    written, mission = mission, in_units(mission)
    the_plan = plan_of(mission)
    noted = tuple(
        f"{source.where(finding.place)}: {document.dotted(finding.place)}: {finding.what}"
        for finding in warnings(mission, the_plan)
    )
    return LoadedMission(the_plan, fleet_of(mission), path, written, noted)


def _line(problem: Problem) -> tuple[str, int]:
    name, _, line = problem.where.rpartition(":")
    return (name, int(line)) if line.isdigit() else (problem.where, 0)


def _graft_fleet(source: Document, path: Path, fleet: Path | None) -> None:
    """Put a fleet file's content where the mission names the file."""
    if not isinstance(source.data, dict):
        return
    named = source.data.get("fleet")
    if fleet is None and isinstance(named, str):
        fleet = path.parent / named
    if fleet is None:
        return
    try:
        source.graft(("fleet",), document.read(fleet, what="fleet"))
    except MissionError as error:
        # Where the fleet file has no line to show, the mission's line that names it is the one to
        # look at.
        source.problems += [
            Problem(p.where, "fleet", p.what, p.allowed)
            if p.where != str(fleet)
            else source.problem(("fleet",), f"{fleet} {p.what}", p.allowed)
            for p in error.problems
        ]
        source.data.pop("fleet", None)


def _validate(source: Document, broken: frozenset[str]) -> tuple[MissionFile | None, list[Problem]]:
    """`broken`: sections that are no ground to check others on."""
    problems = list(source.problems)
    mission = None
    try:
        mission = MissionFile.model_validate(source.data)
        rest = _partial(source.data, broken) if broken else mission
    except ValidationError as error:
        found = [each for each in error.errors() if not _follows(each)]
        problems += [
            error_messages.problem_of(dict(each), source, _json_schema()) for each in found
        ]
        broken |= {str(each["loc"][0]) if each["loc"] else "" for each in found}
        if "" in broken:
            return None, problems
        rest = _partial(source.data, broken)
    if not broken.intersection({"law", "lengths", "unit_m"}):
        rest = in_units(rest)
    problems += [source.problem(*finding) for finding in checks.check(rest, broken)]
    return mission, problems


def _follows(error: Mapping[str, Any]) -> bool:
    """pydantic calls a list too short when enough entries are there but some are bad: those are
    reported already."""
    return error["type"] == "too_short" and bool(len(error["input"]) >= error["ctx"]["min_length"])


def _partial(data: dict[str, Any], broken: frozenset[str]) -> MissionFile:
    """The sections that are well-formed; the broken ones are missing, and nobody may ask for
    them."""
    fields = {
        k: (info.annotation, info)
        for k, info in MissionFile.model_fields.items()
        if k not in broken
    }
    model = create_model("PartialMission", __base__=Section, **cast("Any", fields))
    return cast("MissionFile", model.model_validate({k: v for k, v in data.items() if k in fields}))


@cache
def _json_schema() -> dict[str, Any]:
    return MissionFile.model_json_schema()


_RATE = 4.0
"""kappa * h where the mission gives no h [1/s]: forms two to three times as fast as 1, which
without the filter would bring pairs under r_in, and without the release block more of them
(`swarm-ctl study --h 0.05,0.2`)."""
_UNSAFE_RATE = 1.0


def fleet_of(mission: MissionFile) -> Fleet:
    """The fleet's entries of the mission's agents; simulated ArduCopters where it has no fleet."""
    entries = {entry.id: entry for entry in mission.fleet.agents} if mission.fleet else {}
    chosen = (
        entries.get(i) or FleetEntry(id=i) for i in sorted(agent.id for agent in mission.agents)
    )
    return Fleet(tuple(_fleet_agent(mission, entry) for entry in chosen))


def _fleet_agent(mission: MissionFile, entry: FleetEntry) -> FleetAgent:
    given = mission.vehicle.response if "response" in mission.vehicle.model_fields_set else None
    response = entry.response or given
    known = plan.Response(**response.model_dump()) if response else TYPICAL[entry.autopilot]
    return FleetAgent(
        entry.id, checks.sysid_of(entry), entry.autopilot, entry.endpoint, entry.mesh, known
    )


def plan_of(mission: MissionFile) -> Plan:
    """The plan of a mission that has passed its checks."""
    law = mission.law
    kappa = law.kappa or 1 / mission.tick_s
    plain_h = plan.LawParameters().h
    safety = _safety(mission)
    rate = _RATE if safety.filter and safety.release else _UNSAFE_RATE
    h = law.h or (plain_h if law.compensation is plan.Compensation.NONE else min(1.0, rate / kappa))
    starts = {agent.id: agent.start for agent in sorted(mission.agents, key=lambda agent: agent.id)}
    near = (
        graph.neighbours(starts, law.r)
        if mission.neighbours == "starts"
        else graph.of_links(starts, mission.neighbours)
    )
    stands = course(mission)
    return Plan(
        name=mission.name,
        origin=plan.Geodetic(mission.origin.lat_deg, mission.origin.lon_deg, mission.origin.alt_m),
        unit_m=mission.unit_m,
        tick_s=mission.tick_s,
        kappa=kappa,
        law=plan.LawParameters(law.r, law.r_out, law.r_in, h, law.delta_l, law.delta_a),
        compensation=law.compensation,
        response=plan.Response(**mission.vehicle.response.model_dump()),
        limits=plan.Limits(**mission.vehicle.limits.model_dump()),
        policies=_policies(mission),
        prepare_timeout_s=mission.prepare_timeout_s,
        agents=tuple(plan.AgentPlan(i, start, near[i]) for i, start in starts.items()),
        steps=tuple(
            _step(mission, step, before, after)
            for step, before, after in zip(mission.steps, stands[:-1], stands[1:], strict=True)
        ),
        fence=_fence(mission, stands),
        safety=safety,
    )


def _safety(mission: MissionFile) -> plan.Safety:
    default = mission.law.compensation is plan.Compensation.STOP_POINT
    given = mission.safety.model_dump()
    return plan.Safety(
        **{name: default if choice is None else choice for name, choice in given.items()}
    )


def _policies(mission: MissionFile) -> plan.Policies:
    speed_mps = mission.vehicle.limits.speed_mps
    given = mission.policies.model_dump()
    given["max_speed_mps"] = given["max_speed_mps"] or 2 * speed_mps
    given["return_speed_mps"] = given["return_speed_mps"] or speed_mps / 2
    return plan.Policies(**given)


def _fence(mission: MissionFile, stands: list[Stand]) -> plan.Fence:
    drawn, unit = mission.fence.polygon, mission.unit_m
    corners = tuple((n * unit, e * unit) for n, e in drawn) if drawn else fence_box(stands, unit)
    return plan.Fence(corners, mission.fence.height_m)


def _step(mission: MissionFile, step: Step, before: Stand, after: Stand) -> plan.Step:
    match (
        step.takeoff
        or step.form
        or step.hold
        or step.move
        or step.rotate
        or step.scale
        or step.return_
        or step.land
    ):
        case Takeoff() as takeoff:
            # Arming and spooling up, then twice what the climb needs.
            generous_s = 30 + 2 * checks.climb_s(mission, takeoff)
            return plan.TakeoffStep(
                takeoff.height_m, takeoff.timeout_s or generous_s, takeoff.on_timeout
            )
        case Form() as form:
            near = _neighbours(mission, form, before)
            default = (
                form.slots == "nearest" and mission.law.compensation is plan.Compensation.STOP_POINT
            )
            return plan.FormStep(
                form.shape,
                after.slots,
                form.tolerance_m,
                form.settle_s,
                form.timeout_s,
                near,
                form.on_timeout,
                default if form.exchange is None else form.exchange,
            )
        case Hold() as hold:
            return plan.HoldStep(
                hold.duration_s, hold.timeout_s or hold.duration_s + 30, hold.on_timeout
            )
        case Move() | Rotate() | Scale() as travel:
            return _travel(mission, travel, before, after)
        case Return() as back:
            generous_s = (60 + _landing_s(mission, before.height_m)) * (len(mission.agents) + 1)
            return plan.ReturnStep(back.timeout_s or generous_s, back.on_timeout)
        case land:
            return plan.LandStep(
                (land and land.timeout_s) or 60 + _landing_s(mission, before.height_m)
            )


def _landing_s(mission: MissionFile, height_m: float) -> float:
    """Autopilots touch down at 0.5 m/s or less, whatever the descent before; and they take a while
    to disarm."""
    return 1.5 * height_m / min(mission.vehicle.limits.descent_mps, 0.5)


def _travel(
    mission: MissionFile, travel: Move | Rotate | Scale, before: Stand, after: Stand
) -> plan.Step:
    unit, speed_mps = mission.unit_m, checks.travel_mps(mission, travel)
    generous_s = 30 + travel.settle_s + 2 * checks.way_m(mission, before, after) / speed_mps
    rest = (
        speed_mps,
        travel.tolerance_m,
        travel.settle_s,
        travel.timeout_s or generous_s,
        travel.on_timeout,
    )
    if isinstance(travel, Rotate):
        return plan.RotateStep(round(after.angle_rad, 9), *rest)
    if isinstance(travel, Scale):
        return plan.ScaleStep(round(after.scale, 9), *rest)
    return plan.MoveStep(tuple((n * unit, e * unit) for n, e in after.waypoints), *rest)


def _neighbours(
    mission: MissionFile, form: Form, before: Stand
) -> tuple[tuple[int, ...], ...] | None:
    links = checks.form_graph(mission, form, before)
    return None if links is None else tuple(links[i] for i in before.ids)
