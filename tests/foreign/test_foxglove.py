"""Foxglove at a flight and with its recording: by its websocket protocol, its schemas' names, and
the layout of docs/."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from swarm_ctl.recording import RECORDING
from tests.system.running import ROOT

pytest.importorskip("foxglove", reason="the extra `foxglove` is not installed")

from tests.foreign.conftest import Flight
from tests.foreign.foxglove_client import PROTOCOL, FoxgloveClient

pytestmark = [pytest.mark.lockstep, pytest.mark.timeout(200)]

LAYOUT = ROOT / "docs" / "do" / "foxglove-layout.json"
PANELS = {"3D", "map", "Plot", "Table", "RosOut"}
"""Foxglove's names of its panels; RosOut is the log."""
OWN_SCHEMAS = {
    "/tf": "foxglove.FrameTransforms",
    "/scene/vehicles": "foxglove.SceneUpdate",
    "/scene/formation": "foxglove.SceneUpdate",
    "/scene/trails": "foxglove.SceneUpdate",
    "/agent/1/location": "foxglove.LocationFix",
    "/log": "foxglove.Log",
}


@pytest.fixture
def client(flight: Flight) -> FoxgloveClient:
    """It has watched the whole flight."""
    assert flight.client is not None
    return flight.client


@pytest.fixture
def recording(flight: Flight) -> Path:
    """That of the same flight."""
    return flight.folder / RECORDING


def test_a_client_sees_the_flight(client: FoxgloveClient) -> None:
    """Its own schemas and our channels are advertised; the messages tell of a flight, in the
    mission's time."""
    assert client.protocol == PROTOCOL
    assert client.info["name"] == "hexagon"
    found = {channel["topic"]: channel for channel in client.channels.values()}
    assert {topic: found[topic]["schemaName"] for topic in OWN_SCHEMAS} == OWN_SCHEMAS
    assert {"/agent/3/state", "/agent/2/status", "/swarm"} <= found.keys()
    for channel in found.values():
        assert (channel["encoding"], channel["schemaEncoding"]) == ("json", "jsonschema")
        assert json.loads(channel["schema"])["type"] == "object"
    moved = [json.loads(data)["transforms"] for _, data in client.messages["/tf"]]
    heights = [vehicle["translation"]["z"] for vehicles in moved for vehicle in vehicles]
    assert max(heights) == pytest.approx(4.0, abs=0.3)
    lines = [json.loads(data)["message"] for _, data in client.messages["/log"]]
    assert any(re.fullmatch("event: step .*: land", line) for line in lines), lines
    times = [time_ns for time_ns, _ in client.messages["/swarm"]]
    assert times == sorted(times)
    assert (times[-1] - times[0]) / 1e9 > 10.0


def test_the_server_takes_nothing_and_is_on_loopback(client: FoxgloveClient) -> None:
    """It advertises no capability but the time; no other computer reaches it."""
    assert client.info["capabilities"] == ["time"]
    assert client.listening == {"127.0.0.1"}


def test_the_recording_has_the_same_topics(client: FoxgloveClient, recording: Path) -> None:
    """By mcap's own reader: what was live is in the file, with the same schemas."""
    schemas = {topic: schema["title"] for topic, schema in recorded(recording).items()}
    names = {channel["topic"]: channel["schemaName"] for channel in client.channels.values()}
    live = {topic: names[topic] for topic in client.messages}
    assert live.items() <= schemas.items()


def test_every_message_of_a_recording_is_what_its_schema_says(recording: Path) -> None:
    """PlotJuggler takes a channel whose encoding is `json` and reads it without a schema; Foxglove
    reads it by the schema. Every hundredth message of a topic, and the first; null is not told."""
    jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")
    checkers: dict[str, Any] = {}
    seen: Counter[str] = Counter()
    with recording.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert channel.message_encoding == "json"
            if schema.name not in checkers:
                checkers[schema.name] = jsonschema.Draft202012Validator(json.loads(schema.data))
            if seen[channel.topic] % 100 == 0:
                checkers[schema.name].validate(told(json.loads(message.data)))
            seen[channel.topic] += 1
    assert len(seen) > 15


def test_the_layout_shows_what_a_recording_has(recording: Path) -> None:
    """Every panel is one that Foxglove has and stands in the layout; every topic is recorded, and
    every plotted field is in its schema."""
    schemas = recorded(recording)
    layout = json.loads(LAYOUT.read_text())
    panels = layout["configById"]
    assert sorted(leaves(layout["layout"])) == sorted(panels)
    assert {name.partition("!")[0] for name in panels} == PANELS
    for name, panel in panels.items():
        paths = wanted(panel)
        assert paths, name
        for path in paths:
            assert_shown(path, schemas)


def recorded(recording: Path) -> dict[str, Any]:
    """The schemas of the topics that have messages."""
    with recording.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    return {
        channel.topic: json.loads(summary.schemas[channel.schema_id].data)
        for channel in summary.channels.values()
        if summary.statistics.channel_message_counts[channel.id]
    }


def told(node: Any) -> Any:
    """Without what is null: our schemas say of it what it is when it is known."""
    if isinstance(node, dict):
        return {name: told(value) for name, value in node.items() if value is not None}
    return [told(value) for value in node] if isinstance(node, list) else node


def leaves(node: Any) -> list[str]:
    """The panels of a split of the window."""
    return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]


def wanted(panel: dict[str, Any]) -> list[str]:
    """The message paths that a panel shows."""
    single = [panel[key] for key in ("topicPath", "topicToRender", "followTopic") if key in panel]
    return [*single, *panel.get("topics", ()), *(path["value"] for path in panel.get("paths", ()))]


def assert_shown(path: str, schemas: dict[str, Any]) -> None:
    """`/topic.field[:]{id==1}.field` is in the recording."""
    topic, *names = path.split(".")
    assert topic in schemas, path
    node = schemas[topic]
    for name in names:
        node = node["properties"][re.match(r"\w+", name)[0]]  # type: ignore[index]
        node = node.get("items", node)
