"""A scenario: a mission and all that befalls it, as data. One file flies on the virtual clock, and
as processes in lockstep.

Weather and faults of the vehicles stand in the mission itself (`simulation`); here is what happens
to agents, mesh, clocks and station, what pilots do, and what the operator orders. All times are
seconds of mission time from the start of the processes.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, Self, TypeAlias

from pydantic import Field, ValidationError, model_validator

from swarm_ctl.commands.parse import parse
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.errors import InputError, MissionError
from swarm_ctl.mission.compile.loader import LoadedMission, load, loads
from swarm_ctl.mission.input import error_messages, yaml_file
from swarm_ctl.mission.input.document import Document
from swarm_ctl.mission.sections.section import AgentId, Section
from swarm_ctl.mission.sections.simulation_section import FaultEntry, Pilot, SimParameters

MOST_SEED: Final = 2**31
STATION: Final = "station"
_STAGES: Final = 255

Moment = Annotated[float, Field(ge=0, le=86_400)]
Span = Annotated[float, Field(gt=0, le=86_400)]
Ids = Annotated[tuple[AgentId, ...], Field(min_length=1, max_length=250)]
Heard: TypeAlias = AgentId | Literal["station"]
Hearers = Annotated[tuple[Heard, ...], Field(min_length=1, max_length=251)]
Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0, lt=2**16)]
Metres = Annotated[float, Field(ge=-10_000, le=10_000)]


class MeshQuality(Section):
    """What happens to each message of the mesh, on each link by itself."""

    loss: Share = 0.0
    """Share that is lost."""
    delay_s: Annotated[float, Field(ge=0, le=60)] = 0.0
    jitter_s: Annotated[float, Field(ge=0, le=60)] = 0.0
    """Each message is later by up to this; some overtake."""
    duplicate: Share = 0.0
    """Share that comes twice."""


class OwnClocks(Section):
    """Clocks that are not the swarm's."""

    agents: Ids
    ahead_s: Annotated[float, Field(ge=-1e6, le=1e6)] = 0.0
    drift: Annotated[float, Field(ge=-1e-3, le=1e-3)] = 0.0
    """Seconds that it gains in a second."""


class ScenarioPart(Section):
    """A mesh that falls into two: those of `one` and those of `other` do not hear each other."""

    one: Hearers
    other: Hearers
    one_way: bool = False
    """Those of `one` still are heard by the others."""


class Says(Section):
    """What an agent says of itself under its own key that is not so."""

    agents: Ids
    moved_m: tuple[Metres, Metres] = (0.0, 0.0)
    """Its position and stop point are told so far north and east of where they are."""
    set: dict[Literal["step", "override", "gains_tag", "stage"], Count] = Field({})
    """Fields of its state that are told wrong."""

    @model_validator(mode="after")
    def _on_the_wire(self) -> Self:
        if self.set.get("stage", 0) > _STAGES:
            raise ValueError(f"stage {self.set['stage']}; allowed: 0 to {_STAGES}, a byte")
        return self


class Flown(Section):
    """Parameters of simulated vehicles that change (`simulation` has them all)."""

    agents: Ids
    set: SimParameters


class Taken(Section):
    """A pilot takes vehicles over."""

    agents: Ids
    mode: Pilot


class Jump(Section):
    """Clocks that are set."""

    agents: Ids
    ahead_s: Annotated[float, Field(ge=-1e6, le=1e6)]


class Happening(Section):
    """One thing that happens at `at_s`: exactly one of the fields below it."""

    at_s: Moment
    for_s: Span | None = None
    """For how long: of what can end. Default: to the flight's end."""
    order: Annotated[str, Field(min_length=1, max_length=200, examples=["hold @2", "next"])] = ""
    """What the operator types at the station."""
    may_be_refused: bool = False
    """The order may be refused; else the run fails where it is."""
    kill: Ids | None = None
    """The agents' processes are killed."""
    restart: Ids | None = None
    """Killed agents are started again."""
    stop: Ids | None = None
    """The agents' processes stand still, and then go on; needs `for_s`."""
    station: Literal["gone"] | None = None
    """The ground station is killed; with `for_s`, another one comes then. Where agents hold without
    one, another comes in the end."""
    part: ScenarioPart | None = None
    """The mesh falls into two."""
    pilot: Taken | None = None
    """A pilot changes vehicles' modes."""
    vehicle: Flown | None = None
    """Vehicles' parameters change."""
    clock: Jump | None = None
    """Clocks jump."""
    says: Says | None = None
    """Agents tell what is not so."""

    KINDS: ClassVar[tuple[str, ...]] = (
        "order",
        "kill",
        "restart",
        "stop",
        "station",
        "part",
        "pilot",
        "vehicle",
        "clock",
        "says",
    )

    @property
    def kind(self) -> str:
        """Which of them it is."""
        return next(name for name in self.KINDS if getattr(self, name))

    @model_validator(mode="after")
    def _one(self) -> Self:
        given = [name for name in self.KINDS if getattr(self, name)]
        if len(given) != 1:
            found = " and ".join(given) or "nothing"
            raise ValueError(
                f"{found} at {self.at_s:g} s; allowed: exactly one of {', '.join(self.KINDS)}"
            )
        if self.may_be_refused and not self.order:
            raise ValueError(f"{given[0]} with may_be_refused; allowed: beside an order")
        if self.stop and self.for_s is None:
            raise ValueError("a stop without for_s; allowed: for_s, the seconds until they go on")
        return self

    @property
    def until_s(self) -> float:
        """When it is over, as far as that is known beforehand."""
        return self.at_s + (self.for_s or 0.0)


class Scenario(Section):
    """A whole scenario."""

    version: Literal[1]
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,79}$")] = "scenario"
    mission: str | dict[str, Any]
    """A mission file beside this one, or the mission itself."""
    seed: Annotated[int, Field(ge=0, le=MOST_SEED)] = 1
    """Of all random numbers."""
    mesh: MeshQuality = MeshQuality()
    clocks: Annotated[tuple[OwnClocks, ...], Field(max_length=250)] = ()
    """All others go by the swarm's clock."""
    happens: Annotated[tuple[Happening, ...], Field(max_length=1000)] = ()
    """In any order."""
    lands_after_s: Span = 60.0
    """So long after the last happening the operator orders `land` where agents hold, by an order or
    by a policy; and pilots land the vehicles that they still hold."""

    @property
    def ends_s(self) -> float:
        """When the last happening is over, and `lands_after_s` as well."""
        return max((each.until_s for each in self.happens), default=0.0) + self.lands_after_s


def load_scenario(path: Path | str) -> tuple[Scenario, LoadedMission]:
    """A scenario's file and its mission, both checked.

    Raises:
        MissionError: with all mistakes, each with file, line and what is allowed.
    """
    path = Path(path)
    return _checked(yaml_file.read(path, what="scenario"), path)


def scenario_of(text: str, name: str = "scenario.yaml") -> tuple[Scenario, LoadedMission]:
    """As `load_scenario`, of a text; files are looked for in the directory of `name`."""
    return _checked(yaml_file.parse(text, name), Path(name))


def scenario_text(scenario: Scenario) -> str:
    """The file of a scenario: what was given, not the defaults."""
    return yaml_file.write(scenario.model_dump(mode="json", exclude_unset=True, by_alias=True))


def mission_of(scenario: Scenario, folder: Path) -> LoadedMission:
    """The scenario's mission, with the happenings that befall vehicles in its timetable.
    MissionError with its mistakes."""
    source = mission_source(scenario, folder)
    if isinstance(scenario.mission, str):
        loaded = load(source)
    else:
        loaded = loads(yaml_file.write(scenario.mission), str(source))
    return with_faults(loaded, scenario)


def mission_source(scenario: Scenario, folder: Path) -> Path:
    """What a mission's mistakes, and its run, call its file."""
    if isinstance(scenario.mission, str):
        return folder / scenario.mission
    return folder / f"{scenario.name}.mission"


def with_faults(mission: LoadedMission, scenario: Scenario) -> LoadedMission:
    """The mission with what a scenario does to its vehicles in its own timetable."""
    mine = [fault for each in scenario.happens for fault in _faults(each)]
    mine += _given_up(scenario)
    if not mine:
        return mission
    text = yaml_file.write(
        mission.file.model_dump(mode="json", exclude_unset=True, by_alias=True)
        | {"simulation": _with(mission, mine)}
    )
    return loads(text, str(mission.source))


def _with(mission: LoadedMission, mine: list[FaultEntry]) -> dict[str, Any]:
    section = mission.file.simulation
    if section.faults and section.since != "start":
        raise InputError(
            f"{mission.source}: simulation.since is liftoff, and the scenario's times count from"
            " the start; allowed: simulation.since: start, or all faults in one of the two files"
        )
    faults = [each.model_dump(mode="json", exclude_unset=True) for each in (*section.faults, *mine)]
    kept = section.model_dump(mode="json", exclude_unset=True)
    return kept | {"since": "start", "faults": faults}


def _given_up(scenario: Scenario) -> list[FaultEntry]:
    """Pilots do not fly for ever: they land what they keep in the air, in the end."""
    last: dict[int, Pilot] = {}
    for each in sorted(scenario.happens, key=lambda each: each.at_s):
        if each.pilot is not None:
            last |= dict.fromkeys(each.pilot.agents, each.pilot.mode)
    kept = tuple(agent for agent, mode in last.items() if mode in ("hold", "manual"))
    if not kept:
        return []
    return [FaultEntry(at_s=scenario.ends_s, agents=kept, pilot="land")]


def _faults(happening: Happening) -> list[FaultEntry]:
    at_s, for_s = happening.at_s, happening.for_s
    what: dict[str, Any] = {"at_s": at_s}
    if happening.vehicle is not None:
        what |= {"agents": happening.vehicle.agents, "set": happening.vehicle.set}
        what |= {} if for_s is None else {"for_s": for_s}
    elif happening.pilot is not None:
        what |= {"agents": happening.pilot.agents, "pilot": happening.pilot.mode}
    else:
        return []
    return [FaultEntry(**what)]


def _checked(document: Document, path: Path) -> tuple[Scenario, LoadedMission]:
    try:
        scenario = Scenario.model_validate(document.data)
    except ValidationError as error:
        found = error_messages.problems_of(map(dict, error.errors()), document, _schema())
        raise MissionError((*document.problems, *found)) from None
    if document.problems:
        raise MissionError(tuple(document.problems))
    mission = mission_of(scenario, path.parent)
    problems = [
        document.problem(("happens", k), what, allowed)
        for k, each in enumerate(scenario.happens)
        for what, allowed in mistakes(each, mission.plan)
    ]
    problems += [
        document.problem(("clocks", k, "agents"), *unknown)
        for k, each in enumerate(scenario.clocks)
        for unknown in _unknown(set(each.agents), mission.plan)
    ]
    if problems:
        raise MissionError(tuple(problems))
    return scenario, mission


def mistakes(happening: Happening, plan: Plan) -> list[tuple[str, str]]:
    """What is wrong with a happening in this plan, and what would be allowed."""
    named: set[int | str] = {*(happening.kill or ()), *(happening.restart or ())}
    named |= {*(happening.stop or ())}
    named |= {*(each for part in [happening.part] if part for each in (*part.one, *part.other))}
    for of in (happening.pilot, happening.vehicle, happening.clock, happening.says):
        named |= set(of.agents) if of is not None else set()
    found = _unknown(named - {STATION}, plan)
    if happening.order:
        try:
            parse(happening.order, plan)
        except InputError as error:
            what, _, allowed = str(error).partition("; allowed: ")
            found.append((what, allowed or "what `swarm-ctl send` takes"))
    return found


def _unknown(named: set[int | str] | set[int], plan: Plan) -> list[tuple[str, str]]:
    ids = {agent.id for agent in plan.agents}
    unknown = ", ".join(sorted(str(each) for each in named - ids))
    return [(f"no agent {unknown} in this mission", f"agents {sorted(ids)}")] if unknown else []


@cache
def _schema() -> dict[str, Any]:
    return Scenario.model_json_schema()
