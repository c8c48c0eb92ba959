"""Writes the page of all mission fields from the schema.

python -m tests.unit.docs.mission_reference > docs/look-up/reference.md
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from typing import Any, Final

from swarm_ctl.mission.mission_file import json_schema

COMMAND: Final = "python -m tests.unit.docs.mission_reference > docs/look-up/reference.md"
HEAD: Final = f"""# Mission reference

Every field of a mission file, its values and its default, made from the schema by
`{COMMAND}`.
[Missions](../do/missions.md) says how to write one.

Lengths with a suffix (`_m`) are metres; those without are units of `unit_m` metres, or metres with
`lengths: metres`. A pair is `[north, east]`. Angles are degrees clockwise from north, seen from
above. Where the default is blank, the meaning says what happens without the field.
"""
Schema = dict[str, Any]


def page() -> str:
    """The whole page, as Markdown."""
    schema = json_schema()
    sections = list(_sections(schema))
    headings = {inner["title"]: heading for heading, inner in sections}
    tables = (_section(*found, _Values(schema["$defs"], headings)) for found in sections)
    return HEAD + "".join(tables)


def _sections(schema: Schema) -> Iterator[tuple[str, Schema]]:
    """(heading, schema) of the file, then of each section in the order in which fields name it."""
    definitions = schema["$defs"]
    yield "The file", schema
    seen = set()
    waiting = list(_named(schema))
    while waiting:
        path, name = waiting.pop(0)
        if name in seen or "properties" not in definitions[name]:
            continue
        seen.add(name)
        inner = definitions[name]
        if name != "StepEntry":
            steps = definitions["StepEntry"]["properties"]
            yield _heading(path, inner, is_step=path in steps), inner
        waiting = list(_named(inner, "" if name == "StepEntry" else path)) + waiting


def _named(schema: Schema, path: str = "") -> Iterator[tuple[str, str]]:
    """(path of the field, name of the definition) of each section that a field of `schema` has."""
    for field, body in schema["properties"].items():
        for name in _references(body):
            yield f"{path}.{field}".lstrip("."), name


def _references(body: Any) -> Iterator[str]:
    if isinstance(body, dict):
        if "$ref" in body:
            yield body["$ref"].rsplit("/", 1)[1]
        for key, value in body.items():
            if key not in ("discriminator", "default"):
                yield from _references(value)
    elif isinstance(body, list):
        for value in body:
            yield from _references(value)


def _heading(path: str, schema: Schema, *, is_step: bool) -> str:
    kind = schema["properties"].get("kind", {}).get("const")
    return f"Shape: {kind}" if kind else f"Step: {path}" if is_step else path


def _section(heading: str, schema: Schema, values: _Values) -> str:
    lines = [f"\n## {heading}\n", schema.get("description", "").replace("\n", " "), ""]
    lines += ["| field | values | default | meaning |", "|---|---|---|---|"]
    required = schema.get("required", ())
    for field, body in schema["properties"].items():
        if field != "kind":
            meaning = body.get("description", "").replace("\n", " ")
            row = (f"`{field}`", values.of(body), _default(body, field in required), meaning)
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |")
    return "\n".join(lines) + "\n"


def _default(body: Schema, required: bool) -> str:
    if required:
        return "required"
    default = body.get("default")
    if default is None or isinstance(default, dict | list):
        return ""
    return f"`{str(default).lower() if isinstance(default, bool) else default}`"


class _Values:
    """What may be written into a field: `0.1 to 20`, `land, return`, a section by its link."""

    def __init__(self, definitions: dict[str, Schema], headings: dict[str, str]) -> None:
        self._definitions, self._headings = definitions, headings

    def of(self, body: Schema) -> str:
        found = [self._value(part) for part in body.get("anyOf", body.get("oneOf", [body]))]
        return " or ".join(text for text in dict.fromkeys(found) if text)

    def _value(self, body: Schema) -> str:
        if "$ref" in body:
            return self._named(body["$ref"].rsplit("/", 1)[1])
        if "enum" in body:
            return ", ".join(f"`{value}`" for value in body["enum"])
        if "const" in body:
            return f"`{body['const']}`"
        kind = body.get("type", "")
        if kind in ("number", "integer"):
            return _range(body)
        if kind == "array":
            return self._array(body)
        return {"boolean": "`true`, `false`", "string": "text", "object": "by name"}.get(kind, "")

    def _named(self, name: str) -> str:
        definition = self._definitions[name]
        if "enum" in definition:
            return self._value(definition)
        heading = self._headings.get(name, "")
        slug = re.sub(r"[^\w\s-]", "", heading).lower().replace(" ", "-")
        return f"[{heading}](#{slug})" if heading else ""

    def _array(self, body: Schema) -> str:
        if "prefixItems" in body:
            return "a pair"
        items = body.get("items", {})
        of = "pairs" if "prefixItems" in items else self.of(items) if "$ref" in items else ""
        return f"a list of {of}" if of else "a list"


def _range(body: Schema) -> str:
    least, over, most = body.get("minimum"), body.get("exclusiveMinimum"), body.get("maximum")
    whole = "integer, " if body["type"] == "integer" else ""
    return f"{whole}{least:g} to {most:g}" if over is None else f"above {over:g}, at most {most:g}"


if __name__ == "__main__":
    sys.stdout.write(page())
