"""A fleet by itself, and a measured response put into its file: nothing else in the file changes,
comments included."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

from pydantic import ValidationError
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from swarm_ctl.core.law.stop_point import TYPICAL
from swarm_ctl.core.model.plan import Response
from swarm_ctl.errors import InputError, MissionError
from swarm_ctl.mission.compile import checks
from swarm_ctl.mission.compile.fleet import Fleet, FleetAgent
from swarm_ctl.mission.input import document, error_messages
from swarm_ctl.mission.input.document import Document
from swarm_ctl.mission.input.schema import FleetSection

_Edit: TypeAlias = tuple[int, int, str]
"""From here to there (characters of the file) stands this instead."""


def read_fleet(path: Path) -> Fleet:
    """The vehicles of a fleet file, without a mission; MissionError with every mistake in it."""
    source = document.read(path, what="fleet")
    problems = list(source.problems)
    try:
        section = FleetSection.model_validate(source.data)
    except ValidationError as error:
        schema = FleetSection.model_json_schema()
        problems += [
            error_messages.problem_of(dict(each), source, schema) for each in error.errors()
        ]
        raise MissionError(tuple(problems)) from None
    problems += [source.problem(*finding) for finding in checks.fleet(section.agents, ("agents",))]
    if problems:
        raise MissionError(tuple(problems))
    return Fleet(
        tuple(
            FleetAgent(
                entry.id,
                checks.sysid_of(entry),
                entry.autopilot,
                entry.endpoint,
                entry.mesh,
                Response(**entry.response.model_dump())
                if entry.response
                else TYPICAL[entry.autopilot],
            )
            for entry in sorted(section.agents, key=lambda entry: entry.id)
        )
    )


def file_of(mission: Path) -> Path | None:
    """Where the fleet of a mission stands: in a file that it names, in itself, or (None)
    nowhere."""
    source: Document = document.read(mission)
    fleet = source.data.get("fleet") if isinstance(source.data, dict) else None
    if isinstance(fleet, str):
        return mission.parent / fleet
    return None if fleet is None else mission


def with_response(text: str, agent: int, response: Response) -> str:
    """The text of a fleet file, or of a mission with its fleet in it, where `agent` has this
    `response`.

    Raises:
        InputError: it has no entry for the agent.
    """
    entry = _entry(document.nodes(text), agent)
    if entry is None:
        raise InputError(f"has no entry for agent {agent}")
    values = {
        "dead_time_s": f"{response.dead_time_s:g}",
        "lag_s": f"{response.lag_s:g}",
        "acceleration_mps2": f"{response.acceleration_mps2:g}",
    }
    changed = text
    for begin, end, new in sorted(_edits(text, entry, values), reverse=True):
        changed = changed[:begin] + new + changed[end:]
    if _plain(changed, agent) != (_plain(text, agent)[0], dataclasses.asdict(response)):
        raise InputError(
            f"the entry of agent {agent} is written in a way that can't be changed here; add to it {values}"
        )
    return changed


def _plain(text: str, agent: int) -> tuple[Any, Any]:
    """All of the file but the agent's response, and that."""
    try:
        data = document.parse(text, "").data
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
        yield (
            old.start_mark.index,
            old.end_mark.index,
            flow if old.start_mark.index < old.end_mark.index else f" {flow}",
        )
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
    """New fields of a mapping: behind its last one in braces, else on lines of their own behind its
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
