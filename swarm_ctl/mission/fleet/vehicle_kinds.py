"""`--vehicles`: what `run` starts for each agent, in place of what the fleet says."""

from __future__ import annotations

from itertools import cycle

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.core.model.text import agents_named, ids_of
from swarm_ctl.errors import InputError
from swarm_ctl.mission.mission_file import MissionFile
from swarm_ctl.mission.sections.fleet_section import FleetEntry, FleetSection

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
            found |= dict.fromkeys(ids_of(",".join(ids), "--vehicles"), _kind(kind, given))
            ids = []
    if ids:
        named = agents_named(ids_of(",".join(ids), "--vehicles"))
        raise InputError(f"--vehicles {given}: no kind for {named}; allowed: {ALLOWED}")
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
