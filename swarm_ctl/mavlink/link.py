"""The link to one vehicle: bytes in and out, and in between what is known and what is wanted.

The only user of the wires. Non-blocking, and nothing a vehicle or a stranger sends can raise out of
it; neither does a socket error: the age of the vehicle's heartbeat tells that it is gone.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.vehicle import Goal, LinkCounters, VehicleView, YieldGoal
from swarm_ctl.errors import LinkError
from swarm_ctl.mavlink.autopilots import autopilot as autopilot_of
from swarm_ctl.mavlink.framer import Frame, Framer
from swarm_ctl.mavlink.incoming import FOLDS_BY_ID, Heard, fold
from swarm_ctl.mavlink.outgoing import (
    AUTOPILOT_COMPONENT,
    SOURCE_COMPONENT,
    SOURCE_SYSTEM,
    Message,
    timesync,
)
from swarm_ctl.mavlink.wires import Wire, open_wire

MAX_CHUNKS = 2048
"""Chunks read in one `receive`: a flood costs a bounded time per tick (a vehicle sends about 3 a
tick)."""
_TIMESYNC_S = 1.0
_SETPOINT_ID = dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED


class VehicleLink:
    """One vehicle behind one endpoint. Times are the caller's mission clock [s].

    `endpoint` is a URL as pymavlink spells them (`udpout:127.0.0.1:14601`) or an open wire;
    `autopilot` names the firmware; `sysid` (1..250) is the only vehicle listened to. LinkError says
    what would be allowed. `tap` is given every whole frame that passes, with the time; it must not
    wait for anything.
    """

    def __init__(
        self,
        endpoint: str | Wire,
        autopilot: str,
        sysid: int,
        tap: Callable[[bytes, float], None] | None = None,
    ) -> None:
        if not 1 <= sysid <= 250:
            raise LinkError(f"sysid {sysid} is not one; allowed: 1..250")
        self._autopilot = autopilot_of(autopilot, sysid)
        self._sysid = sysid
        self._tap = tap
        self._wire = open_wire(endpoint) if isinstance(endpoint, str) else endpoint
        self._framer = Framer()
        self._heard = Heard(watched=frozenset(self._autopilot.failsafes))
        self._codec = dialect.MAVLink(None, srcSystem=SOURCE_SYSTEM, srcComponent=SOURCE_COMPONENT)
        self._secure()
        self._now = 0.0
        self._timesync_due = -math.inf
        self._seq: int | None = None
        self._frames = self._setpoints = self._lost = 0
        self._foreign = self._rejected = self._errors = 0

    def receive(self, now: float) -> None:
        """Read everything pending and fold it into what is known."""
        self._now = now
        for _ in range(MAX_CHUNKS):
            try:
                chunk = self._wire.read(now)
            except OSError:
                self._errors += 1
                return
            if chunk is None:
                return
            for frame in self._framer.feed(chunk):
                self._take(frame, now)

    def view(self) -> VehicleView:
        """A snapshot as of the last `receive`. Hands out each text once."""
        heard, driver, now = self._heard, self._autopilot, self._now
        if heard.contacts:
            heard.forget_old_contacts(now)
        mode = driver.mode(heard.custom_mode)
        fault = driver.fault(heard)
        missing = fault or driver.missing(heard, now)
        return VehicleView(
            heartbeat_s=heard.heartbeat_s,
            autopilot=driver.name if heard.autopilot == driver.wire_id else "",
            fault=fault,
            armed=heard.armed,
            mode=mode,
            controlled=mode == driver.controlled_mode,
            taken_off=mode in driver.takeoff_modes,
            landing=mode == driver.landing_mode,
            on_ground=heard.on_ground,
            healthy=not missing,
            health_reason=missing,
            released=driver.parameters.released(heard),
            battery_percent=heard.battery_percent,
            tilt_deg=heard.tilt_deg,
            wind_mps=heard.wind_now(now),
            origin=heard.origin,
            local=heard.local,
            global_=heard.global_,
            contacts=tuple(heard.contacts.values()),
            texts=heard.texts.take(now),
            frames=self._frames - self._foreign,
            frames_lost=self._lost,
            round_trip_s=heard.round_trip_s,
        )

    def pursue(self, goal: Goal, now: float) -> None:
        """Send what `goal` needs now. A tick without this call sends nothing, so that silence is a
        deadman."""
        for message in self._autopilot.pursue(goal, self._heard, now):
            self._send(message, now)
        if now >= self._timesync_due and self._may_ask(goal):
            self._timesync_due = now + _TIMESYNC_S
            self._send(timesync(now), now)

    def _may_ask(self, goal: Goal) -> bool:
        """Like the driver: nothing but heartbeats to a vehicle that is not heard, not ours, or
        flown by a pilot."""
        known = math.isfinite(self._heard.heartbeat_s) and not self._autopilot.fault(self._heard)
        return known and not isinstance(goal, YieldGoal)

    @property
    def counters(self) -> LinkCounters:
        """What was counted since the link was opened."""
        return LinkCounters(
            frames=self._frames,
            bad_frames=self._framer.bad,
            setpoints=self._setpoints,
            lost=self._lost,
            foreign=self._foreign,
            rejected=self._rejected,
            errors=self._errors,
        )

    def close(self) -> None:
        """Give the endpoint back. Idempotent."""
        self._wire.close()

    def _secure(self) -> None:
        """The one place for MAVLink 2 signing (off): set the key and its rules on
        `self._codec.signing` here."""

    def _take(self, frame: Frame, now: float) -> None:
        self._frames += 1
        if self._tap is not None:
            self._tap(frame.raw, now)
        if frame.system != self._sysid or frame.component != AUTOPILOT_COMPONENT:
            self._foreign += 1
            if frame.component == AUTOPILOT_COMPONENT:
                self._heard.stranger = frame.system
            return
        self._wire.confirm()
        self._count_lost(frame.seq)
        if frame.message_id not in FOLDS_BY_ID:
            return
        try:
            message = self._codec.decode(bytearray(frame.raw))
        except dialect.MAVError:
            self._rejected += 1
            return
        self._rejected += not fold(self._heard, message, now)

    def _count_lost(self, seq: int) -> None:
        """By the gap in the 8-bit seq; more than half a turn is a frame that came late or twice."""
        if self._seq is not None:
            gap = (seq - self._seq - 1) & 0xFF
            if gap >= 128:
                return
            self._lost += gap
        self._seq = seq

    def _send(self, message: Message, now: float) -> None:
        data = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) & 0xFF
        try:
            self._wire.write(data, now)
        except OSError:
            self._errors += 1
            return
        if self._tap is not None:
            self._tap(data, now)
        self._setpoints += message.get_msgId() == _SETPOINT_ID
