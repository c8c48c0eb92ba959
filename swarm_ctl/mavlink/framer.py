"""Cuts bytes into MAVLink frames, and finds the next frame after bytes that are none.

pymavlink's parser drops as many bytes as a false header claims (up to 280), with the good frames
among them. Real autopilots send plain text before and between frames on TCP. So here a failed
checksum costs one byte, not a frame.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

_MAGIC = re.compile(rb"[\xfd\xfe]")
_V2, _V1 = 0xFD, 0xFE
_HEADER_V2, _HEADER_V1 = 10, 6
_SIGNED = 0x01
_SIGNATURE_BYTES = 13
_CRC_EXTRA: dict[int, bytes] = {
    number: bytes([message.crc_extra]) for number, message in dialect.mavlink_map.items()
}
_CRC = struct.Struct("<H")
_MOST_UNKNOWN = 8
"""Frames of unknown messages in a row that are stepped over."""
_MOST_FAILURES = 32
"""False beginnings in a row. A cut frame has a few; a hostile chunk could have thousands, of some
microseconds each: the rest of the chunk is dropped."""


def _slow_checksum(data: bytes) -> int:
    return int(dialect.x25crc(data).crc)


_checksum: Callable[[bytes], int] = dialect.mcrf4xx or _slow_checksum

_NONE, _PARTIAL = 0, -1
"""`_size` of bytes that start no frame, and of bytes that may start one but are not complete."""


class MavlinkFrame(NamedTuple):
    """A frame with a good checksum. `raw`: all of it, with header, checksum and signature."""

    message_id: int
    seq: int
    system: int
    component: int
    raw: bytes

    @property
    def signed(self) -> bool:
        """It has a signature, right or wrong."""
        return self.raw[0] == _V2 and bool(self.raw[2] & _SIGNED)


class Framer:
    """Cuts a stream of chunks into frames; `bad` counts runs of bytes that were no frame, `tried`
    all beginnings that were looked at, which is what it costs.

    With `unknown`, frames of messages that the dialect does not have are passed, too. Their
    checksum can't be verified: they count where another frame or the end of the chunk follows.
    Without it they are stepped over whole, where a good frame follows: their payload may be full of
    bytes that look like beginnings.
    """

    def __init__(self, *, unknown: bool = False) -> None:
        self.bad = self.tried = 0
        self._unknown = unknown
        self._rest = b""
        self._skipping = False

    def feed(self, data: bytes) -> list[MavlinkFrame]:
        """The frames completed by `data`. Keeps at most one incomplete frame (280 bytes), and
        a few unknown ones before it.

        Bytes that may begin a frame are dropped as soon as a whole good frame follows them.
        """
        data = self._rest + data
        frames: list[MavlinkFrame] = []
        partial = None
        done = position = failures = 0
        while found := _MAGIC.search(data, position):
            at = found.start()
            self.tried += 1
            size = _size(data, at, unknown=self._unknown)
            position = at + 1
            if size > 0:
                if at > done:
                    self._skip()
                frame = _frame(data[at : at + size])
                if self._unknown or frame.message_id in _CRC_EXTRA:
                    self._skipping = False
                    frames.append(frame)
                else:
                    self._skip()
                done = position = at + size
                partial = None
                failures = 0
            elif size == _PARTIAL and partial is None:
                partial = at
            failures += size <= 0
            if failures > _MOST_FAILURES:
                break
        end = len(data) if partial is None else partial
        self._rest = data[end:]
        if end > done:
            self._skip()
        return frames

    def _skip(self) -> None:
        self.bad += not self._skipping
        self._skipping = True


def _size(data: bytes, at: int, *, unknown: bool = False, followed: int = 0) -> int:
    """Length of the good frame that starts at `at`, or _PARTIAL, or _NONE. `followed`: so many
    unknown ones in a row stand before it."""
    available = len(data) - at
    header = _HEADER_V2 if data[at] == _V2 else _HEADER_V1
    if available < header:
        return _PARTIAL
    size = header + data[at + 1] + 2
    if header == _HEADER_V2:
        if data[at + 2] & ~_SIGNED:
            return _NONE
        if data[at + 2]:
            size += _SIGNATURE_BYTES
    extra = _CRC_EXTRA.get(_message_id(data, at))
    if available < size:
        return _PARTIAL
    if extra is None and unknown:
        return size if available == size or data[at + size] in (_V2, _V1) else _NONE
    if extra is None:
        return _stepped(data, at, size, followed)
    end = at + header + data[at + 1]
    good = _checksum(data[at + 1 : end] + extra) == _CRC.unpack_from(data, end)[0]
    return size if good else _NONE


def _stepped(data: bytes, at: int, size: int, followed: int) -> int:
    """Length of an unknown message's frame, which counts by the good frame after it."""
    if at + size == len(data):
        return _PARTIAL
    if data[at + size] not in (_V2, _V1) or followed >= _MOST_UNKNOWN:
        return _NONE
    after = _size(data, at + size, followed=followed + 1)
    return size if after > 0 else after


def _message_id(data: bytes, at: int) -> int:
    if data[at] == _V2:
        return data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16
    return data[at + 5]


def _frame(raw: bytes) -> MavlinkFrame:
    if raw[0] == _V2:
        return MavlinkFrame(_message_id(raw, 0), raw[4], raw[5], raw[6], raw)
    return MavlinkFrame(raw[5], raw[2], raw[3], raw[4], raw)
