"""Knows the files of other programs that a user may give as a mission, and names them: one line in
place of twenty about unknown fields."""

from __future__ import annotations

from typing import Final

_KINDS: Final = (
    ("PK\x03\x04", "", "a zip archive (a Skybrush show or a .kmz)"),
    ("QGC WPL", "", "a waypoint file (QGC WPL)"),
    ("<", "<kml", "a KML file"),
    ("<", "<gpx", "a GPX file"),
    ("<", "", "an XML file"),
    ("{", '"fileType"', "a QGroundControl plan"),
    ("{", '"Feature', "a GeoJSON file"),
    ("# Onboard parameters", "", "a parameter file of an autopilot"),
    ("", "\nrobot_types:", "a crazyflies.yaml (Crazyswarm2)"),
)
"""How a file begins, what its beginning has, and what to call it; the first that fits."""


def foreign(head: str) -> str:
    """What the file with this beginning is, if another program made it: `a KML file`; else ''."""
    begins = head.lstrip("\ufeff \t\r\n")
    for start, has, name in _KINDS:
        if begins.startswith(start) and has in f"\n{begins}":
            return name
    first, second = [*begins.splitlines()[:2], "", ""][:2]
    table = not begins.startswith(("[", "{", "-")) and not set(first) & set(":#")
    if table and any(first.count(mark) == second.count(mark) > 1 for mark in ",;\t"):
        return "a CSV table"
    return ""
