"""The JSON Schema for editors says what the loader does."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from swarm_ctl.mission.mission_file import MissionFile, json_schema


def nodes(value: Any) -> Iterator[dict[str, Any]]:
    if isinstance(value, dict):
        yield value
        for inner in value.values():
            yield from nodes(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from nodes(inner)


def test_it_is_json_and_all_its_references_lead_somewhere() -> None:
    schema = json_schema()
    assert json.loads(json.dumps(schema, allow_nan=False)) == schema
    references = [node["$ref"] for node in nodes(schema) if isinstance(node.get("$ref"), str)]
    assert references
    assert {ref.removeprefix("#/$defs/") for ref in references} <= set(schema["$defs"])


def test_unknown_fields_are_refused_in_every_section() -> None:
    sections = [
        node
        for node in nodes(json_schema())
        if node.get("type") == "object" and "properties" in node
    ]
    assert len(sections) > 15
    assert all(section["additionalProperties"] is False for section in sections)


def test_the_short_forms_an_operator_may_write_are_in_it() -> None:
    properties = json_schema()["properties"]
    assert {"enum": ["land", "return"]} in properties["steps"]["items"]["anyOf"]
    assert any(option.get("type") == "string" for option in properties["fleet"]["anyOf"])


def test_every_section_says_what_it_is() -> None:
    assert all(
        MissionFile.model_json_schema()["$defs"][name].get("description")
        for name in ("LawSection", "FormSection", "RingShape")
    )
