"""What an agent knows of its vehicle, and what it wants of it. Free of MAVLink: `mavlink/`
translates both ways.

All times are on the agent's clock. Vectors are (north, east, down).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, TypeAlias

from swarm_ctl.core.model.plan import Geodetic, Point
from swarm_ctl.core.model.rows import row


@dataclass(frozen=True, slots=True)
class VehicleIdentity:
    """Which vehicle this is. A simulated autopilot's `uid` may be that of its computer, so the
    system id belongs to it."""

    autopilot: str
    sysid: int
    uid: str = ""
    """AUTOPILOT_VERSION: uid2, else uid, in hexadecimal; '' where the vehicle has none."""


@dataclass(frozen=True, slots=True)
class OwnValue:
    """One parameter."""

    own: float
    """What the vehicle gets back."""
    ours: tuple[float, ...]
    """What agents have set, or were about to set, since the vehicle had its own value."""


@dataclass(frozen=True, slots=True)
class OwnParameters:
    """What an agent says of its vehicle's parameters, for those who remember it.

    An agent that dies leaves its own values on the vehicle. So the vehicle's are remembered outside
    the agent before any is changed, and forgotten only when the vehicle has confirmed them again.
    """

    vehicle: VehicleIdentity
    values: dict[str, OwnValue]
    given_back: bool = False
    """The vehicle has confirmed its own values, all of them, after the flight."""


@dataclass(frozen=True, slots=True)
class Remembered:
    """What an earlier flight left behind."""

    values: Mapping[str, OwnValue]
    flight: str
    """Which one, e.g. `20261122-0512-hexagon of 2026-11-22 05:12`."""


class Found(StrEnum):
    """What the first reading of a parameter tells."""

    OWN = "own"
    """The vehicle's own value."""
    OURS = "ours"
    """An agent's value that an earlier flight left; the own one is remembered."""
    CHANGED = "changed"
    """Neither: the value was changed since, and counts."""
    UNKNOWN = "unknown"
    """An agent's value, and nothing is remembered: the vehicle's own, or a leftover."""


@dataclass(frozen=True, slots=True)
class ParameterNote:
    """What the operator should know of parameters that were found so."""

    found: Found
    text: str


def own_value(found: float, ours: float, remembered: OwnValue | None) -> tuple[OwnValue, Found]:
    """Whose value was found, and which one the vehicle gets back.

    Args:
        found: as first read in this flight.
        ours: what this flight sets.
        remembered: by an earlier flight that has not given it back; None: nothing.
    """
    if remembered is None:
        return OwnValue(found, (ours,)), Found.UNKNOWN if found == ours else Found.OWN
    if found not in (remembered.own, *remembered.ours):
        return OwnValue(found, (ours,)), Found.CHANGED
    # Earlier values stay: this flight may end before it has set its own.
    values = tuple(dict.fromkeys((*remembered.ours, ours)))
    left = found != remembered.own
    return OwnValue(remembered.own, values), Found.OURS if left else Found.OWN


Vector3 = tuple[float, float, float]

OVER_M: Final = 3.0
"""A vehicle so much higher than one that stands on the ground flies over it: no approach. Agents
keep clear of one that is less far below, and the judge counts it."""
MISPLACED_M: Final = 3.0
"""A vehicle that comes down so far from where it was told has landed elsewhere: GPS wanders by less
during a landing. Agents and the judge say so alike."""
FALLS_MPS: Final = 4.0
"""A vehicle that goes down faster falls: 0.4 s after its motors stop. As delivered, ArduCopter and
PX4 descend at 1.5 m/s, and land at 1.5 m/s at most."""


@row
class LocalFix:
    """LOCAL_POSITION_NED: position [m] from the vehicle's *own* origin, velocity [m/s]."""

    time_s: float
    """When the fix arrived."""
    position_ned_m: Vector3
    velocity_ned_mps: Vector3
    boot_s: float = 0.0
    """The vehicle's own time of it."""


@row
class GlobalFix:
    """GLOBAL_POSITION_INT."""

    time_s: float
    position: Geodetic
    relative_alt_m: float
    """Height above home."""
    velocity_ned_mps: Vector3


@row
class Contact:
    """ADSB_VEHICLE: an aircraft near by, seen by the vehicle itself (the paper's proximity
    sensor)."""

    time_s: float
    address: int
    position: Geodetic
    velocity_ned_mps: Vector3


class LimitKind(StrEnum):
    """What a vehicle's own parameter limits."""

    SPEED = "flies"
    CLIMB = "climbs"
    DESCENT = "descends"
    ACCELERATION = "accelerates"


@dataclass(frozen=True, slots=True)
class FlightLimit:
    """How the vehicle limits itself, in m/s or m/s2, and the parameter that says so (name and
    value)."""

    kind: LimitKind
    allowed: float
    parameter: str


@row
class VehicleView:
    """A snapshot of everything heard from the vehicle so far. Times of -inf: never heard."""

    heartbeat_s: float = -math.inf
    """When the last HEARTBEAT arrived."""
    autopilot: str = ""
    """`ardupilot`, `px4`, or '' while unknown."""
    fault: str = ""
    """Why this vehicle cannot be flown at all (an unknown autopilot, a wrong type), or
    ''."""
    armed: bool = False
    mode: str = ""
    """The autopilot's own word for its mode, e.g. GUIDED. Like `armed`, it is what several
    heartbeats say."""
    mode_doubt: bool = False
    """The newest heartbeat says another mode, or other than `armed`; it is not believed yet."""
    controlled: bool = False
    """The mode follows our velocity setpoints."""
    controlled_mode: str = ""
    """That mode: GUIDED, OFFBOARD."""
    climbs_by_setpoints: bool = False
    """Its take-off is flown by our setpoints (a PX4's), not by the autopilot (an ArduCopter's)."""
    landing: bool = False
    """The mode is the autopilot's landing mode."""
    on_ground: bool = True
    """EXTENDED_SYS_STATE says on ground (true until heard otherwise)."""
    healthy: bool = False
    """Would arm now: pre-arm checks pass, position estimate good."""
    health_reason: str = "no heartbeat yet"
    """What is missing while not healthy."""
    released: bool = True
    """The vehicle has its own failsafe parameters (not taken yet, or given back and confirmed):
    Release is done."""
    unsafe: str = ""
    """The failsafe parameters that another has changed in flight, of late, or ''."""
    own: OwnParameters | None = None
    """Its own values of the parameters that we change; None until the vehicle is known, and for one
    that is not remembered: it ends with the run."""
    notes: tuple[ParameterNote, ...] = ()
    """What the operator should know of these parameters; each is in one snapshot only."""
    battery_percent: float | None = None
    tilt_deg: float | None = None
    """How far it leans (ATTITUDE: roll and pitch); None while unknown."""
    wind_mps: float | None = None
    """Horizontal wind by the vehicle's own estimate (WIND, WIND_COV); None where it has none, or
    none that is new."""
    position_accuracy_m: float | None = None
    """Of its horizontal position, one standard deviation by its own word (ESTIMATOR_STATUS,
    GPS_RAW_INT); None where it gives none."""
    estimate_fault: str = ""
    """What the vehicle says is wrong with its estimate (EKF_STATUS_REPORT, ESTIMATOR_STATUS,
    GPS_RAW_INT), its silence included; '' while nothing is."""
    estimates_wind: bool = False
    """Its parameters make it estimate the wind, in flight. As delivered neither firmware does."""
    limits: tuple[FlightLimit, ...] = ()
    """The vehicle's own limits, as far as they are read; several of one kind all hold."""
    unread_limits: tuple[str, ...] = ()
    """The parameters of the limits that are not."""
    origin: Geodetic | None = None
    """GPS_GLOBAL_ORIGIN: where the vehicle's own local frame has its zero."""
    local: LocalFix | None = None
    global_: GlobalFix | None = None
    contacts: tuple[Contact, ...] = ()
    """Newest contact per address."""
    texts: tuple[str, ...] = ()
    """STATUSTEXTs since the last snapshot, severity warning and worse."""
    frames: int = 0
    """Good frames of the vehicle since the link was opened."""
    frames_lost: int = 0
    """Missing by MAVLink's 8-bit seq."""
    signed: bool = False
    """The link is signed: no other frame counts."""
    refused: str = ""
    """The frames that it has refused of late, in words; ''."""
    refusals: Mapping[str, int] = field(default_factory=dict)
    """All of them, by reason."""
    round_trip_s: float | None = None
    """TIMESYNC there and back, the newest; at least a tick, since answers are read once a tick."""

    def doubt(self, accuracy_m: float) -> str:
        """What the vehicle says against its own estimate, with a position that may be off by
        `accuracy_m`, or ''."""
        found = self.position_accuracy_m
        if self.estimate_fault or found is None or found <= accuracy_m:
            return self.estimate_fault
        return f"position accuracy {found:.1f} m; allowed: at most {accuracy_m:.1f} m"


# --- goals: what the agent wants; reaching them (commands, order, retries) is the autopilot
# driver's work ---


@dataclass(frozen=True, slots=True)
class StandbyGoal:
    """Be heard, stream, take our failsafe parameters; stay disarmed on the ground."""


@dataclass(frozen=True, slots=True)
class AirborneGoal:
    """Armed and climbing to `height_m` above the take-off point."""

    height_m: float
    velocity_mps: Point = (0.0, 0.0)
    """(north, east), flown where `VehicleView.climbs_by_setpoints`."""


@row
class FlyGoal:
    """Under our control with this velocity setpoint [m/s], sent once a tick: silence is the
    deadman."""

    velocity_ned_mps: Vector3


@dataclass(frozen=True, slots=True)
class LandGoal:
    """Down in place and disarmed."""


@dataclass(frozen=True, slots=True)
class ReleaseGoal:
    """On the ground, disarmed: give the vehicle its own failsafe parameters back."""


@dataclass(frozen=True, slots=True)
class YieldGoal:
    """A pilot or a failsafe flies it: send nothing but our heartbeat, and to a PX4 setpoints of
    zero, without which its pilot could not give it back: it ignores them in all other modes. One
    that has landed in its landing mode and stays armed is disarmed."""


@dataclass(frozen=True, slots=True)
class TerminateGoal:
    """Motors off at once, wherever it is: it falls. Only by an operator's confirmed command."""


Goal: TypeAlias = (
    StandbyGoal | AirborneGoal | FlyGoal | LandGoal | ReleaseGoal | YieldGoal | TerminateGoal
)


@dataclass(frozen=True, slots=True)
class LinkCounters:
    """What a vehicle link counted since it was opened."""

    frames: int = 0
    bad_frames: int = 0
    setpoints: int = 0
    lost: int = 0
    """Frames missing by MAVLink's 8-bit seq."""
    foreign: int = 0
    """Good frames of other systems or components: not listened to."""
    rejected: int = 0
    """Good frames with a field that can't be true (NaN, out of range)."""
    errors: int = 0
    """Reads and writes that the operating system refused (no listener, a full buffer,
    ...)."""
    refused: int = 0
    """Frames that did not count on a signed link."""
