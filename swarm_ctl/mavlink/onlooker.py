"""Looks at one vehicle on a port beside its agent's, and sets its parameters."""

from __future__ import annotations

import math
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.mavlink.framer import MavlinkFrame
from swarm_ctl.mavlink.outgoing import Message, interval, set_parameter
from swarm_ctl.mavlink.visitor import EACH_S, Visitor
from swarm_ctl.mavlink.wires import open_wire

_PREARM: Final = dialect.MAV_SYS_STATUS_PREARM_CHECK


class Onlooker:
    """What one vehicle says of itself. Times are the caller's clock [s].

    LinkError where the endpoint can't be opened.
    """

    def __init__(self, endpoint: str, sysid: int) -> None:
        self.armed: bool | None = None
        """As its last heartbeat said; None before the first."""
        self.heartbeats = 0
        self.may_arm = False
        """It says that its pre-arm checks pass (SYS_STATUS, on request)."""
        self.parameters: dict[str, float] = {}
        """Values that it has sent, by name."""
        self._sysid = sysid
        self._wire = open_wire(endpoint)
        self._visitor = Visitor(self._wire, sysid)
        self._ask_s = -math.inf

    def listen(self, now: float) -> None:
        """Take in what is there."""
        for frame in self._visitor.heard(now):
            self._take(frame)

    def ask_if_ready(self, now: float) -> None:
        """Have it say once a second whether it may arm."""
        self._send_at_times(interval(self._sysid, dialect.MAVLINK_MSG_ID_SYS_STATUS, 1.0), now)

    def set(self, name: str, value: float, now: float) -> bool:
        """Set a real parameter; True once the vehicle has confirmed it. To be called again."""
        if self.parameters.get(name) == value:
            return True
        kind = dialect.MAV_PARAM_TYPE_REAL32
        self._send_at_times(set_parameter(self._sysid, name, value, kind), now)
        return False

    def close(self) -> None:
        """Close the endpoint. Idempotent."""
        self._wire.close()

    def _take(self, frame: MavlinkFrame) -> None:
        try:
            message = self._visitor.read(frame)
        except dialect.MAVError:
            return
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self.armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
            self.heartbeats += 1
        elif kind == "SYS_STATUS":
            self.may_arm = bool(message.onboard_control_sensors_health & _PREARM)
        elif kind == "PARAM_VALUE":
            self.parameters[message.param_id] = message.param_value

    def _send_at_times(self, message: Message, now: float) -> None:
        """At most once a second."""
        if now >= self._ask_s:
            self._ask_s = now + EACH_S
            self._visitor.say(message, now)
