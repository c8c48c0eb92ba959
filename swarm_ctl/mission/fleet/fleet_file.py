"""Reads a fleet file, and puts a measured response into one without changing anything else."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

from pydantic import ValidationError
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from swarm_ctl.core.model.fleet import Fleet
from swarm_ctl.core.model.plan import Response
from swarm_ctl.errors import InputError, MissionError
from swarm_ctl.mission.fleet.build_fleet import fleet_agent, protected, with_agent_sysids
from swarm_ctl.mission.fleet.fleet_checks import check_fleet, check_hosts, check_trust
from swarm_ctl.mission.input import error_messages, yaml_file
from swarm_ctl.mission.sections.fleet_section import FleetSection

_Edit: TypeAlias = tuple[int, int, str]
"""Replace the characters from here to there by this text."""


def read_fleet(path: Path) -> Fleet:
    """The agents of a fleet file, sorted by id; MissionError with every mistake in it. Two agents
    may have one sysid here; a mission refuses that."""
    source = yaml_file.read(path, what="fleet")
    try:
        section = FleetSection.model_validate(source.data)
        findings = [
            *check_fleet(section.agents, ("agents",), radio=section.radio_bytes_per_s is not None),
            *check_trust(section, ()),
        ]
        found = [source.problem(*finding) for finding in (*findings, *check_hosts(section, ()))]
    except ValidationError as error:
        schema = FleetSection.model_json_schema()
        section = None
        found = error_messages.problems_of(map(dict, error.errors()), source, schema)
    if source.problems + found or section is None:
        raise MissionError(tuple(source.problems + found))
    entries = section.agents
    own = with_agent_sysids(
        sorted(entries, key=lambda entry: entry.id), {entry.vehicle_sysid for entry in entries}
    )
    return protected(tuple(map(fleet_agent, own)), section, path.parent)


def file_of(mission: Path) -> Path | None:
    """The file with the fleet of a mission: the one it names, the mission itself, or None; of a
    scenario None, too."""
    source = yaml_file.read(mission, also=("scenario",))
    fleet = source.data.get("fleet") if isinstance(source.data, dict) else None
    if isinstance(fleet, str):
        return mission.parent / fleet
    return None if fleet is None else mission


def with_response(text: str, agent: int, response: Response) -> str:
    """The text of a fleet file, or of a mission with a fleet, with this `response` of `agent`.

    Raises:
        InputError: the text has no entry for the agent, or one that can't be changed here.
    """
    entry = _entry(yaml_file.nodes(text), agent)
    if entry is None:
        raise InputError(f"has no entry for agent {agent}")
    values = {name: f"{value:g}" for name, value in dataclasses.asdict(response).items()}
    changed = text
    for begin, end, new in sorted(_edits(text, entry, values), reverse=True):
        changed = changed[:begin] + new + changed[end:]
    if _plain(changed, agent) != (_plain(text, agent)[0], dataclasses.asdict(response)):
        why = "is written in a way that can't be changed here"
        raise InputError(f"the entry of agent {agent} {why}; add to it {values}")
    return changed


def _plain(text: str, agent: int) -> tuple[Any, Any]:
    """The whole file but the agent's response, and the response."""
    try:
        data = yaml_file.parse(text, "").data
    except MissionError:
        return None, None
    fleet = data.get("fleet") or data
    response = None
    for entry in fleet["agents"]:
        if entry["id"] == agent:
            response = entry.pop("response", None)
    return data, response


def _edits(text: str, entry: MappingNode, values: dict[str, str]) -> Iterator[_Edit]:
    flow = "{" + ", ".join(f"{name}: {value}" for name, value in values.items()) + "}"
    old = _value(entry, "response")
    if old is None:
        yield _added(text, entry, f"response: {flow}")
    elif not isinstance(old, MappingNode):
        begin, end = old.start_mark.index, old.end_mark.index
        yield begin, end, flow if begin < end else f" {flow}"
    elif old.flow_style:
        yield old.start_mark.index, old.end_mark.index, flow
    else:  # lines of their own, with comments: only the numbers change
        missing = [
            f"{name}: {value}" for name, value in values.items() if _value(old, name) is None
        ]
        if missing:
            yield _added(text, old, *missing)
        for name, value in values.items():
            number = _value(old, name)
            if number is not None:
                yield number.start_mark.index, number.end_mark.index, value


def _added(text: str, mapping: MappingNode, *fields: str) -> _Edit:
    """New fields of a mapping: after its last field in braces, else on lines of their own after its
    first scalar."""
    if mapping.flow_style:
        end = mapping.value[-1][1].end_mark.index
        return end, end, "".join(f", {field}" for field in fields)
    first = next(pair for pair in mapping.value if isinstance(pair[1], ScalarNode))
    line = text.find("\n", first[1].end_mark.index)
    newline = "\r\n" if "\r\n" in text else "\n"
    lines = [" " * first[0].start_mark.column + field for field in fields]
    if line < 0:
        return len(text), len(text), newline + newline.join(lines)
    return line + 1, line + 1, "".join(each + newline for each in lines)


def _entry(root: Node | None, agent: int) -> MappingNode | None:
    """The agent's mapping in the `agents` of a fleet, or of the fleet in a mission."""
    fleet = _value(root, "fleet") or root
    agents = _value(fleet, "agents")
    for entry in agents.value if isinstance(agents, SequenceNode) else ():
        number = _value(entry, "id")
        if (
            isinstance(entry, MappingNode)
            and isinstance(number, ScalarNode)
            and number.value == str(agent)
        ):
            return entry
    return None


def _value(mapping: Node | None, key: str) -> Node | None:
    if not isinstance(mapping, MappingNode):
        return None
    return next(
        (
            value
            for name, value in mapping.value
            if isinstance(name, ScalarNode) and name.value == key
        ),
        None,
    )
