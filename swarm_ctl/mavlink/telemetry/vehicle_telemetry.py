"""What is known of one vehicle from its messages, in the wire's terms (SI units)."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from swarm_ctl.core.model.fleet import AGENT_SYSID
from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.core.model.timeouts import FRESH_S
from swarm_ctl.core.model.vehicle import FALLS_MPS, Contact, GlobalFix, LocalFix
from swarm_ctl.mavlink.telemetry.estimate import EstimateHealth
from swarm_ctl.mavlink.telemetry.heartbeats import HeartbeatEvidence

WIND_KEPT_S = 10.0
"""An estimate not repeated for this long (PX4 sends one in 2 s) is no estimate."""
CHARGE_KEPT_S = 10.0
"""Of the battery; each vehicle is asked for it once a second at least."""
TILT_KEPT_S = 3.0
"""ATTITUDE comes once a second at least."""
ROUND_TRIP_KEPT_S = 10.0
"""Ten requests without an answer."""
CONTACT_KEPT_S = 10.0
"""A contact not repeated for this long is dropped; `core` judges the age of a contact before."""
REBOOT_BACK_S = 5.0
"""The vehicle restarted if its own clock goes back this far; less may be a late frame."""
RESTARTS_SAID_S = 10.0
"""No vehicle restarts more often: two clocks are two senders, which would fill the log."""


_UNKNOWN: Final = (0.0, -math.inf)


@dataclass(slots=True)
class ParameterValue:
    """A PARAM_VALUE as it came: `raw` still in the vehicle's encoding of MAV_PARAM_TYPE `kind`."""

    raw: float
    kind: int


MAX_TEXTS = 32
CHUNK = 50
"""Characters in a STATUSTEXT; a shorter chunk is the last one."""
MAX_CHUNKS = 8
COMPLETE_S = 1.0
"""A text whose last chunk has not come after this time is passed on without it."""


@dataclass(slots=True)
class StatusTexts:
    """The newest `MAX_TEXTS` texts, and at most one incomplete text."""

    _done: deque[str] = field(default_factory=lambda: deque(maxlen=MAX_TEXTS))
    _chunks: list[str] = field(default_factory=list)
    _number: int = 0
    _heard_s: float = 0.0

    def add(self, text: str) -> None:
        """Store a whole text."""
        self._done.append(_printable(text))

    def add_chunk(self, text: str, number: int, now: float) -> None:
        """Store a chunk of the long text `number` (> 0)."""
        if self._chunks and self._number != number:
            self._finish()
        self._number, self._heard_s = number, now
        self._chunks.append(text)
        if len(text) < CHUNK or len(self._chunks) >= MAX_CHUNKS:
            self._finish()

    def take(self, now: float) -> tuple[str, ...]:
        """The texts since the last call."""
        if self._chunks and now - self._heard_s > COMPLETE_S:
            self._finish()
        taken = tuple(self._done)
        self._done.clear()
        return taken

    def _finish(self) -> None:
        self.add("".join(self._chunks))
        self._chunks.clear()


def _printable(text: str) -> str:
    """Control characters could change an operator's terminal."""
    return "".join(c if c.isprintable() else "?" for c in text)


@dataclass(slots=True)
class Telemetry:
    """Mutable; the vehicle link owns it. Times are the link's clock [s], -inf: never heard."""

    agent_sysid: int = AGENT_SYSID
    """The system id that we speak with."""
    watched: frozenset[str] = frozenset()
    """The names of the parameters to store; others are dropped, so a flood costs no memory."""
    heartbeat_s: float = -math.inf
    first_heartbeat_s: float = math.inf
    clash: str = ""
    """What two senders of one system id on this link are, and what to do; ''."""
    stranger: int = 0
    """The system id of another vehicle heard on this link, 0 for none."""
    autopilot: int = -1
    """MAV_AUTOPILOT, -1 before the first heartbeat."""
    vehicle_type: int = -1
    """MAV_TYPE, -1 before the first heartbeat."""
    evidence: HeartbeatEvidence = field(default_factory=HeartbeatEvidence)
    """Decides which heartbeats are believed."""
    armed: bool = False
    """As believed, like `custom_mode`."""
    custom_mode: int | None = None
    """None while unknown, or where the heartbeat says that the vehicle has none."""
    on_ground: bool = True
    landed_s: float = -math.inf
    """When EXTENDED_SYS_STATE last said whether it is on the ground."""
    system_status_s: float = -math.inf
    sensors_present: int = 0
    sensors_enabled: int = 0
    sensors_health: int = 0
    charges: dict[str, tuple[float, float]] = field(default_factory=dict)
    """The battery's charge [percent] and when it came, by the message that said so: SYS_STATUS,
    BATTERY_STATUS. One that says that it does not know has none."""
    tilt_deg: float = 0.0
    tilt_s: float = -math.inf
    wind_mps: float = 0.0
    wind_s: float = -math.inf
    origin: Geodetic | None = None
    local: LocalFix | None = None
    global_: GlobalFix | None = None
    contacts: dict[int, Contact] = field(default_factory=dict)
    """By ICAO address."""
    parameters: dict[str, ParameterValue] = field(default_factory=dict)
    parameter_news: object = field(default_factory=object, compare=False)
    """Another one after each change of `parameters`: what follows from them is worked out then."""
    counts: dict[int, int] = field(default_factory=dict)
    """Messages that came so far, but refused ones, by message id."""
    uid: str | None = None
    """AUTOPILOT_VERSION: uid2, else uid, in hexadecimal; '' where it has none; None: not heard."""
    firmware: str = ""
    """AUTOPILOT_VERSION: flight_sw_version in words, e.g. `4.7.0-dev`."""
    answers: dict[int, int] = field(default_factory=dict)
    """MAV_RESULT of the last COMMAND_ACK by command: a repeated refusal is reported once."""
    texts: StatusTexts = field(default_factory=StatusTexts)
    estimate: EstimateHealth = field(default_factory=EstimateHealth)
    round_trip_s: float = 0.0
    """Of the newest TIMESYNC answer."""
    answered_s: float = -math.inf
    """When it came."""
    boot_s: float = 0.0
    """The vehicle's own clock at its last LOCAL_POSITION_NED or GLOBAL_POSITION_INT."""
    restart_said_s: float = -math.inf

    def forget_old_contacts(self, now: float) -> None:
        """Drop the contacts not repeated for `CONTACT_KEPT_S`."""
        old = [a for a, contact in self.contacts.items() if now - contact.time_s > CONTACT_KEPT_S]
        for address in old:
            del self.contacts[address]

    def count(self, message_id: int) -> None:
        """A message of this id has come."""
        self.counts[message_id] = self.counts.get(message_id, 0) + 1

    def wind_now(self, now: float) -> float | None:
        """Horizontal wind [m/s] while the vehicle reports it."""
        return self.wind_mps if now - self.wind_s <= WIND_KEPT_S else None

    def battery_now(self, now: float) -> float | None:
        """The charge [percent] while the vehicle reports it; SYS_STATUS first."""
        for message in ("SYS_STATUS", "BATTERY_STATUS"):
            percent, at = self.charges.get(message, _UNKNOWN)
            if now - at <= CHARGE_KEPT_S:
                return percent
        return None

    def tilt_now(self, now: float) -> float | None:
        """How far it leans [degrees] while it reports that."""
        return self.tilt_deg if now - self.tilt_s <= TILT_KEPT_S else None

    def round_trip_now(self, now: float) -> float | None:
        """Of TIMESYNC [s], while the vehicle answers."""
        return self.round_trip_s if now - self.answered_s <= ROUND_TRIP_KEPT_S else None

    def falls(self, now: float) -> bool:
        """The newest local position is new, and goes down faster than vehicles descend."""
        local = self.local
        if local is None or now - local.time_s > FRESH_S:
            return False
        return local.velocity_ned_mps[2] > FALLS_MPS

    def clocked(self, boot_ms: int, now: float) -> None:
        """Store the vehicle's clock; if it went back, drop what does not survive a restart."""
        boot_s = boot_ms * 1e-3
        if boot_s < self.boot_s - REBOOT_BACK_S:
            self.origin = self.local = self.global_ = None
            self.system_status_s = -math.inf
            self.estimate = EstimateHealth()
            self.parameters.clear()
            self.parameter_news = object()
            if now - self.restart_said_s >= RESTARTS_SAID_S:
                self.restart_said_s = now
                self.texts.add("the vehicle restarted")
        self.boot_s = boot_s
