"""Zones and fences in files of others: GeoJSON, KML, and the geoFence (version 2) of a `.plan` of
QGroundControl.

All give latitude and longitude; a file's places are turned into the mission's common frame. What is
to stay inside of (an *inclusion*) is the fence, what is to keep out of is a zone. None of the three
has a standard for heights: `floor_m`, `ceiling_m` and `clearance_m` are properties of a GeoJSON
feature, data of a KML placemark, and in a `.plan` there are none.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree as Xml

from swarm_ctl.core.model.frames import geodetic_from_ned, ned_from_geodetic
from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.plan import Geodetic, Plan
from swarm_ctl.files import read_bytes
from swarm_ctl.mission.input.document import Document, problem_at

_MOST_BYTES: Final = 5_000_000
_MOST_PROBLEMS: Final = 20
_CORNERS: Final = 32
"""Of a circle, where a polygon has to stand for it."""
_HEIGHTS: Final[tuple[str, ...]] = ("floor_m", "ceiling_m", "clearance_m")
KINDS: Final = (".geojson", ".json", ".kml", ".plan")
_ALLOWED: Final = (
    f"a file of at most {_MOST_BYTES / 1e6:g} MB ending in {', '.join(KINDS)}, in the mission's"
    " folder or below"
)


class Area(NamedTuple):
    """One place of a file."""

    where: str
    """`feature 3 (oak)`."""
    name: str
    corners: tuple[tuple[float, float], ...]
    """(latitude, longitude); of a circle its middle alone."""
    radius_m: float
    """Of a circle; 0: it is a polygon."""
    inclusion: bool
    """To stay inside of."""
    heights: Mapping[str, float]
    """`floor_m`, `ceiling_m`, `clearance_m`, where they are given."""


class _WrongError(ValueError):
    """What is wrong in a file, and what would be allowed."""

    def __init__(self, where: str, what: str, allowed: str) -> None:
        super().__init__(what)
        self.where, self.what, self.allowed = where, what, allowed


def graft(source: Document, folder: Path) -> bool:
    """Where `zones` names a file, put its zones there; and its fence, where the mission draws none.

    False if there is something wrong with the file: problems by its features say what.
    """
    data = source.data
    named = data.get("zones") if isinstance(data, dict) else None
    if not isinstance(named, str):
        return True
    before = len(source.problems)
    data["zones"] = {}
    path = Path(os.path.realpath(folder / named))
    try:
        if not path.is_relative_to(os.path.realpath(folder)):
            raise ValueError("lies outside of the mission's folder")
        areas, wrong = read(path)
    except _WrongError as error:
        areas, wrong = [], [error]
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        what = f"{folder / named} can't be read: {why}"
        source.problems.append(source.problem(("zones",), what, _ALLOWED))
        return False
    for each in wrong[:_MOST_PROBLEMS]:
        where = f"{folder / named}: {each.where}" if each.where else str(folder / named)
        source.problems.append(problem_at(where, "zones", each.what, each.allowed))
    origin, unit = _origin(data), _unit(data)
    if origin is None or unit is None:
        return len(source.problems) == before  # they have a problem of their own
    _put(source, areas, origin, unit)
    return len(source.problems) == before


def _put(source: Document, areas: Sequence[Area], origin: Geodetic, unit_m: float) -> None:
    """Zones and fence into the mission, lengths in what the file has."""
    zones, fences = source.data["zones"], list[Area]()
    for k, area in enumerate(areas, start=1):
        if area.inclusion:
            fences.append(area)
            continue
        corners = [_local(at, origin, unit_m) for at in area.corners]
        shape: dict[str, Any] = {"polygon": tuple(corners)}
        if area.radius_m:
            shape = {"circle": corners[0], "radius": area.radius_m / unit_m}
        zones[_name(area.name, k, zones)] = shape | dict(area.heights)
    fence = source.data.get("fence", {})
    if len(fences) > 1:
        what = f"{len(fences)} areas are to stay inside of"
        named = ", ".join(each.where for each in fences[:4])
        source.problems.append(source.problem(("zones",), f"{what}: {named}", "one at most"))
    elif fences and isinstance(fence, dict) and "polygon" not in fence:
        (one,) = fences
        ring = _circle(one, origin) if one.radius_m else one.corners
        polygon = tuple(_local(at, origin, unit_m) for at in ring)
        source.data["fence"] = {**fence, "polygon": polygon}


def _circle(area: Area, origin: Geodetic) -> tuple[tuple[float, float], ...]:
    """The corners of a polygon inside of it."""
    north, east = _local(area.corners[0], origin, 1.0)
    turns = [2.0 * math.pi * k / _CORNERS for k in range(_CORNERS)]
    r = area.radius_m
    ring = ((north + r * math.cos(a), east + r * math.sin(a)) for a in turns)
    return tuple(_globe(at, origin) for at in ring)


def _local(at: tuple[float, float], origin: Geodetic, unit_m: float) -> Point:
    north, east, _ = ned_from_geodetic(Geodetic(*at, origin.alt_m), origin)
    return round(north / unit_m, 6), round(east / unit_m, 6)


def _globe(at_m: Point, origin: Geodetic) -> tuple[float, float]:
    found = geodetic_from_ned((*at_m, 0.0), origin)
    return round(found.lat_deg, 9), round(found.lon_deg, 9)


def _origin(data: Mapping[str, Any]) -> Geodetic | None:
    try:
        given = data["origin"]
        return Geodetic(*(float(given[name]) for name in ("lat_deg", "lon_deg", "alt_m")))
    except (KeyError, TypeError, ValueError):
        return None


def _unit(data: Mapping[str, Any]) -> float | None:
    """Metres of one of the file's lengths."""
    if data.get("lengths") == "metres":
        return 1.0
    unit = data.get("unit_m", 5.0)
    return float(unit) if isinstance(unit, int | float) and unit > 0 else None


def _name(wanted: str, k: int, taken: Mapping[str, Any]) -> str:
    """A name that a mission allows, and no other zone has."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", wanted).strip("-_")[:34] or f"zone-{k}"
    return name if name not in taken else f"{name}-{k}"


# --- reading ---


def read(path: Path) -> tuple[list[Area], list[_WrongError]]:
    """The places of a file, and what is wrong with others.

    Raises:
        OSError, ValueError: it can't be read, or is none of the kinds.
    """
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise ValueError(f"it ends in {kind or 'nothing'}")
    text = read_bytes(path, _MOST_BYTES).decode("utf-8-sig")
    if kind == ".kml":
        return _collected(_kml(text))
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        line = getattr(error, "lineno", 1)
        raise _WrongError(f"line {line}", "is no JSON", "a whole JSON file") from None
    plan = kind == ".plan" or (isinstance(data, dict) and "geoFence" in data)
    return _collected(_plan(data) if plan else _geojson(data))


def _collected(found: Iterator[Callable[[], list[Area]]]) -> tuple[list[Area], list[_WrongError]]:
    areas, wrong = list[Area](), list[_WrongError]()
    for each in found:
        try:
            areas += each()
        except _WrongError as error:
            wrong.append(error)
    return areas, wrong


def _geojson(data: Any) -> Iterator[Callable[[], list[Area]]]:
    if not isinstance(data, dict) or "type" not in data:
        raise _WrongError("", "is no GeoJSON", "an object with a type, such as FeatureCollection")
    features = data.get("features") if data["type"] == "FeatureCollection" else [data]
    if not isinstance(features, list):
        raise _WrongError("", "has no list of features", "features: [...]")
    for k, feature in enumerate(features, start=1):
        yield lambda k=k, feature=feature: _feature(k, feature)  # type: ignore[misc]


def _feature(k: int, feature: Any) -> list[Area]:
    where = f"feature {k}"
    if not isinstance(feature, dict):
        raise _WrongError(where, "is no object", "a Feature")
    given = feature.get("properties") or {}
    geometry = feature.get("geometry") if feature.get("type") == "Feature" else feature
    if not isinstance(given, dict) or not isinstance(geometry, dict):
        raise _WrongError(where, "has no geometry", "a Polygon, MultiPolygon, or Point with radius")
    name = given.get("name", "")
    name = name if isinstance(name, str) else ""
    where += f" ({name})" if name else ""
    heights = {key: _number(given[key], where, key) for key in _HEIGHTS if key in given}
    inclusion = given.get("inclusion", given.get("fence", False)) is True
    kind, coordinates = geometry.get("type"), geometry.get("coordinates")
    if kind == "Point":
        if "radius" not in given:
            raise _WrongError(where, "is a point without radius", "a radius [m] in its properties")
        radius_m = _radius(given["radius"], where)
        return [Area(where, name, (_lon_lat(coordinates, where),), radius_m, inclusion, heights)]
    rings = {"Polygon": [coordinates], "MultiPolygon": coordinates}.get(str(kind))
    if not isinstance(rings, list):
        allowed = "a Polygon, MultiPolygon, or Point with radius"
        raise _WrongError(where, f"is a {kind}", allowed)
    return [
        Area(where, name, _ring(ring, where), 0.0, inclusion, heights)
        for ring in (_outer(polygon, where) for polygon in rings)
    ]


def _outer(polygon: Any, where: str) -> Any:
    if not isinstance(polygon, list) or not polygon:
        raise _WrongError(where, "has no corners", "a ring of corners")
    if len(polygon) > 1:
        raise _WrongError(where, "has a hole", "polygons without holes")
    return polygon[0]


def _ring(ring: Any, where: str) -> tuple[tuple[float, float], ...]:
    if not isinstance(ring, list):
        raise _WrongError(where, "has no corners", "a ring of corners")
    return _opened([_lon_lat(at, where) for at in ring], where)


def _opened(corners: list[tuple[float, float]], where: str) -> tuple[tuple[float, float], ...]:
    """Without the last corner, where it is the first one again."""
    if len(corners) > 1 and corners[0] == corners[-1]:
        corners = corners[:-1]
    if len(corners) < 3:
        raise _WrongError(where, f"has {len(corners)} corners", "three at least")
    return tuple(corners)


def _lon_lat(at: Any, where: str) -> tuple[float, float]:
    if not isinstance(at, list | tuple) or len(at) < 2:
        raise _WrongError(where, "has a corner that is none", "[longitude, latitude]")
    return _lat_lon((at[1], at[0]), where)


def _lat_lon(at: Any, where: str) -> tuple[float, float]:
    if not isinstance(at, list | tuple) or len(at) < 2:
        raise _WrongError(where, "has a corner that is none", "[latitude, longitude]")
    lat, lon = _number(at[0], where, "a latitude"), _number(at[1], where, "a longitude")
    if abs(lat) > 89 or abs(lon) > 180:
        what = f"has a corner at latitude {lat:g}, longitude {lon:g}"
        raise _WrongError(where, what, "-89 to 89, -180 to 180; are the two exchanged?")
    return lat, lon


def _number(value: Any, where: str, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise _WrongError(where, f"{what} is no number", "a plain number")
    return float(value)


def _radius(value: Any, where: str) -> float:
    radius_m = _number(value, where, "radius")
    if not 0 < radius_m <= 10_000:
        raise _WrongError(where, f"has a radius of {radius_m:g} m", "above 0, at most 10000 m")
    return radius_m


def _plan(data: Any) -> Iterator[Callable[[], list[Area]]]:
    fence = data.get("geoFence") if isinstance(data, dict) else None
    if not isinstance(fence, dict):
        raise _WrongError("", "has no geoFence", "a plan of QGroundControl")
    if fence.get("version") != 2:
        what = f"geoFence has version {fence.get('version')!r}"
        raise _WrongError("", what, "version 2: save it with QGroundControl again")
    for kind in ("polygons", "circles"):
        items = fence.get(kind, [])
        if not isinstance(items, list):
            raise _WrongError("", f"geoFence.{kind} is no list", "a list")
        for k, item in enumerate(items, start=1):
            yield lambda k=k, item=item, kind=kind: _plan_item(f"{kind[:-1]} {k}", item)  # type: ignore[misc]


def _plan_item(where: str, item: Any) -> list[Area]:
    if not isinstance(item, dict) or not isinstance(item.get("inclusion"), bool):
        raise _WrongError(where, "says not whether it is an inclusion", "inclusion: true or false")
    inclusion, name = item["inclusion"], where.replace(" ", "-")
    if "polygon" in item:
        ring = item["polygon"]
        if not isinstance(ring, list):
            raise _WrongError(where, "has no corners", "a list of [latitude, longitude]")
        corners = _opened([_lat_lon(at, where) for at in ring], where)
        return [Area(where, name, corners, 0.0, inclusion, {})]
    circle = item.get("circle")
    if not isinstance(circle, dict):
        raise _WrongError(where, "has neither polygon nor circle", "polygon, or circle")
    middle = _lat_lon(circle.get("center"), where)
    return [Area(where, name, (middle,), _radius(circle.get("radius"), where), inclusion, {})]


def _kml(text: str) -> Iterator[Callable[[], list[Area]]]:
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise _WrongError("", "declares entities", "a KML file without a DOCTYPE")
    try:
        root = Xml.fromstring(text)  # noqa: S314 - no entities, and bounded
    except Xml.ParseError as error:
        line = error.position[0]
        raise _WrongError(f"line {line}", "is no XML", "a whole KML file") from None
    marks = [each for each in root.iter() if _tag(each) == "Placemark"]
    if not marks:
        raise _WrongError("", "has no placemarks", "placemarks with a Polygon each")
    for k, mark in enumerate(marks, start=1):
        yield lambda k=k, mark=mark: _placemark(k, mark)  # type: ignore[misc]


def _placemark(k: int, mark: Xml.Element) -> list[Area]:
    name = next((each.text or "" for each in mark if _tag(each) == "name"), "").strip()
    where = f"placemark {k}" + (f" ({name})" if name else "")
    given = {
        each.get("name", ""): _text(each)
        for each in mark.iter()
        if _tag(each) in ("Data", "SimpleData")
    }
    heights = {key: _parsed(given[key], where, key) for key in _HEIGHTS if key in given}
    inclusion = given.get("inclusion", "").lower() == "true"
    polygons = [each for each in mark.iter() if _tag(each) == "Polygon"]
    if not polygons:
        point = next((each for each in mark.iter() if _tag(each) == "Point"), None)
        if point is None or "radius" not in given:
            raise _WrongError(where, "has no Polygon", "a Polygon, or a Point with data radius [m]")
        radius_m = _radius(_parsed(given["radius"], where, "radius"), where)
        (middle, *_) = _coordinates(point, where)
        return [Area(where, name, (middle,), radius_m, inclusion, heights)]
    found = list[Area]()
    for polygon in polygons:
        if any(_tag(each) == "innerBoundaryIs" for each in polygon.iter()):
            raise _WrongError(where, "has a hole", "polygons without holes")
        corners = _opened(_coordinates(polygon, where), where)
        found.append(Area(where, name, corners, 0.0, inclusion, heights))
    return found


def _coordinates(element: Xml.Element, where: str) -> list[tuple[float, float]]:
    texts = [each.text or "" for each in element.iter() if _tag(each) == "coordinates"]
    corners = [word.split(",") for word in " ".join(texts).split()]
    found = [_lon_lat([_parsed(n, where, "a coordinate") for n in at], where) for at in corners]
    if not found:
        raise _WrongError(where, "has no coordinates", "longitude,latitude of each corner")
    return found


def _parsed(text: str, where: str, what: str) -> float:
    try:
        return _number(float(text), where, what)
    except ValueError:
        raise _WrongError(where, f"{what} is no number", "a plain number") from None


def _text(element: Xml.Element) -> str:
    return "".join(element.itertext()).strip()


def _tag(element: Xml.Element) -> str:
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


# --- writing ---


def areas_of(plan: Plan) -> list[Area]:
    """The zones of a plan and its fence."""
    found = list[Area]()
    for zone in plan.zones:
        corners = tuple(_globe(at, plan.origin) for at in zone.corners_m)
        told = {str(key): getattr(zone, key) for key in _HEIGHTS}
        heights = {key: value for key, value in told.items() if value is not None}
        where = f"zone {zone.name}"
        found.append(Area(where, zone.name, corners, zone.radius_m, False, heights))
    if plan.fence is not None and plan.fence.polygon_m:
        corners = tuple(_globe(at, plan.origin) for at in plan.fence.polygon_m)
        found.append(Area("the fence", "fence", corners, 0.0, True, {}))
    return found


def written(areas: Sequence[Area], kind: str, origin: Geodetic) -> str:
    """The text of a file of this kind (`.geojson`, `.kml`, `.plan`), to be read again as the
    same."""
    if kind == ".kml":
        return _as_kml(areas)
    data = _as_plan(areas, origin) if kind == ".plan" else _as_geojson(areas)
    return json.dumps(data, indent=1) + "\n"


def _as_geojson(areas: Sequence[Area]) -> dict[str, Any]:
    features = []
    for area in areas:
        ring = [[lon, lat] for lat, lon in (*area.corners, area.corners[0])]
        geometry: dict[str, Any] = {"type": "Polygon", "coordinates": [ring]}
        given: dict[str, Any] = {"name": area.name, **area.heights}
        if area.radius_m:
            geometry = {"type": "Point", "coordinates": ring[0]}
            given["radius"] = area.radius_m
        if area.inclusion:
            given["inclusion"] = True
        features.append({"type": "Feature", "properties": given, "geometry": geometry})
    return {"type": "FeatureCollection", "features": features}


def _as_plan(areas: Sequence[Area], origin: Geodetic) -> dict[str, Any]:
    circles = [
        {
            "circle": {"center": list(area.corners[0]), "radius": area.radius_m},
            "inclusion": area.inclusion,
            "version": 1,
        }
        for area in areas
        if area.radius_m
    ]
    polygons = [
        {"inclusion": area.inclusion, "polygon": [list(at) for at in area.corners], "version": 1}
        for area in areas
        if not area.radius_m
    ]
    home = [origin.lat_deg, origin.lon_deg, origin.alt_m]
    mission = {
        "cruiseSpeed": 5,
        "firmwareType": 3,
        "hoverSpeed": 5,
        "items": [],
        "plannedHomePosition": home,
        "vehicleType": 2,
        "version": 2,
    }
    return {
        "fileType": "Plan",
        "geoFence": {"circles": circles, "polygons": polygons, "version": 2},
        "groundStation": "QGroundControl",
        "mission": mission,
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }


def _as_kml(areas: Sequence[Area]) -> str:
    root = Xml.Element("kml", xmlns="http://www.opengis.net/kml/2.2")
    document = Xml.SubElement(root, "Document")
    for area in areas:
        mark = Xml.SubElement(document, "Placemark")
        Xml.SubElement(mark, "name").text = area.name
        given = {key: f"{value:.9g}" for key, value in area.heights.items()}
        if area.radius_m:
            given["radius"] = f"{area.radius_m:.9g}"
        if area.inclusion:
            given["inclusion"] = "true"
        extended = Xml.SubElement(mark, "ExtendedData")
        for key, value in given.items():
            Xml.SubElement(Xml.SubElement(extended, "Data", name=key), "value").text = value
        shape = Xml.SubElement(mark, "Point" if area.radius_m else "Polygon")
        corners = area.corners if area.radius_m else (*area.corners, area.corners[0])
        if not area.radius_m:
            shape = Xml.SubElement(Xml.SubElement(shape, "outerBoundaryIs"), "LinearRing")
        text = " ".join(f"{lon:.9f},{lat:.9f}" for lat, lon in corners)
        Xml.SubElement(shape, "coordinates").text = text
    Xml.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + Xml.tostring(root, "unicode") + "\n"
