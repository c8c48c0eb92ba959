"""What a frame says, as a named tuple: a fifth of the time of pymavlink's message objects.

For frames whose checksum the framer has verified. Messages with texts or lists of
numbers, which are rare, stay pymavlink's.
"""

from __future__ import annotations

import collections
from typing import Any, ClassVar, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.mavlink.framer import MavlinkFrame
from swarm_ctl.mavlink.telemetry.incoming import FOLDS_BY_ID

_V2: Final = 0xFD
_HEADER_V2, _HEADER_V1 = 10, 6
_UNREAD_TEXTS: Final = frozenset({"ADSB_VEHICLE"})
"""No fold reads their text, so it may stay bytes."""
_fields: Final[Any] = collections.namedtuple  # noqa: PYI024 - the names are pymavlink's


class Record:
    """The fields of one message by name, as on pymavlink's message objects."""

    __slots__ = ()
    message_id: ClassVar[int]

    def get_msgId(self) -> int:  # noqa: N802 - pymavlink's name
        """The message's number."""
        return self.message_id


def _reader(number: int, kind: Any) -> tuple[Any, int, Any]:
    """What unpacks a payload, its whole size, and what makes a record of the values."""
    bases = (Record, _fields(kind.msgname, kind.ordered_fieldnames))
    record: Any = type(kind.msgname, bases, {"__slots__": (), "message_id": number})
    return kind.unpacker.unpack_from, kind.unpacker.size, record._make


_READERS: Final = {
    number: _reader(number, kind)
    for number, kind in dialect.mavlink_map.items()
    if number in FOLDS_BY_ID and (not any(kind.array_lengths) or kind.msgname in _UNREAD_TEXTS)
}


def read(frame: MavlinkFrame, codec: Any) -> Any:
    """The message in a frame; `codec`, pymavlink's, reads those with texts or lists. MAVError where
    it refuses one."""
    reader = _READERS.get(frame.message_id)
    if reader is None:
        return codec.decode(bytearray(frame.raw))
    unpack, size, record = reader
    raw = frame.raw
    header = _HEADER_V2 if raw[0] == _V2 else _HEADER_V1
    if raw[1] < size:  # zeros at the end are not sent
        return record(unpack(raw[header : header + raw[1]].ljust(size, b"\0")))
    return record(unpack(raw, header))
