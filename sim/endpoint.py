"""MAVLink bytes: the only user of pymavlink and of sockets in `sim`.

`Codec` turns bytes into plain messages and back, for one vehicle, without any socket. `UdpPort` is where one vehicle
listens.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim.firmware.message import Message

Address = tuple[str, int]

_V2, _V1 = 0xFD, 0xFE
_V2_OVERHEAD, _V1_OVERHEAD, _SIGNATURE = 12, 8, 13
_MESSAGES: dict[str, Any] = {kind.msgname: kind for kind in mavlink.mavlink_map.values()}


class Codec:
    """Frames of one vehicle, in and out. Every datagram stands alone: a broken one harms nothing after it."""

    def __init__(self, sysid: int) -> None:
        self._mav = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=mavlink.MAV_COMP_ID_AUTOPILOT1)
        self.frames = 0
        """Good frames received."""
        self.bad = 0
        """Frames with a wrong checksum, truncated, of an unknown message, or runs of bytes that are none."""

    def pack(self, message: Message) -> bytes:
        """The next frame, with `message`."""
        frame = bytes(_MESSAGES[message.name](**message.fields).pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return frame

    def messages(self, data: bytes) -> Iterator[Message]:
        """The good frames in one datagram, in order."""
        at = 0
        lost = False
        while at < len(data):
            size = _frame_size(data, at)
            message = self._decode(data[at : at + size]) if size else None
            if message is None:
                self.bad += not lost
                lost = True
                at += 1
                continue
            lost = False
            self.frames += 1
            yield message
            at += size

    def _decode(self, frame: bytes) -> Message | None:
        try:
            decoded = self._mav.decode(bytearray(frame))
        except (mavlink.MAVError, struct.error, ValueError):
            return None
        if isinstance(decoded, mavlink.MAVLink_unknown):
            return None
        fields = {name: getattr(decoded, name) for name in decoded.fieldnames}
        return Message(decoded.msgname, fields, (decoded.get_srcSystem(), decoded.get_srcComponent()))


def _frame_size(data: bytes, at: int) -> int:
    """Length of the frame that may start at `at`; 0 where none can."""
    left = len(data) - at
    if data[at] == _V2 and left >= _V2_OVERHEAD:
        size = _V2_OVERHEAD + data[at + 1] + (_SIGNATURE if data[at + 2] & 1 else 0)
    elif data[at] == _V1 and left >= _V1_OVERHEAD:
        size = _V1_OVERHEAD + data[at + 1]
    else:
        return 0
    return size if size <= left else 0


class UdpPort:
    """A bound, non-blocking UDP socket."""

    def __init__(self, address: Address) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.socket.setblocking(False)
            self.socket.bind(address)
        except OSError:
            self.socket.close()
            raise
        self.unsent = 0
        """Datagrams the system had no room for."""

    def receive(self) -> Iterator[tuple[bytes, Address]]:
        """Everything that waits, with its sender; at most `_BURST` so that one flood can't stop the others."""
        for _ in range(_BURST):
            try:
                yield self.socket.recvfrom(65535)
            except BlockingIOError:
                return
            except OSError:
                continue

    def send(self, data: bytes, to: Address) -> None:
        """Never waits, never raises: what can't be sent is lost, as on a radio."""
        try:
            self.socket.sendto(data, to)
        except OSError:
            self.unsent += 1

    def close(self) -> None:
        """Frees the port."""
        self.socket.close()


_BURST = 256
