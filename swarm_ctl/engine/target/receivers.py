"""What receivers say of where they are: NMEA 0183 sentences, and gpsd's reports.

Each reader takes bytes as they come, and gives words of a target. It never fails at what it reads:
what it can't use it counts (`bad`), and says last (`why`). A receiver without a fix is silent.

Formats: NMEA 0183 as u-blox, Quectel and others document it (RMC, GGA, GST); gpsd_json(5).
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from typing import Any, Final, Protocol

from swarm_ctl.core.model.messages import TargetWord
from swarm_ctl.core.model.vehicle import Vector3

_KNOT_MPS: Final = 1852.0 / 3600.0
_LONGEST: Final = 4096
"""Bytes without an end of line: no sentence, and no report of a position, is so long."""
_TOGETHER: Final = 2
"""Sentences of one kind, after which those of another kind are those of an older fix."""
_UERE_M: Final = {1: 3.0, 2: 1.0, 4: 0.02, 5: 0.3}
"""By fix quality (autonomous, differential, RTK fixed and float): the accuracy at HDOP 1."""
_DEFAULT_M: Final = 5.0
_SENTENCE: Final = re.compile(rb"[$!]([A-Z0-9]{2})([A-Z]{3}),([^*\r\n]*)\*([0-9A-Fa-f]{2})")


class Reader(Protocol):
    """Turns bytes into words of one target."""

    @property
    def bad(self) -> int:
        """Lines that could not be used."""
        ...

    @property
    def why(self) -> str:
        """Why nothing is told now; '': it is, or nothing was heard."""
        ...

    def feed(self, chunk: bytes) -> Iterator[TargetWord]:
        """What the bytes say."""
        ...

    def answer(self) -> bytes:
        """What the sender is to be told before it says anything, or b''."""
        ...


class _Lines:
    """A reader of lines."""

    def __init__(self, name: str, late_s: float) -> None:
        self.bad, self.why = 0, ""
        self._name, self._late_s, self._rest = name, late_s, b""

    def feed(self, chunk: bytes) -> Iterator[TargetWord]:
        *lines, self._rest = (self._rest + chunk).split(b"\n")
        if len(self._rest) > _LONGEST:
            self._rest, self.bad = b"", self.bad + 1
        for line in filter(None, map(bytes.strip, lines)):
            try:
                yield from self._read(line)
            except (ValueError, TypeError, LookupError, OverflowError, RecursionError):
                self.bad += 1

    def answer(self) -> bytes:
        return b""

    def _read(self, line: bytes) -> Iterator[TargetWord]:
        raise NotImplementedError

    def _word(
        self,
        at: tuple[float, float],
        altitude_m: float | None,
        velocity: Vector3 | None,
        accuracy_m: float,
    ) -> TargetWord:
        """ValueError where a number is none, or no place on earth."""
        numbers = (*at, altitude_m or 0.0, *(velocity or ()), accuracy_m)
        if not all(map(math.isfinite, numbers)) or abs(at[0]) > 89.0 or abs(at[1]) > 180.0:
            raise ValueError("nowhere on earth")
        self.why = ""
        return TargetWord(
            self._name,
            *at,
            self._late_s,
            altitude_m=altitude_m,
            velocity_ned_mps=velocity,
            accuracy_m=max(0.01, accuracy_m),
        )


class Nmea(_Lines):
    """RMC tells place and velocity; GGA height and quality, GST accuracy, of the same second. A
    receiver without RMC is heard by its GGA.

    Args:
        name: of the target.
        late_s: how old a fix is when its sentence comes.
    """

    def __init__(self, name: str, late_s: float) -> None:
        super().__init__(name, late_s)
        self._altitude_m: float | None = None
        self._accuracy_m = _DEFAULT_M
        self._by_gst = False
        self._since = {"RMC": _TOGETHER + 1, "GGA": _TOGETHER + 1}
        """How many of the other kind came since one of this kind."""

    def _read(self, line: bytes) -> Iterator[TargetWord]:
        found = _SENTENCE.search(line)
        if found is None or _checksum(found[0][1:-3]) != int(found[4], 16):
            raise ValueError("no sentence, or damaged")
        kind, fields = found[2].decode(), found[3].decode("ascii").split(",")
        if kind == "RMC":
            self._since = {"RMC": 0, "GGA": self._since["GGA"] + 1}
            yield from self._rmc(fields)
        elif kind == "GGA":
            self._since = {"RMC": self._since["RMC"] + 1, "GGA": 0}
            yield from self._gga(fields)
        elif kind == "GST":
            self._accuracy_m, self._by_gst = math.hypot(float(fields[5]), float(fields[6])), True

    def _rmc(self, fields: list[str]) -> Iterator[TargetWord]:
        if fields[1] != "A":
            self.why = "the receiver has no fix (RMC status V)"
            return
        velocity = None
        if fields[6]:
            speed = float(fields[6]) * _KNOT_MPS
            course = math.radians(float(fields[7])) if fields[7] else 0.0
            velocity = (speed * math.cos(course), speed * math.sin(course), 0.0)
            if not fields[7] and speed > 0.5:  # it moves, and does not say where to
                velocity = None
        altitude_m = self._altitude_m if self._since["GGA"] <= _TOGETHER else None
        yield self._word(_place(fields[2:6]), altitude_m, velocity, self._accuracy_m)

    def _gga(self, fields: list[str]) -> Iterator[TargetWord]:
        quality = int(fields[5] or 0)
        if quality == 0:
            self.why, self._altitude_m = "the receiver has no fix (GGA quality 0)", None
            return
        self._altitude_m = float(fields[8]) if fields[8] else None
        if not self._by_gst and fields[7]:
            self._accuracy_m = float(fields[7]) * _UERE_M.get(quality, _DEFAULT_M)
        if self._since["RMC"] > _TOGETHER:
            yield self._word(_place(fields[1:5]), self._altitude_m, None, self._accuracy_m)


class Gpsd(_Lines):
    """gpsd's TPV reports.

    Args:
        name: of the target.
        late_s: how old a fix is when its report comes.
    """

    def answer(self) -> bytes:
        """That reports are to come."""
        return b'?WATCH={"enable":true,"json":true};\n'

    def _read(self, line: bytes) -> Iterator[TargetWord]:
        said: Any = json.loads(line)
        if not isinstance(said, dict):
            raise TypeError("no report")
        if said.get("class") == "ERROR":
            self.why = f"gpsd says: {str(said.get('message'))[:80]}"
        if said.get("class") != "TPV":
            return
        if said.get("mode", 0) < 2 or "lat" not in said or "lon" not in said:
            self.why = "gpsd has no fix"
            return
        velocity = None
        if "speed" in said and ("track" in said or said["speed"] <= 0.5):
            speed, track = float(said["speed"]), math.radians(float(said.get("track", 0.0)))
            down = -float(said.get("climb", 0.0))
            velocity = (speed * math.cos(track), speed * math.sin(track), down)
        altitude = said.get("altMSL", said.get("alt")) if said["mode"] >= 3 else None
        # 95 % of the errors are less than eph: two standard deviations
        accuracy_m = float(said["eph"]) / 2.0 if "eph" in said else _DEFAULT_M
        altitude_m = None if altitude is None else float(altitude)
        yield self._word((float(said["lat"]), float(said["lon"])), altitude_m, velocity, accuracy_m)


def _checksum(body: bytes) -> int:
    total = 0
    for byte in body:
        total ^= byte
    return total


def _place(fields: list[str]) -> tuple[float, float]:
    """Latitude and longitude [degrees] of `4717.11437,N,00833.91522,E`."""
    return _degrees(fields[0], fields[1], "NS"), _degrees(fields[2], fields[3], "EW")


def _degrees(number: str, side: str, sides: str) -> float:
    whole, minutes = divmod(float(number), 100.0)
    if side not in sides or len(side) != 1 or not 0.0 <= minutes < 60.0:
        raise ValueError(f"no angle: {number},{side}")
    return (whole + minutes / 60.0) * (1.0 if side == sides[0] else -1.0)
