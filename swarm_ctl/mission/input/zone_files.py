"""Zones and fences in files of others: GeoJSON, KML, and the geoFence (version 2) of a `.plan` of
QGroundControl.

All give latitude and longitude; a file's places are turned into the mission's common frame. What is
to stay inside of (an *inclusion*) is the fence, what is to keep out of is a zone. None of the three
has a standard for heights: `floor_m`, `ceiling_m` and `clearance_m` are properties of a GeoJSON
feature, data of a KML placemark, and in a `.plan` there are none.
`zone_writing.py` writes such files.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree as Xml

from pydantic import ValidationError

from swarm_ctl.core.model.frames import geodetic_from_ned, ned_from_geodetic
from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.files import read_bytes
from swarm_ctl.mission.input.document import Document, problem_at
from swarm_ctl.mission.sections.mission_sections import OriginSection

_MOST_BYTES: Final = 5_000_000
_MOST_PROBLEMS: Final = 20
_CORNERS: Final = 32
"""Of a circle, where a polygon has to stand for it."""
HEIGHTS: Final[tuple[str, ...]] = ("floor_m", "ceiling_m", "clearance_m")
_FARTHEST: Final = 10_000.0
"""From the origin, and the largest radius, in lengths of the mission, as its sections allow."""
_LARGEST: Final = 1_000.0
_MOST_DIGITS: Final = 300
"""A whole number of more may be none that a computer can hold."""
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
    try:
        path = Path(os.path.realpath(folder / named))
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
    origin, unit = _origin(data), _unit(data)
    if origin is not None and unit is not None:  # else they have a problem of their own
        wrong = [*wrong, *_put(source, areas, f"{folder / named}", origin, unit)]
    for each in wrong[:_MOST_PROBLEMS]:
        where = f"{folder / named}: {each.where}" if each.where else str(folder / named)
        source.problems.append(problem_at(where, "zones", each.what, each.allowed))
    return len(source.problems) == before


def _put(
    source: Document, areas: Sequence[Area], file: str, origin: Geodetic, unit_m: float
) -> list[_WrongError]:
    """Zones and fence into the mission, lengths in what it has, each with its place in the file;
    what can't be put there is the value."""
    zones, fences, wrong = source.data["zones"], list[Area](), list[_WrongError]()
    for k, area in enumerate(areas, start=1):
        where = f"{file}: {area.where}"
        try:
            corners = [_near(at, area.where, origin, unit_m) for at in area.corners]
            if area.inclusion:
                fences.append(area)
                continue
            if area.radius_m > _LARGEST * unit_m:
                what = f"has a radius of {area.radius_m:g} m"
                raise _WrongError(area.where, what, f"at most {_LARGEST * unit_m:g} m")
        except _WrongError as error:
            wrong.append(error)
            continue
        shape: dict[str, Any] = {"polygon": tuple(corners)}
        if area.radius_m:
            shape = {"circle": corners[0], "radius": area.radius_m / unit_m}
        name = _name(area.name, k, zones)
        zones[name] = shape | dict(area.heights)
        source.wheres["zones", name] = where
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
        source.wheres["fence", "polygon"] = f"{file}: {one.where}"
    return wrong


def _circle(area: Area, origin: Geodetic) -> tuple[tuple[float, float], ...]:
    """The corners of a polygon inside of it."""
    north, east = _local(area.corners[0], origin, 1.0)
    turns = [2.0 * math.pi * k / _CORNERS for k in range(_CORNERS)]
    r = area.radius_m
    ring = ((north + r * math.cos(a), east + r * math.sin(a)) for a in turns)
    return tuple(globe(at, origin) for at in ring)


def _near(at: tuple[float, float], where: str, origin: Geodetic, unit_m: float) -> Point:
    """A corner in the mission's lengths.

    Raises:
        _WrongError: it is farther from the origin than a mission's places may be.
    """
    found = _local(at, origin, unit_m)
    if max(map(abs, found)) > _FARTHEST:
        away_m = math.hypot(*found) * unit_m
        what = f"has a corner {away_m / 1000:.0f} km from the mission's origin"
        most = f"at most {_FARTHEST * unit_m / 1000:g} km north or south, east or west"
        raise _WrongError(where, what, f"{most}; are latitude and longitude exchanged?")
    return found


def _local(at: tuple[float, float], origin: Geodetic, unit_m: float) -> Point:
    north, east, _ = ned_from_geodetic(Geodetic(*at, origin.alt_m), origin)
    return round(north / unit_m, 6), round(east / unit_m, 6)


def globe(at_m: Point, origin: Geodetic) -> tuple[float, float]:
    """(latitude, longitude) of a place in the common frame, to a tenth of a millimetre."""
    found = geodetic_from_ned((*at_m, 0.0), origin)
    return round(found.lat_deg, 9), round(found.lon_deg, 9)


def _origin(data: Mapping[str, Any]) -> Geodetic | None:
    """The mission's origin; None: it is wrong."""
    try:
        return OriginSection.model_validate(data.get("origin")).planned()
    except ValidationError:
        return None


def _unit(data: Mapping[str, Any]) -> float | None:
    """Metres of one of the mission's lengths; None: it is wrong."""
    if data.get("lengths") == "metres":
        return 1.0
    unit = data.get("unit_m", 5.0)
    sound = isinstance(unit, int | float) and 0.1 <= unit <= 1000
    return float(unit) if sound else None


def _name(wanted: str, k: int, taken: Mapping[str, Any]) -> str:
    """A name that a mission allows, and no other zone has."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", wanted).strip("-_")[:34] or f"zone-{k}"
    numbered = (f"{name}-{n}" for n in itertools.count(k))
    return next(each for each in itertools.chain((name,), numbered) if each not in taken)


# --- reading ---


def read(path: Path) -> tuple[list[Area], list[_WrongError]]:
    """The places of a file, and what is wrong with others.

    Raises:
        OSError, ValueError: it can't be read, is none of the kinds, or has no place in it.
    """
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise ValueError(f"it ends in {kind or 'nothing'}")
    try:
        text = read_bytes(path, _MOST_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise _WrongError("", "is no text in UTF-8", "UTF-8") from None
    areas, wrong = _collected(_kml(text) if kind == ".kml" else _json(text, kind))
    if not areas and not wrong:
        raise _WrongError("", "has no zone in it", "one at least; or no `zones` in the mission")
    return areas, wrong


def _json(text: str, kind: str) -> Iterator[Callable[[], list[Area]]]:
    try:
        data = json.loads(text, parse_int=_whole)
    except RecursionError:
        raise _WrongError("", "is nested too deeply", "GeoJSON, or a plan") from None
    except json.JSONDecodeError as error:
        raise _WrongError(f"line {error.lineno}", "is no JSON", "a whole JSON file") from None
    plan = kind == ".plan" or (isinstance(data, dict) and "geoFence" in data)
    return _plan(data) if plan else _geojson(data)


def _whole(digits: str) -> float:
    """A whole number; one of too many digits as a float, which may be infinite."""
    return int(digits) if len(digits) <= _MOST_DIGITS else float(digits)


def _collected(found: Iterator[Callable[[], list[Area]]]) -> tuple[list[Area], list[_WrongError]]:
    areas, wrong = list[Area](), list[_WrongError]()
    for each in found:
        try:
            areas += map(_sound, each())
        except _WrongError as error:
            wrong.append(error)
    return areas, wrong


def _sound(area: Area) -> Area:
    if area.inclusion and area.heights:
        what = f"is to stay inside of, and gives {', '.join(area.heights)}"
        raise _WrongError(area.where, what, "heights of zones alone; the mission's fence.height_m")
    return area


def _geojson(data: Any) -> Iterator[Callable[[], list[Area]]]:
    if not isinstance(data, dict) or "type" not in data:
        raise _WrongError("", "is no GeoJSON", "an object with a type, such as FeatureCollection")
    features = data.get("features") if data["type"] == "FeatureCollection" else [data]
    if not isinstance(features, list):
        raise _WrongError("", "has no list of features", "features: [...]")
    _require_degrees(data.get("crs"))
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
    name = _told(given, "name", _told(given, "Name", ""))
    name = str(name) if isinstance(name, str | int | float) else ""
    where += f" ({name})" if name else ""
    heights = {
        key: _number(given[key], where, key) for key in HEIGHTS if _told(given, key) is not None
    }
    inclusion = _told(given, "inclusion", _told(given, "fence", False))
    if not isinstance(inclusion, bool):
        raise _WrongError(where, f"inclusion is {_short(inclusion)}", "true or false, no quotes")
    kind, coordinates = geometry.get("type"), geometry.get("coordinates")
    if kind == "Point":
        if _told(given, "radius") is None:
            raise _WrongError(where, "is a point without radius", "a radius [m] in its properties")
        radius_m = _radius(given["radius"], where)
        return [Area(where, name, (_lon_lat(coordinates, where),), radius_m, inclusion, heights)]
    polygons = {"Polygon": [coordinates], "MultiPolygon": coordinates}.get(str(kind))
    if not isinstance(polygons, list):
        what = f"is a {kind}" if kind != "MultiPolygon" else "has no list of coordinates"
        raise _WrongError(where, what, "a Polygon, MultiPolygon, or Point with radius")
    if not polygons:
        raise _WrongError(where, "has no polygon in it", "one at least")
    rings = [_outer(polygon, where, str(kind)) for polygon in polygons]
    return [Area(where, name, _ring(ring, where), 0.0, inclusion, heights) for ring in rings]


def _told(given: Mapping[str, Any], key: str, default: Any = None) -> Any:
    """A property; the default where it is null, as in a table of which each feature has all
    columns."""
    found = given.get(key)
    return default if found is None else found


def _short(value: Any) -> str:
    """A value of a file, to be shown."""
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 40 else f"{text[:37]}..."


def _require_degrees(crs: Any) -> None:
    """An old GeoJSON may name what its numbers are; anything but WGS 84 is not read."""
    given = crs.get("properties") if isinstance(crs, dict) else None
    name = str(given.get("name", "")) if isinstance(given, dict) else ""
    if name and not re.search(r"CRS84h?$|EPSG:.*\b(4326|4979)$", name):
        allowed = "WGS 84 (EPSG:4326): save it with this crs"
        raise _WrongError("", f"has the crs {_short(name)}", allowed)


_DEPTH: Final = 3
"""A polygon is a list of rings, a ring of corners, a corner of numbers."""


def _outer(polygon: Any, where: str, kind: str) -> Any:
    depth = _depth(polygon)
    if depth and depth != _DEPTH:
        off = abs(depth - _DEPTH)
        how = f"{off} level{'s' if off > 1 else ''} too {'little' if depth < _DEPTH else 'deep'}"
        rings = "polygons, each of rings" if kind == "MultiPolygon" else "rings"
        allowed = f"{kind}: a list of {rings}, each of [longitude, latitude]"
        raise _WrongError(where, f"its coordinates are nested {how}", allowed)
    if not isinstance(polygon, list) or not polygon:
        raise _WrongError(where, "has no corners", "a ring of corners")
    if len(polygon) > 1:
        raise _WrongError(where, "has a hole", "polygons without holes")
    return polygon[0]


def _depth(value: Any) -> int:
    """How many lists there are around the first number; 0: there is no number."""
    depth = 0
    while isinstance(value, list) and value:
        depth, value = depth + 1, value[0]
    return depth if isinstance(value, int | float) else 0


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
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _WrongError(where, f"{what} is {_short(value)}, no number", "a plain number")
    try:
        found = float(value)
    except OverflowError:
        found = math.inf
    if not math.isfinite(found):
        raise _WrongError(where, f"{what} is no finite number", "a plain number")
    return found


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
        what = f"geoFence has version {_short(fence.get('version'))}"
        raise _WrongError("", what, "version 2: save it with QGroundControl again")
    for kind in ("polygons", "circles"):
        items = fence.get(kind, [])
        if not isinstance(items, list):
            what = f"geoFence.{kind} is {_short(items)}"
            raise _WrongError("", what, f"a list of {kind}; [] where there are none")
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
    heights = {key: _parsed(given[key], where, key) for key in HEIGHTS if given.get(key)}
    inclusion = _TRUTH.get(given.get("inclusion", "").lower())
    if inclusion is None:
        raise _WrongError(where, f"inclusion is {_short(given['inclusion'])}", "true or false")
    other = next((_tag(each) for each in mark.iter() if _tag(each) in _NO_AREAS), None)
    points = [each for each in mark.iter() if _tag(each) == "Point"]
    polygons = [each for each in mark.iter() if _tag(each) == "Polygon"]
    if other is not None or not (points or polygons):
        what = f"is a {other}" if other and not polygons else "has no Polygon"
        what = f"has a {other} beside its polygon" if other and polygons else what
        raise _WrongError(where, what, "a Polygon, or a Point with data radius [m]")
    found = [Area(where, name, _corners(each, where), 0.0, inclusion, heights) for each in polygons]
    if points and not polygons and not given.get("radius"):
        raise _WrongError(where, "is a point without radius", "a radius [m] in its ExtendedData")
    for point in points if given.get("radius") else ():  # else the place of a label
        radius_m = _radius(_parsed(given["radius"], where, "radius"), where)
        middles = _coordinates(point, where)
        if len(middles) > 1:
            raise _WrongError(where, f"has a Point of {len(middles)} places", "one a Point")
        found.append(Area(where, name, (middles[0],), radius_m, inclusion, heights))
    return found


_TRUTH: Final = {"true": True, "1": True, "false": False, "0": False, "": False}
"""The values of XML's truth; '': none is given."""
_NO_AREAS: Final = ("LineString", "Track", "MultiTrack", "Model", "LatLonQuad")


def _corners(polygon: Xml.Element, where: str) -> tuple[tuple[float, float], ...]:
    """Of its one ring."""
    if any(_tag(each) == "innerBoundaryIs" for each in polygon.iter()):
        raise _WrongError(where, "has a hole", "polygons without holes")
    outer = [each for each in polygon.iter() if _tag(each) == "outerBoundaryIs"]
    rings = [each for around in outer for each in around.iter() if _tag(each) == "LinearRing"]
    if len(outer) != 1 or len(rings) != 1:
        many = f"{len(outer)} outerBoundaryIs" if len(outer) != 1 else f"{len(rings)} LinearRings"
        allowed = "one outerBoundaryIs of one LinearRing in each Polygon"
        raise _WrongError(where, f"has a Polygon of {many}", allowed)
    return _opened(_coordinates(rings[0], where), where)


def _coordinates(element: Xml.Element, where: str) -> list[tuple[float, float]]:
    texts = [each.text or "" for each in element.iter() if _tag(each) == "coordinates"]
    corners = [word.split(",") for word in " ".join(texts).split()]
    found = [_lon_lat([_parsed(n, where, "a coordinate") for n in at], where) for at in corners]
    if not found:
        raise _WrongError(where, "has no coordinates", "longitude,latitude of each corner")
    return found


def _parsed(text: str, where: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise _WrongError(where, f"{what} is {_short(text)}, no number", "a plain number") from None
    return _number(value, where, what)


def _text(element: Xml.Element) -> str:
    """Of SimpleData; of Data its value, which may stand beside a name to display."""
    value = next((each for each in element if _tag(each) == "value"), element)
    return "".join(value.itertext()).strip()


def _tag(element: Xml.Element) -> str:
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""
