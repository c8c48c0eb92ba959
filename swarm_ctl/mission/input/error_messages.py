"""Turns pydantic's errors into problems: what is wrong, and what the schema allows instead."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from swarm_ctl.core.model.text import escaped
from swarm_ctl.errors import Problem
from swarm_ctl.mission.input.document import Document, Place, dotted, problem_at
from swarm_ctl.mission.input.near_matches import did_you_mean, nearest, slug

_Schema = Mapping[str, Any]
_NAME = "A-Z, a-z, 0-9, - and _ (no space; at most 40)"
_NAMES = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,39}$"
_OF = {_NAMES: f" of {_NAME},", r"^[A-Za-z0-9 ]{1,12}$": " of A-Z, 0-9 and spaces, at most 12,"}
"""A pattern of the schema in words."""


_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
"""What pydantic calls a field that a section does not have."""
_YAML = {"null": "nothing", "NaN": ".nan", "Infinity": ".inf", "-Infinity": "-.inf"}


def problems_of(
    errors: Iterable[Mapping[str, Any]], document: Document, schema: _Schema
) -> list[Problem]:
    """Entries of `ValidationError.errors()` as problems. A misspelt field that is missing, too, is
    one mistake; a list is not too short because its entries are wrong."""
    errors = list(errors)
    meant = {place for error in errors for place in _meant(error, schema)}
    around = {error["loc"][:k] for error in errors for k in range(len(error["loc"]))}
    said_by = {"missing": meant, "too_short": around}
    return [
        problem_of(error, document, schema)
        for error in errors
        if tuple(error["loc"]) not in said_by.get(error["type"], ())
    ]


def _meant(error: Mapping[str, Any], schema: _Schema) -> Iterator[Place]:
    """Where the field would stand that an unknown one probably means."""
    if error["type"] in _UNKNOWN:
        (*around, word) = error["loc"]
        fields = _find(schema, tuple(around)).get("properties", {})
        yield (*around, nearest(str(word), list(fields)))


def problem_of(error: Mapping[str, Any], document: Document, schema: _Schema) -> Problem:
    """An entry of `ValidationError.errors()` as a problem; `schema` is the model's JSON Schema."""
    loc: Place = tuple(error["loc"])
    place = _place(loc, document.data)
    if error["type"] in _UNKNOWN:
        return _unknown(place, document, schema, _find(schema, loc[:-1]))
    if error["type"] == "missing":
        return document.problem(place, "is missing", describe(schema, _find(schema, loc)))
    if error["type"] in ("union_tag_not_found", "union_tag_invalid"):
        tag = error["ctx"].get("tag")
        kinds = sorted(_find(schema, loc)["discriminator"]["mapping"])
        what = "is missing"
        if tag is not None:
            what = f"{show(tag)} is not a known kind{did_you_mean(str(tag), kinds)}"
        return document.problem((*place, "kind"), what, f"one of {', '.join(kinds)}")
    if loc and loc[-1] == "[key]":
        return document.problem(place, f"can't be a name{_slug(error['input'])}", _NAME)
    if _is_step(place) and isinstance(error["input"], str):
        return _unknown((*place, error["input"]), document, schema, _find(schema, loc))
    if error["type"] == "value_error":
        what, _, allowed = str(error["ctx"]["error"]).partition("; allowed: ")
        if allowed:  # the section's own words
            return document.problem(place, escaped(what), allowed)
    node = _find(schema, loc)
    what = f"{_what(error, node)}{_of_origin(place, document, error['input'])}"
    if error["type"] == "string_pattern_mismatch" and re.search(
        r"\[[0-9a-fA-F:]*\]", error["input"]
    ):
        what += "; IPv6 is not supported, IPv4 only"
    return document.problem(place, what, describe(schema, node))


def _of_origin(place: Place, document: Document, value: Any) -> str:
    """What probably happened to a latitude or longitude that is out of range."""
    if place not in (("origin", "lat_deg"), ("origin", "lon_deg")):
        return ""
    if not isinstance(value, int | float) or not math.isfinite(value):
        return ""
    other = document.data["origin"].get("lon_deg")
    if place[1] == "lat_deg" and isinstance(other, int | float) and abs(other) <= 90:
        return f"; are lat_deg and lon_deg ({other:g}) exchanged?" if abs(value) <= 180 else ""
    return f"; in degrees: {value / 1e7:g}?" if abs(value) > 1e5 else ""


def _is_step(place: Place) -> bool:
    return len(place) == 2 and place[0] == "steps"


def _unknown(place: Place, document: Document, schema: _Schema, section: _Schema) -> Problem:
    """A field, or a step, that `section` does not have."""
    (*around, word), fields = place, section.get("properties", {})
    if not re.fullmatch(r"[\w .-]{1,40}", str(word)):  # a line of another file: not shown
        what = "has a field whose name is no word"
        return document.problem(tuple(around), what, ", ".join(sorted(fields)))
    within = [
        field
        for field in fields
        if word in _deref(schema, fields[field]).get("properties", {})
        and document.has((*around, field))
    ]
    hint = did_you_mean(str(word), list(fields))
    if within:
        hint = f"; it is a field of {within[0]}: indent it further"
    if within or not _is_step(tuple(around)):
        return document.problem(place, f"unknown field{hint}", ", ".join(sorted(fields)))
    if word in fields:
        what = f"{word} lacks its fields"
        return document.problem(tuple(around), what, describe(schema, fields[str(word)]))
    what, where = f"unknown step {show(word)}{hint}", document.where(place)
    return problem_at(where, dotted(tuple(around)), what, ", ".join(fields))


def _slug(text: Any) -> str:
    """The allowed name that is nearest."""
    near = slug(str(text))
    return f"; did you mean {near}?" if near else ""


def show(value: Any) -> str:
    """A value as a file would write it, on one line, shortened."""
    text = json.dumps(value, default=str, ensure_ascii=False)
    text = escaped(text)
    text = _YAML.get(text, text)
    return text if len(text) <= 40 else text[:37] + "..."


def describe(root: _Schema, node: _Schema) -> str:
    """What a node of the schema allows, in a few words."""
    node = _deref(root, node)
    if "const" in node:
        return show(node["const"])
    if "enum" in node:
        return "one of " + ", ".join(str(value) for value in node["enum"])
    if "anyOf" in node:
        return " or ".join(
            describe(root, option) for option in node["anyOf"] if option.get("type") != "null"
        )
    if "oneOf" in node:
        return "a mapping with kind: " + ", ".join(sorted(node["discriminator"]["mapping"]))
    kind = {"number": "a number", "integer": "a whole number", "string": "text"}.get(
        node.get("type", "")
    )
    if kind:
        return kind + _range(node)
    if node.get("type") == "array":
        return _describe_list(node)
    if "properties" in node:
        needed = node.get("required", [])
        others = [name for name in node["properties"] if name not in needed]
        return "a mapping of " + ", ".join([*needed, *others])
    most = f", {node['maxProperties']} at most" if "maxProperties" in node else ""
    return f"a mapping of names to values{most}"


def _what(error: Mapping[str, Any], node: _Schema) -> str:
    value, kind = error["input"], str(error["type"])
    if value is None:
        return "is empty"
    if kind in {"too_short", "too_long"}:
        return f"has {len(value)} entries"
    if kind.endswith(("_type", "_parsing", "_from_float")):
        # a whole file of another kind may be anything, a password's hash included: not shown
        return f"{show(value)} is {_kind_of(value)}" if error["loc"] else f"is {_kind_of(value)}"
    if kind == "finite_number":
        return f"{show(value)} is not a finite number"
    if kind.startswith(("greater_than", "less_than")):
        return f"{show(value)} is out of range"
    near = _slug(value) if node.get("pattern") == _NAMES else ""
    if "enum" in node:
        near = did_you_mean(str(value), [str(each) for each in node["enum"]])
    return f"{show(value)} is not allowed{near}"


def _kind_of(value: Any) -> str:
    if isinstance(value, str):
        looks = re.fullmatch(r"\s*[-+.]?[0-9][-+0-9a-zA-Z_.,: /]*", value)
        hint = ", not a number (write plain decimal digits, no quotes, no unit)"
        return f"text{hint if looks else ''}"
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, Sequence):
        return "a list"
    if isinstance(value, bool):
        return "a truth value"
    return {type(None): "empty", int: "a number", float: "not a whole number"}.get(
        type(value), "of a wrong type"
    )


def _range(node: _Schema) -> str:
    if "examples" in node:
        of = _OF.get(node.get("pattern", ""), "")
        return f"{of} such as " + " or ".join(node["examples"])
    if "minimum" in node and "maximum" in node:
        return f" from {node['minimum']:g} to {node['maximum']:g}"
    words = {"exclusiveMinimum": "above", "minimum": "at least", "maximum": "at most"}
    parts = [f"{word} {node[key]:g}" for key, word in words.items() if key in node]
    return " " + " and ".join(parts) if parts else ""


def _describe_list(node: _Schema) -> str:
    low, high = node.get("minItems"), node.get("maxItems")
    if "prefixItems" in node:
        return f"a list of {low} numbers, [north, east]"
    return f"a list of {low or 0} to {high} entries" if high else "a list"


def _place(loc: Place, data: Any) -> Place:
    """`loc` without the parts that pydantic adds (tags of unions) and `data` does not have."""
    place: list[str | int] = []
    for k, part in enumerate(loc):
        inside = (isinstance(data, Mapping) and part in data) or (
            isinstance(data, tuple) and isinstance(part, int) and part < len(data)
        )
        if inside:
            data = data[part]
        elif k < len(loc) - 1 or part == "[key]":
            continue
        place.append(part)
    return tuple(place)


def _deref(root: _Schema, node: _Schema) -> _Schema:
    while "$ref" in node:
        node = root["$defs"][node["$ref"].rsplit("/", 1)[-1]]
    options = [option for option in node.get("anyOf", ()) if option.get("type") != "null"]
    if len(options) != 1:
        return node
    # An optional value: the examples of the union are examples of the value.
    said = {"examples": node["examples"]} if "examples" in node else {}
    return {**said, **_deref(root, options[0])}


def _find(root: _Schema, loc: Place) -> _Schema:
    """The part of a JSON Schema about `loc` (as pydantic gives it); empty if there is none."""
    node = _deref(root, root)
    for part in loc:
        mapping = node.get("discriminator", {}).get("mapping", {})
        if part in mapping:
            inner = {"$ref": mapping[part]}
        elif isinstance(part, int):
            items = node.get("prefixItems", ())
            inner = items[part] if part < len(items) else node.get("items", {})
        else:
            inner = node.get("properties", {}).get(part) or node.get("additionalProperties") or {}
            names = node.get("patternProperties", {})
            inner = inner or next(iter(names.values()), {})
        node = _deref(root, inner)
    return node
