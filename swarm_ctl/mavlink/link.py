"""The link to one vehicle: bytes from the wire to a view of the vehicle, goals to bytes.

Non-blocking. No message of a vehicle or a stranger raises an error here, and no socket error does:
the age of the vehicle's heartbeat shows that it is gone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.fleet import AGENT_SYSID
from swarm_ctl.core.model.vehicle import (
    Goal,
    LinkCounters,
    OwnParameters,
    OwnValue,
    ParameterNote,
    Remembered,
    VehicleIdentity,
    VehicleView,
    YieldGoal,
)
from swarm_ctl.errors import LinkError
from swarm_ctl.mavlink.autopilots import autopilot as autopilot_of
from swarm_ctl.mavlink.autopilots.timing import HEARTBEAT_LOST_S, STREAMS_HZ
from swarm_ctl.mavlink.framer import Framer, MavlinkFrame
from swarm_ctl.mavlink.mirror import Mirror
from swarm_ctl.mavlink.outgoing import AGENT_COMPONENT, AUTOPILOT_COMPONENT, Message, timesync
from swarm_ctl.mavlink.signing import LinkSigning, RefusedFrames, SigningRefusal
from swarm_ctl.mavlink.telemetry.clashes import Clashes
from swarm_ctl.mavlink.telemetry.incoming import FOLDS_BY_ID, fold
from swarm_ctl.mavlink.telemetry.records import read
from swarm_ctl.mavlink.telemetry.vehicle_telemetry import Telemetry
from swarm_ctl.mavlink.wires import Wire, open_wire

MAX_CHUNKS = 512
"""Chunks read in one `receive`, a bound for floods; a vehicle sends about 3 a tick."""
MAX_TRIED = 1024
"""Beginnings of frames looked at in one `receive`, the last chunk's not counted: 25 ms of good
frames. What is left waits, or is lost in the system's buffer."""
_TIMESYNC_S = 1.0
_REFUTED_EVERY_S = 10.0
_CHARGE_EVERY_S = 60.0
_SETPOINT_ID = dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
_HEARTBEAT_ID = dialect.MAVLINK_MSG_ID_HEARTBEAT


@dataclass(frozen=True, slots=True)
class Examined:
    """What a vehicle has told when asked."""

    firmware: str
    """Its version; '' before it is known."""
    values: dict[str, float]
    """The parameters that are known."""
    in_flight: dict[str, float]
    """What we would set."""
    telling: frozenset[str]
    """Those whose value of ours shows that an agent was there."""
    stranger: int = 0
    """The system id of another vehicle that is heard here, too; 0: none."""
    clash: str = ""
    """What two senders of one system id are, and what to do; ''."""


class VehicleLink:
    """One vehicle behind one endpoint. Times are the caller's mission clock [s].

    Args:
        endpoint: as pymavlink spells it (`udpout:127.0.0.1:14601`), or an open wire.
        autopilot: the firmware, a name in `AUTOPILOTS`.
        sysid: the system id of the vehicle, 1..250; other systems are not listened to.
        tap: gets every whole frame, in and out, with the time; it must not block.
        agent_sysid: the system id that we speak with, 1..254, not the vehicle's.
        remembers: set no parameter before `recall` was called, and `kept` with its own value.
        mirror: shares this link with ground control software.
        streams_hz: how often the vehicle is asked for its messages, by name.
        signing: signs all that is sent; no frame counts that is not signed and new. None: open.

    Raises:
        LinkError: an argument is wrong (the text says what is allowed), or the endpoint can't be
            opened.
    """

    def __init__(
        self,
        endpoint: str | Wire,
        autopilot: str,
        sysid: int,
        tap: Callable[[bytes, float], None] | None = None,
        *,
        remembers: bool = False,
        agent_sysid: int = AGENT_SYSID,
        mirror: Mirror | None = None,
        signing: LinkSigning | None = None,
        streams_hz: Mapping[str, float] = STREAMS_HZ,
    ) -> None:
        if not 1 <= sysid <= 250:
            raise LinkError(f"sysid {sysid} is out of range; allowed: 1..250")
        if not 1 <= agent_sysid <= 254 or agent_sysid == sysid:
            allowed = "1..254, and not the vehicle's sysid"
            raise LinkError(f"agent_sysid {agent_sysid} can't be used; allowed: {allowed}")
        self._autopilot = autopilot_of(autopilot, sysid, agent_sysid, streams_hz)
        if remembers:
            self._autopilot.parameters.remember()
        self._sysid = sysid
        self._tap = tap
        self._wire = open_wire(endpoint) if isinstance(endpoint, str) else endpoint
        self._mirror = mirror
        unknown = mirror is not None
        self._framers = [Framer(unknown=unknown) for _ in range(self._wire.sources)]
        self._clashes = Clashes(sysid, agent_sysid)
        self._heard = Telemetry(agent_sysid, self._autopilot.watched)
        self._codec = dialect.MAVLink(None, srcSystem=agent_sysid, srcComponent=AGENT_COMPONENT)
        self._reader = dialect.MAVLink(None)
        self._signing, self._refused = signing, RefusedFrames(sysid)
        self._trouble = self._wire_trouble = ""
        self._charge: float | None = None
        self._charge_said_s = -math.inf
        if signing is not None:
            signing.equip(self._codec)
        if self._wire.warning and autopilot == "px4":
            self._heard.texts.add(self._wire.warning)
        self._now = 0.0
        self._timesync_due = self._refuted_due = -math.inf
        self._refuted = 0
        self._seq: int | None = None
        self._frames = self._setpoints = self._lost = 0
        self._foreign = self._rejected = self._errors = 0

    def receive(self, now: float) -> None:
        """Read all pending bytes and fold them into the vehicle's telemetry."""
        self._now = now
        tried = 0
        for _ in range(MAX_CHUNKS):
            try:
                chunk = self._wire.read(now)
            except OSError:
                self._errors += 1
                return
            if chunk is None or tried > MAX_TRIED:
                return
            framer = self._framers[self._wire.source]
            tried -= framer.tried
            for frame in framer.feed(chunk):
                self._take(frame, now)
            tried += framer.tried

    def _look_for_clashes(self) -> None:
        """A clash keeps a vehicle from arming; in the air it is said, and changes nothing."""
        before, self._heard.clash = self._heard.clash, self._clashes.found(self._now)
        if self._heard.clash and self._heard.clash != before:
            self._heard.texts.add(self._heard.clash)

    def _look_at_stamps(self) -> None:
        trouble = self._signing.trouble() if self._signing is not None else ""
        if trouble and not self._trouble:
            self._heard.texts.add(trouble)
        self._trouble = trouble

    def _look_at_wire(self) -> None:
        trouble = self._wire.trouble
        if trouble and not self._wire_trouble:
            self._heard.texts.add(f"{trouble}; it is opened again when it comes back")
        self._wire_trouble = trouble

    def _look_at_battery(self) -> None:
        """A charge that was known and is not any more is worth a line; one in a minute."""
        now, charge = self._now, self._heard.battery_now(self._now)
        heard = now - self._heard.heartbeat_s <= HEARTBEAT_LOST_S  # else that is said
        lost = heard and charge is None and self._charge is not None
        if lost and now - self._charge_said_s >= _CHARGE_EVERY_S:
            self._charge_said_s = now
            self._heard.texts.add(
                f"does not say its charge any more (last {self._charge:.0f} %): the mission's"
                " battery_low can't act meanwhile"
            )
        self._charge = charge

    def view(self) -> VehicleView:
        """A snapshot as of the last `receive`. Each STATUSTEXT is in one snapshot only."""
        heard, driver, now = self._heard, self._autopilot, self._now
        self._say_refuted()
        self._look_for_clashes()
        self._look_at_stamps()
        self._look_at_wire()
        self._look_at_battery()
        if heard.contacts:
            heard.forget_old_contacts(now)
        mode = driver.mode(heard)
        fault = driver.fault(heard)
        refused = self._refused.words(now)
        missing = fault or driver.missing(heard, now)
        if self._wire.trouble and now - heard.heartbeat_s > HEARTBEAT_LOST_S:
            missing = f"{missing}: {self._wire.trouble}"
        if refused and math.isinf(heard.heartbeat_s):
            missing = f"{refused}; allowed: frames signed with its key (swarm-ctl trust vehicle)"
        return VehicleView(
            heartbeat_s=heard.heartbeat_s,
            autopilot=driver.name if heard.autopilot == driver.wire_id else "",
            fault=fault,
            armed=heard.armed,
            mode=mode,
            mode_doubt=heard.evidence.doubt,
            controlled=mode == driver.controlled_mode,
            controlled_mode=driver.controlled_mode,
            climbs_by_setpoints=driver.climbs_by_setpoints,
            landing=mode == driver.landing_mode,
            on_ground=heard.on_ground,
            healthy=not missing,
            health_reason=missing,
            released=driver.parameters.released(heard),
            unsafe=driver.parameters.unsafe(now),
            own=self._own(),
            notes=self._notes(),
            battery_percent=self._charge,
            tilt_deg=heard.tilt_now(now),
            wind_mps=heard.wind_now(now),
            estimates_wind=driver.estimates_wind(heard),
            position_accuracy_m=heard.estimate.position_accuracy_m,
            estimate_fault=heard.estimate.fault(driver.estimate_rules, now),
            limits=driver.flight_limits.limits(heard),
            unread_limits=driver.flight_limits.unread(heard),
            origin=heard.origin,
            local=heard.local,
            global_=heard.global_,
            contacts=tuple(heard.contacts.values()),
            texts=heard.texts.take(now),
            frames=self._frames - self._foreign,
            frames_lost=self._lost,
            signed=self._signing is not None,
            refused=refused,
            refusals={str(why): count for why, count in self._refused.total.items()},
            round_trip_s=heard.round_trip_now(now),
        )

    @property
    def identity(self) -> VehicleIdentity | None:
        """Which vehicle this is; None until it has said so, or has not answered for long enough."""
        return self._autopilot.identity(self._heard)

    @property
    def recalled(self) -> bool:
        """`recall` was called, or is not needed."""
        return self._autopilot.parameters.recalled

    def recall(self, remembered: Remembered | None) -> None:
        """What an earlier flight remembered of this vehicle's own parameters, and left changed."""
        if remembered is not None:
            self._heard.watched |= remembered.values.keys()
        self._autopilot.parameters.recall(remembered)

    def kept(self, values: Mapping[str, OwnValue]) -> None:
        """These own values of the vehicle are stored: its parameters may be set."""
        self._autopilot.parameters.kept(values)

    def not_kept(self, why: str) -> None:
        """The own values can't be stored: nothing is set, and the vehicle is not healthy."""
        self._autopilot.parameters.obstacle = why

    def examine(self, names: Iterable[str], now: float) -> Examined:
        """Ask for the vehicle's version and these parameters, and for no more: no heartbeat is
        sent, which might keep a vehicle in the air."""
        driver, heard = self._autopilot, self._heard
        heard.watched |= frozenset(names)
        messages = driver.ask_version(heard, now) + driver.parameters.read(names, heard, now)
        for message in messages:
            self._send(message, now)
        own, others = driver.parameters, (heard.stranger, heard.clash)
        return Examined(heard.firmware, own.values(heard), dict(own.wanted), own.telling, *others)

    def put_back(self, now: float) -> None:
        """Set the vehicle's own parameters that were recalled and `kept`; none while it is armed
        or not heard."""
        if now - self._heard.heartbeat_s <= HEARTBEAT_LOST_S:
            for message in self._autopilot.parameters.restore(self._heard, now):
                self._send(message, now)

    def _own(self) -> OwnParameters | None:
        parameters = self._autopilot.parameters
        if not parameters.own or not parameters.remembers or (identity := self.identity) is None:
            return None
        return OwnParameters(identity, dict(parameters.own), parameters.given_back)

    def _notes(self) -> tuple[ParameterNote, ...]:
        notes = tuple(self._autopilot.parameters.notes)
        self._autopilot.parameters.notes.clear()
        return notes

    def _say_refuted(self) -> None:
        """Heartbeats that those after them refute are worth a line, not one each in a flood."""
        heard, driver, evidence = self._heard, self._autopilot, self._heard.evidence
        if evidence.refuted == self._refuted or self._now < self._refuted_due:
            return
        self._refuted, self._refuted_due = evidence.refuted, self._now + _REFUTED_EVERY_S
        told = f"{driver.modes.name(evidence.told.custom_mode) or 'no mode'}, "
        told += "armed" if evidence.told.armed else "disarmed"
        heard.texts.add(
            f"a heartbeat said {told}; those after it did not, so it is ignored"
            f" ({evidence.refuted} so far): forged, or garbled on the link"
        )

    def pursue(self, goal: Goal, now: float) -> None:
        """Send what `goal` needs now. A tick without this call sends nothing: the vehicle's own
        failsafe notices a stalled agent."""
        for message in self._autopilot.pursue(goal, self._heard, now):
            self._send(message, now)
        if now >= self._timesync_due and self._may_ask(goal):
            self._timesync_due = now + _TIMESYNC_S
            self._send(timesync(now), now)

    def share(self, now: float) -> None:
        """Give ground control software its share of the link: after everything else in a tick, and
        a few frames only."""
        for frame in self._mirror.exchange() if self._mirror is not None else ():
            if not self._may_pass(frame, now):
                continue
            try:
                self._wire.write(frame, now)
            except OSError:
                self._errors += 1

    def _may_ask(self, goal: Goal) -> bool:
        """As in the driver, a vehicle that is silent, of a wrong type or flown by a pilot gets our
        heartbeats only."""
        known = math.isfinite(self._heard.heartbeat_s) and not self._autopilot.fault(self._heard)
        return known and not isinstance(goal, YieldGoal)

    @property
    def counters(self) -> LinkCounters:
        return LinkCounters(
            frames=self._frames,
            bad_frames=sum(framer.bad for framer in self._framers),
            setpoints=self._setpoints,
            lost=self._lost,
            foreign=self._foreign,
            rejected=self._rejected,
            errors=self._errors,
            refused=self._refused.total.total(),
        )

    def close(self) -> None:
        """Close the endpoint. Idempotent."""
        self._wire.close()
        if self._mirror is not None:
            self._mirror.close()

    def _may_pass(self, raw: bytes, now: float) -> bool:
        """A frame of ground control software, to a vehicle that may take unsigned ones on this link
        (an ArduPilot does on USB)."""
        if self._signing is None:
            return True
        frames = Framer(unknown=True).feed(raw)
        whole = b"".join(frame.raw for frame in frames) == raw
        return whole and not any(self._refusal(frame, now) for frame in frames)

    def _refusal(self, frame: MavlinkFrame, now: float) -> SigningRefusal | None:
        """Why the frame does not count; on an open link each does."""
        refusal = None if self._signing is None else self._signing.refusal(frame)
        if refusal is not None:
            self._refused.note(refusal, frame, now)
        return refusal

    def _take(self, frame: MavlinkFrame, now: float) -> None:
        if self._signing is not None and (refusal := self._refusal(frame, now)) is not None:
            if refusal is SigningRefusal.REPLAYED and math.isinf(self._heard.heartbeat_s):
                self._wire.confirm()  # the vehicle, with an old clock: it sets that by our frames
            return
        self._frames += 1
        if self._tap is not None:
            self._tap(frame.raw, now)
        self._clashes.hear(frame, now)
        if frame.system != self._sysid or frame.component != AUTOPILOT_COMPONENT:
            self._foreign += 1
            if frame.component == AUTOPILOT_COMPONENT:
                self._heard.stranger = frame.system
            return
        self._wire.confirm(proven=self._signing is not None)
        self._count_lost(frame.seq)
        if self._mirror is not None:
            self._mirror.keep(frame.raw)
        if frame.message_id not in FOLDS_BY_ID:
            self._heard.count(frame.message_id)
            return
        try:
            message = read(frame, self._reader)
        except dialect.MAVError:
            self._rejected += 1
            return
        if not fold(self._heard, message, now):
            self._rejected += 1
            if frame.message_id == _HEARTBEAT_ID:
                self._clashes.other_kind(now)

    def _count_lost(self, seq: int) -> None:
        """By the gap in the 8-bit seq; a gap over half its range is a late or repeated frame."""
        if self._seq is not None:
            gap = (seq - self._seq - 1) & 0xFF
            if gap >= 128:
                return
            self._lost += gap
        self._seq = seq

    def _send(self, message: Message, now: float) -> None:
        if self._signing is not None:
            self._codec.signing.timestamp = self._signing.next_stamp(now)
        data = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) & 0xFF
        try:
            self._wire.write(data, now)
        except OSError:
            self._errors += 1
            return
        if self._tap is not None:
            self._tap(data, now)
        number = message.get_msgId()
        if number == _HEARTBEAT_ID:
            self._clashes.sent(data)
        self._setpoints += number == _SETPOINT_ID
