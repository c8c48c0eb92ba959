"""The topics of a recording in one table, with their payloads and schemas.

Messages are JSON with their schema in the file. `log_time` is when the station heard a message,
`publish_time` when it was sent: mission time, counted from the Unix time of the run's start [ns].
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from pydantic import TypeAdapter

from swarm_ctl.core.model.messages import (
    Ack,
    AgentState,
    AgentStatus,
    Command,
    Event,
    Phase,
    SigmaReport,
    StationBeacon,
    TargetWord,
)
from swarm_ctl.errors import InputError


@dataclass(frozen=True, slots=True)
class Topic:
    """One row: `{id}` is the agent's id."""

    name: str
    template: str
    payload: type[Any] | None
    """The type that `read` gives; None: derived from another topic, or not from the mesh."""
    schema: Callable[[], Mapping[str, Any]]
    """Worked out when it is asked for: most processes write no recording."""


@dataclass(frozen=True, slots=True)
class Derived:
    """A message made from those of the mesh."""

    topic: Topic
    agent: int | None
    time_s: float
    """Mission time."""
    data: bytes
    """JSON."""


@dataclass(frozen=True, slots=True)
class SetpointRecord:
    """The velocity (north, east) [m/s] an agent commands, and the one its vehicle has; a part of
    its state."""

    time_s: float
    setpoint_north_mps: float
    setpoint_east_mps: float
    achieved_north_mps: float
    achieved_east_mps: float


_PHASES: Final = ", ".join(f"{phase.value} {phase.name.lower()}" for phase in Phase)


def plain_schema(kind: type[Any]) -> Mapping[str, Any]:
    """The JSON Schema of a payload as viewers know it: no references, no unions, one type a node.

    A value that may be null has the type of its other values and is not required.
    """
    found = _SCHEMAS.get(kind)
    if found is None:
        schema = adapter(kind).json_schema(mode="serialization")
        plain = _plain(schema, schema.get("$defs", {}))
        found = _SCHEMAS[kind] = {"title": kind.__name__} | plain
    return found


_SCHEMAS: Final[dict[type[Any], Mapping[str, Any]]] = {}
"""Each takes up to 35 ms on a slow machine; a foxglove server asks for it once for each agent."""


def adapter(kind: type[Any]) -> TypeAdapter[Any]:
    """What reads and writes the JSON of a topic's payload."""
    found = _ADAPTERS.get(kind)
    if found is None:
        found = _ADAPTERS[kind] = TypeAdapter(kind)
    return found


_ADAPTERS: Final[dict[type[Any], TypeAdapter[Any]]] = {}


def _plain(node: Any, definitions: Mapping[str, Any]) -> Any:
    if "$ref" in node:
        name = node["$ref"].rpartition("/")[2]
        said = {"description": _PHASES} if name == Phase.__name__ else {}
        return _plain(definitions[name], definitions) | said
    if "anyOf" in node:
        kinds = [kind for kind in node["anyOf"] if kind.get("type") != "null"]
        return _plain(kinds[0] if len(kinds) == 1 else {"oneOf": kinds}, definitions)
    if "oneOf" in node:
        return _merged([_plain(kind, definitions) for kind in node["oneOf"]])
    kept = {key: node[key] for key in ("type", "description") if key in node}
    if node.get("type") == "array":
        items = node.get("items") or node["prefixItems"][0]
        kept["items"] = _plain(items, definitions)
    if node.get("type") == "object":
        properties = node.get("properties", {})
        kept["properties"] = {
            name: _plain(field, definitions) for name, field in properties.items()
        }
        if isinstance(node.get("additionalProperties"), dict):
            kept["additionalProperties"] = _plain(node["additionalProperties"], definitions)
        kept["required"] = [
            name for name in node.get("required", ()) if "anyOf" not in properties[name]
        ]
    return kept


def _merged(kinds: list[Any]) -> Any:
    """One object with the fields of several kinds; a message has those of its `kind`."""
    if any(kind["type"] != "object" for kind in kinds):
        return kinds[0]
    properties = {name: field for kind in kinds for name, field in kind["properties"].items()}
    common = set.intersection(*(set(kind["required"]) for kind in kinds))
    return {"type": "object", "properties": properties, "required": sorted(common)}


def _list_of(items: dict[str, Any], description: str = "") -> dict[str, Any]:
    return {"type": "array", "items": items, "description": description}


_NUMBER: Final = {"type": "number"}
_TRUTH: Final = {
    "title": "Truth",
    "type": "object",
    "description": "A line of the simulator's truth file: state, min, event, header or end.",
    "properties": {
        "type": {"type": "string"},
        "t": {"type": "number", "description": "Mission time [s]."},
        "sysids": _list_of({"type": "integer"}, "Of the vehicles, in the order of all lists."),
        "ned": _list_of(_list_of(_NUMBER), "Per vehicle, north, east, down [m]."),
        "vel": _list_of(_list_of(_NUMBER), "Per vehicle [m/s]."),
        "armed": _list_of({"type": "integer"}, "Per vehicle, 0 or 1."),
        "airborne": _list_of({"type": "integer"}, "Per vehicle, 0 or 1."),
        "pairs": _list_of(_list_of(_NUMBER), "(sysid, sysid, metres)."),
        "sysid": {"type": "integer"},
        "event": {"type": "string"},
    },
    "required": ["type", "t"],
}


def _topic(name: str, template: str, payload: type[Any]) -> Topic:
    return Topic(name, template, payload, partial(plain_schema, payload))


TOPICS: Final = (
    _topic("state", "/agent/{id}/state", AgentState),
    Topic("setpoint", "/agent/{id}/setpoint", None, partial(plain_schema, SetpointRecord)),
    _topic("status", "/agent/{id}/status", AgentStatus),
    _topic("sigma", "/agent/{id}/sigma", SigmaReport),
    _topic("event", "/agent/{id}/event", Event),
    _topic("ack", "/agent/{id}/ack", Ack),
    _topic("command", "/command", Command),
    _topic("beacon", "/beacon", StationBeacon),
    _topic("target", "/target", TargetWord),
    Topic("truth", "/truth", None, lambda: _TRUTH),
)
"""`status` has the agent's mesh links (age, loss) by peer."""

BY_NAME: Final = {topic.name: topic for topic in TOPICS}
BY_PAYLOAD: Final = {topic.payload: topic for topic in TOPICS if topic.payload is not None}


def rates(words: str) -> dict[str, float]:
    """Rates [Hz] by topic, of `state=5,truth=2`; InputError says what is allowed."""
    found = {}
    for word in filter(None, words.split(",")):
        name, _, hz = word.partition("=")
        try:
            rate = float(hz)
        except ValueError:
            rate = -1.0
        if name not in BY_NAME or not 0 <= rate <= 1000:
            allowed = f"NAME=HZ with 0 to 1000 (0: all), NAME one of {', '.join(BY_NAME)}"
            raise InputError(f"rate {word!r}: allowed: {allowed}")
        found[name] = rate
    return found
