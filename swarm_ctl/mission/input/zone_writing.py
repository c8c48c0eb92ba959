"""Zones and the fence of a plan as files of others, which `zone_files.py` reads again as the
same."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree as Xml

from swarm_ctl.core.model.plan import Geodetic, Plan
from swarm_ctl.mission.input.zone_files import HEIGHTS, Area, globe


def areas_of(plan: Plan) -> list[Area]:
    """The zones of a plan and its fence."""
    found = list[Area]()
    for zone in plan.zones:
        corners = tuple(globe(at, plan.origin) for at in zone.corners_m)
        told = {str(key): getattr(zone, key) for key in HEIGHTS}
        heights = {key: value for key, value in told.items() if value is not None}
        where = f"zone {zone.name}"
        found.append(Area(where, zone.name, corners, zone.radius_m, False, heights))
    if plan.fence is not None and plan.fence.polygon_m:
        corners = tuple(globe(at, plan.origin) for at in plan.fence.polygon_m)
        found.append(Area("the fence", "fence", corners, 0.0, True, {}))
    return found


def lost_in(plan: Plan, kind: str) -> list[str]:
    """What a file of this kind does not have of a plan's zones and fence: `names`, `floors`."""
    found, usual_m = list[str](), 0.5 * plan.law.r_in * plan.unit_m
    if kind == ".plan":
        has = {
            "names": bool(plan.zones),
            "floors": any(zone.floor_m is not None for zone in plan.zones),
            "ceilings": any(zone.ceiling_m is not None for zone in plan.zones),
            "clearances": any(zone.clearance_m != usual_m for zone in plan.zones),
        }
        found += [what for what, there in has.items() if there]
    return [*found, "the fence's height"]


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
