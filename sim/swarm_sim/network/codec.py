"""MAVLink bytes: the only user of pymavlink in `sim`.

`Codec` turns bytes into plain messages and back, for one vehicle. The message definitions and the
checksum are pymavlink's; packing and unpacking is one table of precompiled structs, which takes a
third of the time of pymavlink's message objects (the tests compare the two byte by byte).
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_sim.firmware.message import Message
from swarm_sim.network.signing import SIGNATURE_BYTES, VehicleSigning

_V2, _V1 = 0xFD, 0xFE
_V2_HEADER, _V1_HEADER, _CRC = 10, 6, 2
_SIGNED = 0x01
_MAGIC = re.compile(rb"[\xfd\xfe]")
_MOST_FAILURES = 32
"""False beginnings of frames in a row; the rest of such a datagram is dropped."""
_AUTOPILOT = 1
_HEAD = struct.Struct("<BBBBBBBHB")
_CHECK = struct.Struct("<H")


@dataclass(frozen=True, slots=True)
class _Field:
    """One field in wire order: `size` is 0 for a number, or the length of an array or a text."""

    name: str
    size: int
    is_text: bool

    @property
    def zero(self) -> Any:
        """What a field holds that isn't given."""
        return b"" if self.is_text else [0] * self.size if self.size else 0


class _Layout:
    """How the fields of one message are laid out on the wire."""

    def __init__(self, kind: Any) -> None:
        self.name: str = kind.msgname
        self.id: int = kind.id
        self.struct: struct.Struct = kind.unpacker
        self.extra = bytes([kind.crc_extra])
        self.names: list[str] = list(kind.ordered_fieldnames)
        kinds = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
        sizes = zip(self.names, kind.array_lengths, strict=True)
        self.fields = [
            _Field(name, size, kinds[name] == "char" and size > 0) for name, size in sizes
        ]
        self._zeros = {field.name: field.zero for field in self.fields}
        self.plain = not any(field.size for field in self.fields)
        self._listless = all(field.is_text or not field.size for field in self.fields)
        self._pick: Callable[[dict[str, Any]], tuple[Any, ...]] = (
            itemgetter(*self.names) if len(self.names) > 1 else lambda f: (f[self.names[0]],)
        )

    def payload(self, fields: dict[str, Any]) -> bytes:
        """The payload without its trailing zeros, as MAVLink 2 wants it.

        A field that isn't given is zero.
        """
        if len(fields) != len(self.names):
            fields = self._zeros | fields
        values = self._pick(fields) if self._listless else self._flat(fields)
        try:
            packed = self.struct.pack(*values)
        except (struct.error, OverflowError):
            packed = self.struct.pack(*self._saturated(values))
        return packed.rstrip(b"\0") or b"\0"

    def _saturated(self, values: Sequence[Any]) -> list[Any]:
        """Numbers that don't fit their field become the nearest that do."""
        codes: list[str] = []
        for count, code in _CODES.findall(self.struct.format):
            codes += [code] * (int(count or 1) if code != "s" else 1)
        return [_fit(code, value) for code, value in zip(codes, values, strict=True)]

    def fields_of(self, payload: bytes) -> dict[str, Any]:
        """The fields of a payload, which is filled with zeros or cut to the message's length."""
        size = self.struct.size
        if len(payload) != size:
            payload = payload.ljust(size, b"\0")[:size]
        values = self.struct.unpack(payload)
        return dict(zip(self.names, values, strict=True)) if self.plain else self._grouped(values)

    def _flat(self, fields: dict[str, Any]) -> list[Any]:
        flat: list[Any] = []
        for field in self.fields:
            value = fields[field.name]
            flat += value if field.size and not field.is_text else [value]
        return flat

    def _grouped(self, values: tuple[Any, ...]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        at = 0
        for field in self.fields:
            width = field.size if field.size and not field.is_text else 1
            if field.is_text:
                found[field.name] = values[at].split(b"\0", 1)[0].decode("ascii", "replace")
            else:
                found[field.name] = list(values[at : at + width]) if field.size else values[at]
            at += width
        return found


_CODES = re.compile(r"(\d*)([a-zA-Z])")


def _fit(code: str, value: Any) -> Any:
    if code == "f" and math.isfinite(value) and abs(value) > _FLOAT_MAX:
        return math.copysign(_FLOAT_MAX, value)
    if code in "fsd":
        return value
    bits = 8 * struct.calcsize("<" + code)
    low, high = (0, 2**bits - 1) if code.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return min(max(value, low), high)


_FLOAT_MAX = 3.4028234e38


class _AvailableModes:
    """As pymavlink describes a message. Its dialect of ArduPilot does not have this one yet, which
    both autopilots send."""

    msgname = "AVAILABLE_MODES"
    id = 435
    crc_extra = 134
    unpacker = struct.Struct("<IIBBB35s")
    fieldnames = ordered_fieldnames = (
        *("custom_mode", "properties", "number_modes", "mode_index", "standard_mode"),
        "mode_name",
    )
    fieldtypes = ("uint32_t", "uint32_t", "uint8_t", "uint8_t", "uint8_t", "char")
    array_lengths = (0, 0, 0, 0, 0, 35)


_LAYOUTS: dict[int, _Layout] = {
    number: _Layout(kind)
    for number, kind in ({_AvailableModes.id: _AvailableModes} | mavlink.mavlink_map).items()
}
_BY_NAME: dict[str, _Layout] = {layout.name: layout for layout in _LAYOUTS.values()}


def _slow_checksum(data: bytes) -> int:
    return int(mavlink.x25crc(data).crc)


_checksum: Callable[[bytes], int] = mavlink.mcrf4xx or _slow_checksum


class Codec:
    """Frames of one vehicle, in and out. A broken datagram does not harm the next."""

    def __init__(self, sysid: int, signing: VehicleSigning | None = None, link: int = 0) -> None:
        self._sysid = sysid
        self._signing = signing or VehicleSigning(None, int)
        self._link = link
        self._sequence = 0
        self.frames = 0
        """Good frames received."""
        self.bad = 0
        """Frames that are truncated, unknown or have a wrong checksum, and runs of other bytes."""
        self.unsigned = 0
        """Frames refused for want of a good signature."""

    def pack(self, message: Message) -> bytes:
        """The next frame, with `message`."""
        layout = _BY_NAME[message.name]
        payload = layout.payload(message.fields)
        flags = _SIGNED if self._signing.active else 0
        source = (self._sequence, self._sysid, _AUTOPILOT)
        number = (layout.id & 0xFFFF, layout.id >> 16)
        body = _HEAD.pack(_V2, len(payload), flags, 0, *source, *number) + payload
        self._sequence = (self._sequence + 1) & 0xFF
        frame = body + _CHECK.pack(_checksum(body[1:] + layout.extra))
        return frame + self._signing.sign(frame, self._link) if flags else frame

    def messages(self, data: bytes) -> Iterator[Message]:
        """The good frames in one datagram, in order."""
        at = failures = 0
        lost = False
        while (found := _MAGIC.search(data, at)) and failures <= _MOST_FAILURES:
            self.bad += found.start() > at and not lost
            lost = lost or found.start() > at
            at = found.start()
            size = frame_size(data, at)
            frame = data[at : at + size]
            message = self._decode(frame) if size else None
            at += size if message else 1
            if message is None:
                self.bad += not lost
                lost = True
                failures += 1
                continue
            lost, failures = False, 0
            if not self._signing.active or self._signing.accepts(frame, message.source):
                self.frames += 1
                yield message
            else:
                self.unsigned += 1
        self.bad += at < len(data) and not lost

    def _decode(self, frame: bytes) -> Message | None:
        if frame[0] == _V2:
            _, length, flags, _, _, system, component, low, high = _HEAD.unpack_from(frame)
            if flags & ~_SIGNED:
                return None
            head, number = _V2_HEADER, low | high << 16
        else:
            _, length, _, system, component, number = frame[:_V1_HEADER]
            head = _V1_HEADER
        layout = _LAYOUTS.get(number)
        if layout is None:
            return None
        end = head + length
        if _CHECK.unpack_from(frame, end)[0] != _checksum(frame[1:end] + layout.extra):
            return None
        return Message(layout.name, layout.fields_of(frame[head:end]), (system, component))


def split_stream(data: bytes) -> tuple[bytes, bytes]:
    """The bytes of a stream that can be decoded now, and the rest: a frame that isn't complete."""
    at = 0
    while at < len(data):
        size = frame_size(data, at)
        if not size and data[at] in (_V2, _V1):
            return data[:at], data[at:]
        at += size or 1
    return data, b""


def frame_size(data: bytes, at: int) -> int:
    """Length of the frame that may start at `at`; 0 where none does, or isn't complete."""
    left = len(data) - at
    if data[at] == _V2 and left >= _V2_HEADER + _CRC:
        size = _V2_HEADER + _CRC + data[at + 1] + (SIGNATURE_BYTES if data[at + 2] & _SIGNED else 0)
    elif data[at] == _V1 and left >= _V1_HEADER + _CRC:
        size = _V1_HEADER + _CRC + data[at + 1]
    else:
        return 0
    return size if size <= left else 0
