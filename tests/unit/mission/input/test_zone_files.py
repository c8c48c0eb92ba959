"""Zones of GeoJSON, KML and QGroundControl's plans: read as they were written, mistakes by
feature."""

from __future__ import annotations

import json
import math
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.errors import MissionError
from swarm_ctl.mission.compile.loader import LoadedMission, load
from swarm_ctl.mission.input.zone_writing import areas_of, lost_in, written
from tests.unit.mission.example import TEXT

ZONES = """\
zones:
  oak: {circle: [20, 10], radius: 0.5, clearance_m: 2}
  house:
    {polygon: [[12, 24], [16, 24], [16, 28], [12, 28]], floor_m: 1.5, ceiling_m: 30, clearance_m: 3}
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


def drawn(kind: str, coordinates: Any) -> str:
    return feature(geometry={"type": kind, "coordinates": coordinates})


KINDS = [".geojson", ".kml", ".plan"]


@pytest.mark.parametrize("second", KINDS)
@pytest.mark.parametrize("first", KINDS)
def test_what_is_written_is_read_again(first: str, second: str, tmp_path: Path) -> None:
    """By way of any two kinds, to a millimetre: names, floors, ceilings and clearances where both
    have them. A plan of QGroundControl has none, and that is told."""
    plan = mission(tmp_path, ZONES).plan
    once = of_file(tmp_path, f"one{first}", written(areas_of(plan), first, plan.origin)).plan
    again = of_file(tmp_path, f"two{second}", written(areas_of(once), second, plan.origin)).plan
    assert again.fence is not None
    assert plan.fence is not None
    zones = sorted(plan.zones, key=lambda zone: zone.radius_m)
    for ours, theirs in zip(
        zones, sorted(again.zones, key=lambda zone: zone.radius_m), strict=True
    ):
        assert theirs.radius_m == pytest.approx(ours.radius_m, abs=1e-3)
        for a, b in zip(ours.corners_m, theirs.corners_m, strict=True):
            assert a == pytest.approx(b, abs=2e-3)
        for field in ("name", "floor_m", "ceiling_m", "clearance_m"):
            kept = getattr(ours, field) == getattr(theirs, field)
            had = getattr(ours, field) is not None
            assert kept is not (had and ".plan" in (first, second)), field
    for a, b in zip(plan.fence.polygon_m, again.fence.polygon_m, strict=True):
        assert a == pytest.approx(b, abs=2e-3)
    lost = ["names", "floors", "ceilings", "clearances"] if first == ".plan" else []
    assert lost_in(plan, first) == [*lost, "the fence's height"]


def test_a_circle_to_stay_inside_of_is_a_polygon_inside_of_it(tmp_path: Path) -> None:
    circle = {"center": [-35.36, 149.16], "radius": 90.0}
    fence = {"circles": [{"circle": circle, "inclusion": True}], "polygons": [], "version": 2}
    plan = of_file(tmp_path, "a.plan", json.dumps({"geoFence": fence})).plan
    assert plan.fence is not None
    assert len(plan.fence.polygon_m) == 32
    assert max(n * n + e * e for n, e in plan.fence.polygon_m) == pytest.approx(8100, rel=1e-3)


def placemark(shape: str, **data: str) -> str:
    given = "".join(f'<Data name="{k}"><value>{v}</value></Data>' for k, v in data.items())
    mark = f"<name>oak</name><ExtendedData>{given}</ExtendedData>{shape}"
    space = 'xmlns="http://www.opengis.net/kml/2.2"'
    return f"<kml {space}><Document><Placemark>{mark}</Placemark></Document></kml>"


def outer(ring: list[list[float]]) -> str:
    at = " ".join(f"{lon},{lat},0" for lon, lat in ring)
    ring_of = f"<LinearRing><coordinates>{at}</coordinates></LinearRing>"
    return f"<outerBoundaryIs>{ring_of}</outerBoundaryIs>"


OUTER = outer(RING)
PLAN_OF_A_CIRCLE = """\
{"geoFence": {"version": 2, "circles": [{"inclusion": false, "circle": {"center": [-35.36, 149.16],
"radius": %s}}]}}"""
KEYS = [
    *("type", "features", "geometry", "coordinates", "properties", "radius", "polygons"),
    *("geoFence", "version", "circles", "circle", "center", "inclusion", "polygon"),
]
WRONG = {
    "torn": ("a.geojson", "{", "line 1", "is no JSON"),
    "no features": ("a.geojson", "{}", "a.geojson", "is no GeoJSON"),
    "a line": ("a.geojson", drawn("LineString", RING), "feature 1 (wood)", "is a LineString"),
    "a hole": ("a.geojson", drawn("Polygon", [RING, RING]), "feature 1 (wood)", "has a hole"),
    "exchanged": (
        "a.geojson",
        drawn("Polygon", [[at[::-1] for at in RING]]),
        "feature 1 (wood)",
        "has a corner at latitude 149.17, longitude -35.35",
    ),
    "two corners": ("a.geojson", drawn("Polygon", [RING[:2]]), "feature 1 (wood)", "has 2 corners"),
    "a height that is none": (
        "a.geojson",
        feature(properties={"floor_m": "high"}),
        "feature 1",
        'floor_m is "high", no number',
    ),
    "a height of 401 digits": (
        "a.geojson",
        feature(properties={"floor_m": int("9" * 401)}),
        "feature 1",
        "floor_m is no finite number",
    ),
    "a radius of 5000 digits": (
        "a.plan",
        PLAN_OF_A_CIRCLE % ("9" * 5000),
        "circle 1",
        "radius is no finite number",
    ),
    "a height out of range": (
        "a.geojson",
        feature(properties={"name": "oak", "ceiling_m": 600}),
        "a.geojson: feature 1 (oak)",
        "600.0 is out of range",
    ),
    "far away": (
        "a.geojson",
        drawn("Polygon", [[[8, 48], [8.1, 48], [8, 48.1]]]),
        "feature 1 (wood)",
        "km from the mission's origin",
    ),
    "truth in quotes": (
        "a.geojson",
        feature(properties={"name": "oak", "inclusion": "true"}),
        "feature 1 (oak)",
        'inclusion is "true"',
    ),
    "truth as a number": (
        "a.geojson",
        feature(properties={"inclusion": 1}),
        "feature 1",
        "inclusion is 1",
    ),
    "a fence with a ceiling": (
        "a.geojson",
        feature(properties={"inclusion": True, "ceiling_m": 50}),
        "feature 1",
        "is to stay inside of, and gives ceiling_m",
    ),
    "no features in it": (
        "a.geojson",
        '{"type": "FeatureCollection", "features": []}',
        "a.geojson",
        "has no zone in it",
    ),
    "no polygons in it": (
        "a.geojson",
        drawn("MultiPolygon", []),
        "feature 1 (wood)",
        "has no polygon in it",
    ),
    "a level too little": (
        "a.geojson",
        drawn("MultiPolygon", [RING, RING]),
        "feature 1 (wood)",
        "its coordinates are nested 1 level too little",
    ),
    "a level too deep": (
        "a.geojson",
        drawn("Polygon", [[RING]]),
        "feature 1 (wood)",
        "its coordinates are nested 1 level too deep",
    ),
    "metres": (
        "a.geojson",
        json.dumps(
            json.loads(feature())
            | {"crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32755"}}}
        ),
        "a.geojson",
        'has the crs "urn:ogc:def:crs:EPSG::32755"',
    ),
    "a point": (
        "a.geojson",
        drawn("Point", RING[0]),
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
    "no list of polygons": (
        "a.plan",
        '{"geoFence": {"version": 2, "polygons": null, "circles": []}}',
        "a.plan",
        "geoFence.polygons is null",
    ),
    "an empty fence": (
        "a.plan",
        '{"geoFence": {"version": 2, "polygons": [], "circles": []}}',
        "a.plan",
        "has no zone in it",
    ),
    "two outer boundaries": (
        "a.kml",
        placemark(f"<Polygon>{OUTER}{OUTER}</Polygon>"),
        "placemark 1 (oak)",
        "has a Polygon of 2 outerBoundaryIs",
    ),
    "no outer boundary": (
        "a.kml",
        placemark("<Polygon><coordinates>1,2 3,4 5,6</coordinates></Polygon>"),
        "placemark 1 (oak)",
        "has a Polygon of 0 outerBoundaryIs",
    ),
    "a truth that is none": (
        "a.kml",
        placemark(f"<Polygon>{OUTER}</Polygon>", inclusion="yes"),
        "placemark 1 (oak)",
        'inclusion is "yes"',
    ),
    "a line beside a polygon": (
        "a.kml",
        placemark(f"<MultiGeometry><LineString/><Polygon>{OUTER}</Polygon></MultiGeometry>"),
        "placemark 1 (oak)",
        "has a LineString beside its polygon",
    ),
    "a point of two places": (
        "a.kml",
        placemark("<Point><coordinates>1,2 3,4</coordinates></Point>", radius="5"),
        "placemark 1 (oak)",
        "has a Point of 2 places",
    ),
    "entities": ("a.kml", "<!DOCTYPE x><kml/>", "a.kml", "declares entities"),
    "no XML": ("a.kml", "<kml>\n<", "line 2", "is no XML"),
    "no placemarks": ("a.kml", "<kml/>", "a.kml", "has no placemarks"),
    "a path": (
        "a.kml",
        "<kml><Placemark><name>way</name><LineString/></Placemark></kml>",
        "placemark 1 (way)",
        "is a LineString",
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


def square(name: str, k: int) -> dict[str, Any]:
    """A feature of its own place."""
    lon, lat = 149.17, -35.36 + 0.001 * k
    ring = [[lon, lat], [lon + 0.0005, lat], [lon + 0.0005, lat + 0.0005], [lon, lat]]
    geometry = {"type": "Polygon", "coordinates": [ring]}
    return {"type": "Feature", "properties": {"name": name}, "geometry": geometry}


@settings(max_examples=15, deadline=None)
@given(
    st.lists(st.sampled_from(["a", "a-2", "a-3", "b", "", "é", "zone-2"]), min_size=1, max_size=6)
)
def test_no_zone_is_lost_by_its_name(names: list[str]) -> None:
    """`a-3`, `a` and `a` were two zones."""
    features = [square(name, k) for k, name in enumerate(names)]
    text = json.dumps({"type": "FeatureCollection", "features": features})
    with tempfile.TemporaryDirectory() as folder:
        zones = of_file(Path(folder), "a.geojson", text).plan.zones
    assert len({zone.name for zone in zones}) == len(names)


@pytest.mark.parametrize("truth", ["true", "TRUE", "1"])
def test_truth_of_kml(truth: str, tmp_path: Path) -> None:
    """A fence became a place to keep out of."""
    around = outer([[149, -35.5], [149.3, -35.5], [149.15, -35.2]])
    text = placemark(f"<Polygon>{around}</Polygon>", inclusion=truth)
    plan = of_file(tmp_path, "a.kml", text).plan
    assert not plan.zones
    assert plan.fence is not None
    assert len(plan.fence.polygon_m) == 3


ODD = st.sampled_from(
    [".inf", "-.inf", ".nan", "1e999", "9" * 401, "-" + "9" * 5000, "true", "x", "[]", "~", "1e308"]
)


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(["lat_deg: -35.36", "lon_deg: 149.16", "alt_m: 584", "unit_m: 5"]), ODD)
def test_a_mission_with_a_file_of_zones_and_a_number_that_is_none(field: str, odd: str) -> None:
    """One sentence, by the line of the number."""
    changed = f"{field.partition(':')[0]}: {odd}"
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "a.geojson").write_text(feature())
        path = Path(folder) / "mission.yaml"
        path.write_text(TEXT.replace(field, changed) + "zones: a.geojson\n")
        with pytest.raises(MissionError) as caught:
            load(path)
    found = [problem for problem in caught.value.problems if field.split(":")[0] in problem.field]
    assert found
    assert str(path) in found[0].where


def test_two_fences_are_one_too_many(tmp_path: Path) -> None:
    polygon = {"polygon": [at[::-1] for at in RING], "inclusion": True}
    fence = {"circles": [], "polygons": [polygon, polygon], "version": 2}
    with pytest.raises(MissionError, match="2 areas are to stay inside of: polygon 1, polygon 2"):
        of_file(tmp_path, "a.plan", json.dumps({"geoFence": fence}))


@pytest.mark.parametrize("name", ["../a.kml", "none.kml", "a.csv", '"a\\0.kml"'])
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


SAMPLES = Path(__file__).parents[3] / "data" / "zone_files"
"""Files of the form that other programs write."""
READ: dict[str, tuple[set[tuple[str, int, float | None, float | None]], int]] = {
    "qgroundcontrol.plan": ({("circle-1", 1, None, None), ("polygon-2", 3, None, None)}, 4),
    "google_earth.kml": ({("Old-barn", 4, None, 12.5), ("Mast", 1, None, None)}, 0),
    "qgis.kml": ({("wood", 3, 2.5, None), ("wood-2", 3, 2.5, None)}, 4),
    "qgis.geojson": (
        {("pond", 3, None, 30.0), ("pond-2", 3, None, 30.0), ("zone-3", 3, 4.0, None)},
        4,
    ),
    "geojson_io.geojson": ({("zone-1", 3, None, None), ("well", 1, None, None)}, 0),
}


@pytest.mark.parametrize("name", READ)
def test_what_other_programs_write_is_read(name: str, tmp_path: Path) -> None:
    """Zones with corners and heights, and the fence's corners, where the file has one."""
    zones, corners = READ[name]
    drawn = mission(tmp_path, "").plan
    plan = of_file(tmp_path, name, (SAMPLES / name).read_text()).plan
    found = {(z.name, len(z.corners_m), z.floor_m, z.ceiling_m) for z in plan.zones}
    assert found == zones
    assert plan.fence is not None
    assert (plan.fence == drawn.fence) is not bool(corners)
    assert len(plan.fence.polygon_m) == corners or not corners
    middle = plan.zones[0].corners_m[0]
    assert 100 < math.hypot(*middle) < 600
