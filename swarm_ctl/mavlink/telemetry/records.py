"""What a frame says, as a plain record: a third of the time of pymavlink's message objects.

For frames whose checksum the framer has verified. Messages with texts or lists of
numbers, which are rare, stay pymavlink's.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.mavlink.framer import MavlinkFrame
from swarm_ctl.mavlink.telemetry.incoming import FOLDS_BY_ID

_V2: Final = 0xFD
_HEADER_V2, _HEADER_V1 = 10, 6
_UNREAD_TEXTS: Final = frozenset({"ADSB_VEHICLE"})
"""No fold reads their text, so it may stay bytes."""


class Record(SimpleNamespace):
    """The fields of one message by name, as on pymavlink's message objects."""

    message_id: int

    def get_msgId(self) -> int:  # noqa: N802 - pymavlink's name
        """The message's number."""
        return self.message_id


_KINDS: Final[dict[int, Any]] = {
    number: kind
    for number, kind in dialect.mavlink_map.items()
    if number in FOLDS_BY_ID and (not any(kind.array_lengths) or kind.msgname in _UNREAD_TEXTS)
}


def read(frame: MavlinkFrame, codec: Any) -> Any:
    """The message in a frame; `codec`, pymavlink's, reads those with texts or lists. MAVError where
    it refuses one."""
    kind = _KINDS.get(frame.message_id)
    if kind is None:
        return codec.decode(bytearray(frame.raw))
    raw, size = frame.raw, kind.unpacker.size
    header = _HEADER_V2 if raw[0] == _V2 else _HEADER_V1
    payload = raw[header : header + min(raw[1], size)].ljust(size, b"\0")
    fields = dict(zip(kind.ordered_fieldnames, kind.unpacker.unpack(payload), strict=True))
    return Record(message_id=frame.message_id, **fields)
