"""Foxglove's view of a swarm: its own schemas, filled with what the station's picture says."""

from __future__ import annotations

import inspect
import json
from dataclasses import fields, replace
from itertools import pairwise
from typing import Any

import pytest

from swarm_ctl.core.model.frames import geodetic_from_ned, ned_from_geodetic
from swarm_ctl.core.model.messages import TargetWord
from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.core.model.targets import TargetPlan
from swarm_ctl.recording.topics import Derived
from swarm_ctl.station.foxglove import desk as desks
from swarm_ctl.station.foxglove import messages
from swarm_ctl.station.foxglove.desk import Desk
from tests.unit.station.recorded import PLAN, SILENT_S, said

START_NS = 1_800_000_000_000_000_000


@pytest.fixture(scope="module")
def shown() -> list[Derived]:
    """The minute of `recorded`: six agents fly, agent 3 is silent for ten seconds."""
    desk = Desk(PLAN, START_NS)
    return [made for heard_s, payload in said() for made in desk.hear(payload, heard_s)]


def told(shown: list[Derived], topic: object, until_s: float = 1e9) -> Any:
    """The newest message of a topic at a time."""
    return json.loads([m for m in shown if m.topic is topic and m.time_s <= until_s][-1].data)


def test_fields_are_foxgloves_own() -> None:
    """By its SDK: no field of another name, and none missing but those that are optional."""
    sdk = pytest.importorskip("foxglove.messages", reason="the extra `foxglove` is not installed")
    kinds = [kind for kind in vars(messages).values() if inspect.isclass(kind)]
    assert len(kinds) > 15
    for kind in kinds:
        if kind is messages.Time:  # of two names there
            continue
        ours = {field.name for field in fields(kind)}
        theirs = set(inspect.signature(getattr(sdk, kind.__name__)).parameters)
        assert ours <= theirs, kind
        assert theirs - ours <= {"heading", "metadata", "message_id", "lineage"}, kind


def test_schemas_have_the_names_that_panels_look_for() -> None:
    """A panel takes a topic by the name of its schema; no references within, which old ones do not
    follow."""
    for topic, name in (
        (desks.LOCATION, "foxglove.LocationFix"),
        (desks.TRANSFORMS, "foxglove.FrameTransforms"),
        (desks.VEHICLES, "foxglove.SceneUpdate"),
        (desks.LOG, "foxglove.Log"),
    ):
        assert topic.schema()["title"] == name
        assert "$ref" not in json.dumps(topic.schema())


def test_a_vehicle_is_at_one_place_on_map_and_in_the_scene(shown: list[Derived]) -> None:
    """East, north, up of its position; latitude and longitude about the mission's origin."""
    (moved,) = (
        t for t in told(shown, desks.TRANSFORMS)["transforms"] if "_2" in t["child_frame_id"]
    )
    fixes = [m for m in shown if m.topic is desks.LOCATION and m.agent == 2]
    fix = json.loads(fixes[-1].data)
    (up, east, north) = (moved["translation"][axis] for axis in "zxy")
    place = Geodetic(fix["latitude"], fix["longitude"], fix["altitude"])
    assert ned_from_geodetic(place, PLAN.origin) == pytest.approx((north, east, -up), abs=0.02)
    assert fix["frame_id"] == moved["child_frame_id"] == "agent_2"


def test_a_target_is_in_the_scene_with_the_age_of_its_news() -> None:
    """At its height; grey, once its news is old."""
    desk = Desk(replace(PLAN, targets=(TargetPlan("boat"),)), START_NS)
    at = geodetic_from_ned((60.0, 70.0, -5.0), PLAN.origin)
    word = TargetWord("boat", at.lat_deg, at.lon_deg, 0.25, altitude_m=at.alt_m, station="boat.1")
    shown = [made for heard_s, payload in said() for made in desk.hear(payload, heard_s)]
    last_s = said()[-1][0]
    shown += desk.hear(word, last_s)
    for later_s, words in ((0.5, "boat 0.8 s"), (9.0, "boat 9.2 s")):
        shown += desk.hear(replace(word, name="stranger"), last_s + later_s)
        entities = told(shown, desks.FORMATION)["entities"]
        (boat,) = (e for e in entities if e["id"] == "target boat")
        assert boat["texts"][0]["text"] == words
        place = boat["spheres"][0]["pose"]["position"]
        assert (place["x"], place["y"], place["z"]) == pytest.approx((70.0, 60.0, 5.0), abs=0.05)
    assert told(shown, desks.FIGURES)["targets"][0]["age_s"] == pytest.approx(9.25)


def test_the_scene_has_keep_out_discs_slots_links_and_trails(shown: list[Derived]) -> None:
    """While the formation flies: a disc of radius r_in a vehicle, a slot each, a line an edge."""
    at_s = 39.0
    entities = told(shown, desks.VEHICLES, at_s)["entities"]
    assert [e["frame_id"] for e in entities] == [f"agent_{i}" for i in range(1, 7)]
    assert all(e["cylinders"][0]["size"]["x"] == 2 * PLAN.law.r_in * PLAN.unit_m for e in entities)
    parts = {e["id"]: e for e in told(shown, desks.FORMATION, at_s)["entities"]}
    assert len(parts["slots"]["spheres"]) == 6
    assert len(parts["links"]["lines"][0]["points"]) % 2 == 0
    assert len(told(shown, desks.TRAILS, at_s)["entities"][0]["lines"]) == 6


def test_silence_is_grey_and_stands_in_the_log(shown: list[Derived]) -> None:
    """A lost agent's vehicle is grey, has no setpoint, and the alarm is an error of the log."""
    at_s = SILENT_S[1] - 1.0
    vehicles = told(shown, desks.VEHICLES, at_s)["entities"]
    greys = [e["id"] for e in vehicles if len(set(list(e["cubes"][0]["color"].values())[:3])) == 1]
    assert greys == ["vehicle 3"]
    assert [
        agent["id"] for agent in told(shown, desks.FIGURES, at_s)["agents"] if agent["lost"]
    ] == [3]
    lines = [json.loads(m.data) for m in shown if m.topic is desks.LOG]
    assert any(line["level"] >= 3 and line["name"] == "agent 3" for line in lines)
    assert any("low battery" in line["message"] and line["name"] == "agent 2" for line in lines)


def test_a_late_desk_raises_no_alarm_of_the_time_before_it() -> None:
    """It begins in the middle of a flight in which all agents are heard."""
    desk, middle_s = Desk(PLAN, START_NS), SILENT_S[1] + 2.0
    late = [one for one in said() if middle_s < one[0] < middle_s + 5.0]
    shown = [made for heard_s, payload in late for made in desk.hear(payload, heard_s)]
    assert [json.loads(made.data)["message"] for made in shown if made.topic is desks.LOG] == []


def test_looks_are_bounded(shown: list[Derived]) -> None:
    """At most one in LOOK_S, however many messages come."""
    times = [m.time_s for m in shown if m.topic is desks.FIGURES]
    assert len(times) <= 1 + (times[-1] - times[0]) / (0.5 * desks.LOOK_S)
    gaps = [b - a for a, b in pairwise(times)]
    assert min(gaps) >= 0.5 * desks.LOOK_S
