"""Zones of GeoJSON, KML and QGroundControl's plans: read as they were written, mistakes by
feature."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.errors import MissionError
from swarm_ctl.mission.compile.loader import LoadedMission, load
from swarm_ctl.mission.input.zone_files import areas_of, written
from tests.unit.mission.example import TEXT

ZONES = """\
zones:
  oak: {circle: [20, 10], radius: 0.5, clearance_m: 2}
  house: {polygon: [[12, 24], [16, 24], [16, 28], [12, 28]], floor_m: 1.5, ceiling_m: 30}
fence: {polygon: [[-20, -20], [40, -20], [40, 40], [-20, 40]], height_m: 50}
"""
RING = [[149.17, -35.35], [149.18, -35.35], [149.18, -35.34], [149.17, -35.35]]


def mission(folder: Path, zones: str) -> LoadedMission:
    path = folder / "mission.yaml"
    path.write_text(TEXT + zones)
    return load(path)


def of_file(folder: Path, name: str, text: str) -> LoadedMission:
    (folder / name).write_text(text)
    return mission(folder, f"zones: {name}\n")


def feature(**changes: Any) -> str:
    made = {"type": "Feature", "properties": {"name": "wood"}}
    made["geometry"] = {"type": "Polygon", "coordinates": [RING]}
    return json.dumps({"type": "FeatureCollection", "features": [made | changes]})


@pytest.mark.parametrize("kind", [".geojson", ".kml", ".plan"])
def test_what_is_written_is_read_again(kind: str, tmp_path: Path) -> None:
    """To a millimetre; a plan of QGroundControl has no heights, and no names."""
    plan = mission(tmp_path, ZONES).plan
    again = of_file(tmp_path, f"field{kind}", written(areas_of(plan), kind, plan.origin)).plan
    assert again.fence is not None
    assert plan.fence is not None
    zones = sorted(plan.zones, key=lambda zone: zone.radius_m)
    for ours, theirs in zip(
        zones, sorted(again.zones, key=lambda zone: zone.radius_m), strict=True
    ):
        assert theirs.radius_m == pytest.approx(ours.radius_m, abs=1e-3)
        for a, b in zip(ours.corners_m, theirs.corners_m, strict=True):
            assert a == pytest.approx(b, abs=2e-3)
        if kind != ".plan":
            assert (ours.name, ours.floor_m, ours.ceiling_m, ours.clearance_m) == (
                theirs.name,
                theirs.floor_m,
                theirs.ceiling_m,
                theirs.clearance_m,
            )
    for a, b in zip(plan.fence.polygon_m, again.fence.polygon_m, strict=True):
        assert a == pytest.approx(b, abs=2e-3)


def test_the_fence_that_a_mission_draws_is_its_fence(tmp_path: Path) -> None:
    plan = mission(tmp_path, ZONES).plan
    (tmp_path / "a.geojson").write_text(written(areas_of(plan), ".geojson", plan.origin))
    fence = "fence: {polygon: [[-30, -30], [50, -30], [50, 50], [-30, 50]]}\n"
    drawn = mission(tmp_path, f"zones: a.geojson\n{fence}").plan
    assert drawn.fence is not None
    assert drawn.fence.polygon_m[0] == (-150.0, -150.0)


def test_a_circle_to_stay_inside_of_is_a_polygon_inside_of_it(tmp_path: Path) -> None:
    circle = {"center": [-35.36, 149.16], "radius": 90.0}
    fence = {"circles": [{"circle": circle, "inclusion": True}], "polygons": [], "version": 2}
    plan = of_file(tmp_path, "a.plan", json.dumps({"geoFence": fence})).plan
    assert plan.fence is not None
    assert len(plan.fence.polygon_m) == 32
    assert max(n * n + e * e for n, e in plan.fence.polygon_m) == pytest.approx(8100, rel=1e-3)


KEYS = [
    *("type", "features", "geometry", "coordinates", "properties", "radius", "polygons"),
    *("geoFence", "version", "circles", "circle", "center", "inclusion", "polygon"),
]
WRONG = {
    "torn": ("a.geojson", "{", "line 1", "is no JSON"),
    "no features": ("a.geojson", "{}", "a.geojson", "is no GeoJSON"),
    "a line": (
        "a.geojson",
        feature(geometry={"type": "LineString", "coordinates": RING}),
        "feature 1 (wood)",
        "is a LineString",
    ),
    "a hole": (
        "a.geojson",
        feature(geometry={"type": "Polygon", "coordinates": [RING, RING]}),
        "feature 1 (wood)",
        "has a hole",
    ),
    "exchanged": (
        "a.geojson",
        feature(geometry={"type": "Polygon", "coordinates": [[at[::-1] for at in RING]]}),
        "feature 1 (wood)",
        "has a corner at latitude 149.17, longitude -35.35",
    ),
    "two corners": (
        "a.geojson",
        feature(geometry={"type": "Polygon", "coordinates": [RING[:2]]}),
        "feature 1 (wood)",
        "has 2 corners",
    ),
    "a height that is none": (
        "a.geojson",
        feature(properties={"floor_m": "high"}),
        "feature 1",
        "floor_m is no number",
    ),
    "a point": (
        "a.geojson",
        feature(geometry={"type": "Point", "coordinates": RING[0]}),
        "feature 1 (wood)",
        "is a point without radius",
    ),
    "another plan": ("a.plan", "{}", "a.plan", "has no geoFence"),
    "an old plan": ("a.plan", '{"geoFence": {"version": 1}}', "a.plan", "geoFence has version 1"),
    "no inclusion": (
        "a.plan",
        '{"geoFence": {"version": 2, "polygons": [{"polygon": []}]}}',
        "polygon 1",
        "says not whether it is an inclusion",
    ),
    "entities": ("a.kml", "<!DOCTYPE x><kml/>", "a.kml", "declares entities"),
    "no XML": ("a.kml", "<kml>\n<", "line 2", "is no XML"),
    "no placemarks": ("a.kml", "<kml/>", "a.kml", "has no placemarks"),
    "a path": (
        "a.kml",
        "<kml><Placemark><name>way</name><LineString/></Placemark></kml>",
        "placemark 1 (way)",
        "has no Polygon",
    ),
}


@pytest.mark.parametrize(("name", "text", "where", "what"), WRONG.values(), ids=WRONG)
def test_a_mistake_is_named_by_its_feature(
    name: str, text: str, where: str, what: str, tmp_path: Path
) -> None:
    with pytest.raises(MissionError) as caught:
        of_file(tmp_path, name, text)
    (problem,) = caught.value.problems
    assert where in problem.where
    assert what in problem.what
    assert problem.allowed


def test_two_fences_are_one_too_many(tmp_path: Path) -> None:
    polygon = {"polygon": [at[::-1] for at in RING], "inclusion": True}
    fence = {"circles": [], "polygons": [polygon, polygon], "version": 2}
    with pytest.raises(MissionError, match="2 areas are to stay inside of: polygon 1, polygon 2"):
        of_file(tmp_path, "a.plan", json.dumps({"geoFence": fence}))


@pytest.mark.parametrize("name", ["../a.kml", "none.kml", "a.csv"])
def test_a_file_that_is_not_there_or_outside_or_of_another_kind(name: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("")
    with pytest.raises(MissionError) as caught:
        mission(tmp_path, f"zones: {name}\n")
    (problem,) = caught.value.problems
    assert problem.field == "zones"
    assert "can't be read" in problem.what


@settings(max_examples=150, deadline=None)
@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(
                st.sampled_from(KEYS),
                inner | st.sampled_from(["Feature", "FeatureCollection", "Polygon", "Point", 2]),
                max_size=5,
            )
        ),
        max_leaves=12,
    )
)
def test_whatever_a_file_has_is_read_or_refused(data: Any) -> None:
    """Never another error."""
    from swarm_ctl.mission.input import zone_files

    for kind in (zone_files._plan, zone_files._geojson):
        try:
            zone_files._collected(kind(data))
        except zone_files._WrongError:
            continue
