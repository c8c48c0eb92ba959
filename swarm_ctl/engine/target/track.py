"""A recorded track, played: CSV with a line of names, or GPX."""

from __future__ import annotations

import bisect
import csv
import io
import itertools
import math
from pathlib import Path
from typing import Final, NamedTuple
from xml.etree import ElementTree as Xml

from swarm_ctl.core.model.frames import ned_from_geodetic
from swarm_ctl.core.model.messages import TargetWord
from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.engine.clock import unix_of
from swarm_ctl.errors import InputError
from swarm_ctl.files import read_bytes

_MOST_BYTES: Final = 64 << 20
_NAMES: Final = {
    "time": ("time", "time_s", "t", "timestamp"),
    "lat": ("lat", "lat_deg", "latitude", "latitude_deg"),
    "lon": ("lon", "lon_deg", "longitude", "longitude_deg", "lng"),
    "alt": ("alt", "alt_m", "altitude", "altitude_m", "ele", "elevation"),
}
_CSV: Final = "a first line with time, lat, lon and, if it is known, alt; then numbers"


class _Point(NamedTuple):
    time_s: float
    lat: float
    lon: float
    alt: float | None


class RecordedTrack:
    """Where a target is, by its own time from 0.

    Args:
        path: of the file; by its ending `.gpx`, else CSV. Times are seconds, or as ISO 8601 has
            them; heights are above mean sea level [m].

    Raises:
        InputError: it can't be read, or a line is no point; with what would be allowed.
    """

    def __init__(self, path: Path) -> None:
        text = read_bytes(path, _MOST_BYTES).decode(errors="replace")
        read = _gpx if path.suffix.lower() == ".gpx" else _csv
        points = read(str(path), text)
        if len(points) < 2:
            raise InputError(f"{path}: {len(points)} points; allowed: at least two")
        for a, b in itertools.pairwise(points):
            if b.time_s <= a.time_s:
                raise InputError(
                    f"{path}: the time {b.time_s:g} s follows {a.time_s:g} s; allowed: times that"
                    " grow"
                )
        self._points = points
        self._times = [point.time_s - points[0].time_s for point in points]

    @property
    def lasts_s(self) -> float:
        """From the first point to the last."""
        return self._times[-1]

    def word(self, name: str, seconds: float, faster: float) -> TargetWord:
        """Where it is after so long, played so much faster; between its points on a straight
        line."""
        k = min(max(1, bisect.bisect_right(self._times, seconds)), len(self._times) - 1)
        a, b = self._points[k - 1], self._points[k]
        leg_s = self._times[k] - self._times[k - 1]
        share = min(1.0, max(0.0, (seconds - self._times[k - 1]) / leg_s))
        alt = None if a.alt is None or b.alt is None else a.alt + share * (b.alt - a.alt)
        here = Geodetic(a.lat, a.lon, a.alt or 0.0)
        there = Geodetic(b.lat, b.lon, (a.alt or 0.0) if b.alt is None else b.alt)
        north, east, down = (way * faster / leg_s for way in ned_from_geodetic(there, here))
        return TargetWord(
            name,
            a.lat + share * (b.lat - a.lat),
            a.lon + share * (b.lon - a.lon),
            0.0,
            altitude_m=alt,
            velocity_ned_mps=(north, east, down),
            accuracy_m=1.0,
        )


def _csv(path: str, text: str) -> list[_Point]:
    rows = csv.DictReader(io.StringIO(text))
    names = [str(name).strip().lower() for name in rows.fieldnames or ()]
    rows.fieldnames = names
    of = {
        key: next((word for word in words if word in names), None) for key, words in _NAMES.items()
    }
    missing = [key for key in ("time", "lat", "lon") if of[key] is None]
    if missing:
        raise InputError(f"{path}: has no column {' or '.join(missing)}; allowed: {_CSV}")
    points = []
    for row in rows:
        told = {key: row[name] for key, name in of.items() if name is not None}
        points.append(_point(f"{path}, line {rows.line_num}", told))
    return points


def _gpx(path: str, text: str) -> list[_Point]:
    try:
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise InputError(f"{path}: declares entities; allowed: a GPX file without a DOCTYPE")
        root = Xml.fromstring(text)  # noqa: S314 - no entities, and bounded
    except Xml.ParseError as error:
        raise InputError(f"{path}: is no XML: {error}; allowed: a GPX track with times") from None
    points = []
    for k, point in enumerate(root.iterfind(".//{*}trkpt"), 1):
        told = {
            "time": point.findtext("{*}time"),
            "lat": point.get("lat"),
            "lon": point.get("lon"),
            "alt": point.findtext("{*}ele"),
        }
        points.append(_point(f"{path}, track point {k}", told))
    return points


def _point(where: str, told: dict[str, str | None]) -> _Point:
    try:
        time_s = _seconds(told["time"] or "")
        lat, lon = float(told["lat"] or ""), float(told["lon"] or "")
        alt = float(told["alt"] or "") if told.get("alt") else None
    except ValueError as error:
        raise InputError(f"{where}: {error}; allowed: {_CSV}") from None
    if not abs(lat) <= 89.0 or not abs(lon) <= 180.0 or not math.isfinite(time_s + (alt or 0.0)):
        raise InputError(f"{where}: ({lat:g}, {lon:g}) is nowhere on earth; allowed: degrees")
    return _Point(time_s, lat, lon, alt)


def _seconds(text: str) -> float:
    """Seconds, or a date and time as GPX has it."""
    try:
        return float(text)
    except ValueError:
        return unix_of(text.strip())
