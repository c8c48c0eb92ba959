"""Tells a swarm where a target is, as a source says it.

Only what a source says anew is told. Where it has no fix, falls silent or is gone, the swarm is
told nothing: it brakes after a second, and does what its mission says. Meanwhile the source is
tried again.
"""

from __future__ import annotations

import bisect
import csv
import io
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple, Protocol
from xml.etree import ElementTree as Xml

from swarm_ctl.core.model.frames import ned_from_geodetic
from swarm_ctl.core.model.messages import AgentState, TargetWord
from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.clock import unix_of
from swarm_ctl.engine.target.receivers import Gpsd, Nmea, Reader
from swarm_ctl.errors import InputError
from swarm_ctl.files import read_bytes
from swarm_ctl.mavlink.target_ear import TargetEar
from swarm_ctl.mavlink.wire import Wire
from swarm_ctl.mavlink.wires import SpellingError, open_wire
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node

SOURCES: Final = (
    "nmea:ENDPOINT, gpsd:HOST:PORT, mavlink:ENDPOINT or the path of a .csv or .gpx track, ENDPOINT"
    " being serial:DEVICE:BAUD, tcp:HOST:PORT, tcpin:HOST:PORT, udpin:HOST:PORT or"
    " udpout:HOST:PORT"
)
_TELLS_S: Final = 0.1
"""Between two words: ten receivers a second are more than a formation can follow."""
_PLAYS_S: Final = 0.2
_ASKS_S: Final = 2.0
"""A source that is silent for so long is asked anew."""
_LOOK_WALL_S: Final = 0.02
_SHOWS_S: Final = 0.5
_HEARD_S: Final = 2.0
_BAUD: Final = "9600"
"""Of most receivers, where none is given."""


@dataclass(frozen=True, slots=True)
class Told:
    """What there is to show."""

    word: TargetWord | None
    """The newest that was told."""
    silent_s: float
    """Since then."""
    words: int
    """So many were told in all."""
    bad: int
    """Lines or frames that could not be used."""
    why: str
    """Why nothing is told; '': it is."""
    agents: int
    """That were heard a moment ago."""
    over: bool
    """The track has ended."""


class Source(Protocol):
    """Where news of a target comes from. `now`: seconds on the wall clock."""

    @property
    def bad(self) -> int: ...
    @property
    def why(self) -> str: ...
    @property
    def over(self) -> bool: ...
    def words(self, now: float) -> list[TargetWord]: ...
    def close(self) -> None: ...


class Received:
    """A receiver at an endpoint."""

    over = False

    def __init__(self, name: str, wire: Wire, reader: Reader) -> None:
        self._name, self._wire, self._reader = name, wire, reader
        self._heard_s = self._asked_s = -math.inf
        self._trouble = ""

    @property
    def bad(self) -> int:
        return self._reader.bad

    @property
    def why(self) -> str:
        return self._trouble or self._wire.trouble or self._reader.why

    def words(self, now: float) -> list[TargetWord]:
        """What came since the last call."""
        found: list[TargetWord] = []
        try:
            while (chunk := self._wire.read(now)) is not None:
                self._heard_s, self._trouble = now, ""
                found += self._reader.feed(chunk)
            asks = self._reader.answer()
            if asks and now - max(self._heard_s, self._asked_s) > _ASKS_S:
                self._asked_s = now
                self._wire.write(asks, now)
        except OSError as error:  # the wire opens again by itself
            self._trouble = f"{self._name}: {error.strerror or error}"
        return found

    def close(self) -> None:
        self._wire.close()


class Played:
    """A track, from now on."""

    bad, why = 0, ""

    def __init__(self, name: str, track: RecordedTrack, faster: float) -> None:
        self._name, self._track, self._faster = name, track, faster
        self._began_s: float | None = None
        self._due_s = -math.inf
        self.over = False

    def words(self, now: float) -> list[TargetWord]:
        """Where it is now, five times a second, until the track ends."""
        if self._began_s is None:
            self._began_s = now
        seconds = (now - self._began_s) * self._faster
        self.over = seconds > self._track.lasts_s
        if self.over or now < self._due_s:
            return []
        self._due_s = now + _PLAYS_S
        return [self._track.word(self._name, seconds, self._faster)]

    def close(self) -> None:
        """Nothing is open."""


def open_source(
    name: str, spelled: str, *, late_s: float, system: int, icao: int, faster: float
) -> Source:
    """The source of a target's news.

    Args:
        name: of the target.
        spelled: one of `SOURCES`.
        late_s: how old a position is when a receiver tells it.
        system: of a MAVLink vehicle; 0: the only one that is heard.
        icao: of an aircraft that a MAVLink receiver hears; 0: none.
        faster: a track is played so much faster.

    Raises:
        InputError: there is no such source; with what there is.
        LinkError: it can't be opened.
    """
    try:
        source = _receiver(name, spelled, late_s, system, icao)
    except SpellingError:
        raise InputError(f"{spelled!r} is no source; allowed: {SOURCES}") from None
    if source is not None:
        return source
    path = Path(spelled)
    if path.suffix.lower() in (".csv", ".gpx"):
        return Played(name, RecordedTrack(path), faster)
    raise InputError(f"{spelled!r} is no source; allowed: {SOURCES}")


def _receiver(name: str, spelled: str, late_s: float, system: int, icao: int) -> Source | None:
    """None where none is spelled."""
    scheme, _, rest = spelled.partition(":")
    if scheme == "nmea" and rest:
        bare = rest.startswith("serial:") and not rest.rpartition(":")[2].isdecimal()
        endpoint = f"{rest}:{_BAUD}" if bare else rest
        return Received(rest, open_wire(endpoint), Nmea(name, late_s))
    if scheme == "gpsd" and rest:
        return Received(rest, open_wire(f"tcp:{rest}"), Gpsd(name, late_s))
    if scheme == "mavlink" and rest:
        ear = TargetEar(name, late_s, system, icao)
        return Received(rest, open_wire(rest), ear)
    return None


def tell(
    node: Node, source: Source, show: Callable[[Told], None], ends: Callable[[], bool]
) -> Told:
    """Tell the swarm what the source says, until `ends` or the track's end.

    Args:
        node: on the swarm's mesh.
        source: of the news.
        show: twice a second.
        ends: whether it is to end.
    """
    node.listen(keys.STATE, keys.FAR)
    heard: dict[int, float] = {}
    newest: TargetWord | None = None
    told_s, shown_s, count, began_s = -math.inf, -math.inf, 0, wall.wall_s()
    while True:
        now = wall.wall_s()
        for word in source.words(now)[-1:]:
            if now - told_s >= _TELLS_S:
                newest, told_s, count = replace(word, station=str(node.name)), now, count + 1
                node.send(keys.SIGHTING, newest)
        states: list[tuple[AgentState, float]] = [*node.take(keys.STATE), *node.take(keys.FAR)]
        heard |= {state.agent: now for state, _ in states}
        over = source.over or ends()
        if now - shown_s >= _SHOWS_S or over:
            shown_s = now
            agents = sum(now - last_s <= _HEARD_S for last_s in heard.values())
            silent_s = now - (told_s if newest is not None else began_s)
            told = Told(
                newest,
                silent_s,
                count,
                bad=source.bad,
                why=source.why,
                agents=agents,
                over=source.over,
            )
            show(told)
            if over:
                return told
        wall.pause(_LOOK_WALL_S)


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
        try:
            text = read_bytes(path, _MOST_BYTES).decode(errors="replace")
        except OSError as error:
            why = f"can't be read: {error.strerror}; allowed: a .csv or .gpx track"
            raise InputError(f"{path}: {why}") from None
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
