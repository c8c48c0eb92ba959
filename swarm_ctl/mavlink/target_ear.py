"""Where a MAVLink system says that it is, for a formation that follows it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.messages import TargetWord
from swarm_ctl.core.model.vehicle import Vector3
from swarm_ctl.mavlink.framer import Framer
from swarm_ctl.mavlink.outgoing import interval

_SYSTEM: Final = 254
"""Neither an agent nor a usual ground station (255)."""
_HZ: Final = 5.0
_ADSB_NEEDED: Final = dialect.ADSB_FLAGS_VALID_COORDS
_ADSB_MOVES: Final = dialect.ADSB_FLAGS_VALID_HEADING | dialect.ADSB_FLAGS_VALID_VELOCITY
_UNKNOWN_HEADING: Final = 36000


class TargetEar:
    """Reads GLOBAL_POSITION_INT and FOLLOW_TARGET of one system, or ADSB_VEHICLE of one aircraft.

    Args:
        name: of the target.
        late_s: how old a position is when it comes.
        system: whose; 0: of any, or of the aircraft `icao`.
        icao: the address of an aircraft that a receiver hears; 0: none.
    """

    def __init__(self, name: str, late_s: float, system: int = 0, icao: int = 0) -> None:
        self.why = ""
        self._name, self._late_s, self._system, self._icao = name, late_s, system, icao
        self._framer = Framer()
        self._codec = dialect.MAVLink(None, _SYSTEM, dialect.MAV_COMP_ID_ONBOARD_COMPUTER)
        self._on_ground = False
        self._accuracy_m = 2.0

    @property
    def bad(self) -> int:
        """Runs of bytes that were no frame."""
        return self._framer.bad

    def feed(self, chunk: bytes) -> Iterator[TargetWord]:
        """What the bytes say."""
        for frame in self._framer.feed(chunk):
            if self._system and frame.system != self._system:
                continue
            try:
                message: Any = self._codec.decode(bytearray(frame.raw))
            except dialect.MAVError:
                continue
            word = self._word_of(message)
            if word is not None:
                self.why = ""
                yield word

    def answer(self) -> bytes:
        """The vehicle is to say where it is five times a second."""
        if self._icao or not self._system:
            return b""
        asked = (dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, dialect.MAVLINK_MSG_ID_GPS_RAW_INT)
        data = b""
        for each in asked:
            data += interval(self._system, each, _HZ).pack(self._codec)
            self._codec.seq = (self._codec.seq + 1) & 0xFF
        return data

    def _word_of(self, message: Any) -> TargetWord | None:
        kind = message.get_type()
        if kind == "ADSB_VEHICLE" and self._icao and message.ICAO_address == self._icao:
            return self._adsb(message)
        if self._icao:
            return None
        if kind == "GLOBAL_POSITION_INT":
            if (message.lat, message.lon) == (0, 0):
                self.why = "the vehicle has no position"
                return None
            flies = (message.vx * 0.01, message.vy * 0.01, message.vz * 0.01)
            return self._word(message.lat, message.lon, message.alt * 1e-3, flies)
        if kind == "FOLLOW_TARGET":
            moves = message.est_capabilities & 2
            north, east, down = map(float, message.vel)
            flies = (north, east, down)
            return self._word(message.lat, message.lon, message.alt, flies if moves else None)
        if kind == "GPS_RAW_INT" and 0 < message.h_acc < 1_000_000:
            self._accuracy_m = message.h_acc * 1e-3
        elif kind == "EXTENDED_SYS_STATE":
            self._on_ground = message.landed_state == dialect.MAV_LANDED_STATE_ON_GROUND
        return None

    def _adsb(self, message: Any) -> TargetWord | None:
        if message.flags & _ADSB_NEEDED != _ADSB_NEEDED:
            self.why = "the aircraft does not tell its position"
            return None
        velocity = None
        if message.flags & _ADSB_MOVES == _ADSB_MOVES and message.heading < _UNKNOWN_HEADING:
            heading, speed = math.radians(message.heading * 0.01), message.hor_velocity * 0.01
            down = -message.ver_velocity * 0.01
            velocity = (speed * math.cos(heading), speed * math.sin(heading), down)
        high = message.flags & dialect.ADSB_FLAGS_VALID_ALTITUDE
        altitude_m = message.altitude * 1e-3 if high else None
        return self._word(message.lat, message.lon, altitude_m, velocity, message.tslc)

    def _word(
        self,
        lat: int,
        lon: int,
        altitude_m: float | None,
        velocity: Vector3 | None,
        older_s: float = 0.0,
    ) -> TargetWord | None:
        numbers = (altitude_m or 0.0, *(velocity or ()))
        if (
            abs(lat) > 890_000_000
            or abs(lon) > 1_800_000_000
            or not all(map(math.isfinite, numbers))
        ):
            self.why = "the position is nowhere on earth"
            return None
        return TargetWord(
            self._name,
            lat * 1e-7,
            lon * 1e-7,
            self._late_s + older_s,
            altitude_m=altitude_m,
            velocity_ned_mps=velocity,
            accuracy_m=self._accuracy_m,
            on_ground=self._on_ground,
        )
