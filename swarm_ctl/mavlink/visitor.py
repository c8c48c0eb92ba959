"""A program on the ground that has a few words with one vehicle's autopilot. It sends no heartbeat,
so no vehicle counts it as a ground station whose silence matters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.mavlink.framer import Framer, MavlinkFrame
from swarm_ctl.mavlink.outgoing import AUTOPILOT_COMPONENT, Message
from swarm_ctl.mavlink.signing import LinkSigning
from swarm_ctl.mavlink.wires import Wire

_SYSTEM: Final = 254
"""Neither an agent nor a usual ground station (255)."""
EACH_S: Final = 1.0
"""What is not answered is said again: a vehicle that is slow to start is not flooded."""
WAIT_S: Final = 15.0
"""For the vehicle's first heartbeat, and for each of its answers."""


class Visitor:
    """One that signs, or not, on an open link. Times are the caller's clock [s]."""

    def __init__(self, wire: Wire, sysid: int, signing: LinkSigning | None = None) -> None:
        self._wire, self._sysid, self._signing = wire, sysid, signing
        self._framer = Framer()
        self._codec = dialect.MAVLink(None, _SYSTEM, dialect.MAV_COMP_ID_ONBOARD_COMPUTER)
        self._reader = dialect.MAVLink(None)
        if signing is not None:
            signing.equip(self._codec)

    def heard(self, now: float) -> Iterator[MavlinkFrame]:
        """The autopilot's frames that have come."""
        try:
            while (chunk := self._wire.read(now)) is not None:
                for frame in self._framer.feed(chunk):
                    if (frame.system, frame.component) == (self._sysid, AUTOPILOT_COMPONENT):
                        self._wire.confirm()
                        yield frame
        except OSError:
            return  # the wire connects again

    def read(self, frame: MavlinkFrame) -> Any:
        """Its message; MAVError where it is broken."""
        return self._reader.decode(bytearray(frame.raw))

    def say(self, message: Message, now: float) -> None:
        """It is lost where the link is down: the caller says it again."""
        if self._signing is not None:
            self._codec.signing.timestamp = self._signing.next_stamp(now)
        data = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) & 0xFF
        try:
            self._wire.write(data, now)
        except OSError:
            return
