"""What agents and stations tell each other, as plain data. `mesh/payloads.py` makes bytes of it.

Times are on the sender's mission clock [s]; horizontal vectors are (north, east) in the common
frame, in metres.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import Final, NamedTuple, TypeAlias

from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.plan import Point
from swarm_ctl.core.model.planned_formation import Frame
from swarm_ctl.core.model.rows import row
from swarm_ctl.core.model.steps.follow import FollowStep
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.goto import GotoStep
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.vehicle import OwnParameters, Vector3
from swarm_ctl.core.model.zones import Zone


class Phase(IntEnum):
    """Where an agent is in its flight. The numbers are on the wire, so never reuse one."""

    CONNECT = 0
    """No heartbeat from the vehicle yet."""
    PREPARE = 1
    """The vehicle is heard; waiting until it is healthy, or for the peers."""
    ARM = 2
    TAKEOFF = 3
    FLY = 4
    """Under the law: steps that form, hold, move, rotate or scale, and commands that do."""
    HOLD = 5
    """Stopped in the air by a failsafe; avoidance stays on."""
    LAND = 6
    YIELD = 7
    """A pilot has taken the vehicle; this agent sends nothing."""
    ENDED = 8
    RETURN = 9
    """On the way back to its own start; `AgentState.stage` says how far."""


class Severity(StrEnum):
    """How much an event or an alarm matters."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class Outcome(StrEnum):
    """How an agent's flight, or a whole run, ended."""

    RUNNING = "running"
    COMPLETED = "completed"
    ABORTED = "aborted"
    """An operator's command or the end of `run` broke it off."""
    FAILED = "failed"


class StepOutcome(StrEnum):
    """How one step of the mission ended."""

    RUNNING = "running"
    DONE = "done"
    SKIPPED = "skipped"
    """The operator's `next` ended it."""
    TIMEOUT = "timeout"
    ABORTED = "aborted"


class CommandKind(StrEnum):
    """What an operator can command. `Command.kind` holds one of these, or an unknown word."""

    HOLD = "hold"
    RESUME = "resume"
    NEXT = "next"
    FORM = "form"
    MOVE = "move"
    FOLLOW = "follow"
    GOTO = "goto"
    """Fly to a place apart from the others, and stay there until `resume`."""
    LAUNCH = "launch"
    """Take off, of an agent that waits on the ground, and join the others."""
    TUNE = "tune"
    """First phase of a gain update: prepare these gains."""
    ZONE = "zone"
    """First phase of such an update that changes zones, not gains."""
    LAND = "land"
    RETURN = "return"
    KILL = "kill"
    EXPEL = "expel"
    """Listen no more to the agents that it is about, and keep clear of their vehicles."""
    READMIT = "readmit"
    """Undoes `expel`."""
    APPLY = "apply"
    """Second phase of a gain update, sent by stations: the gains that `tune` prepared hold."""


ENDING: Final = (CommandKind.LAND, CommandKind.RETURN, CommandKind.KILL)
"""The commands that end an agent's part of the mission."""
LEAVING: Final = (*ENDING, CommandKind.GOTO)
"""Those by which an agent leaves the formation; of the last it may come back."""
ABOUT: Final = (CommandKind.EXPEL, CommandKind.READMIT)
"""Commands to all agents about some of them."""


class ReturnStage(IntEnum):
    """How far the way back is (`core/agent/return_to_launch.py`)."""

    CLIMB = 0
    WAIT = 1
    """It makes room for a peer with a lower id, or hears no peer."""
    FLY = 2
    DOWN = 3


@dataclass(frozen=True, slots=True)
class ExchangeState:
    """What an agent says of slot exchange (`core/kernel/exchange.py`). Agents by their
    place in the plan; -1: none."""

    role: int
    """The place in the plan whose slots it flies to."""
    version: int = 0
    """Of the role: exchanges so far."""
    lock: int = -1
    """The agent that offers in the exchange that this agent takes part in."""
    offer_to: int = -1
    offer_version: int = -1
    """The other agent's version when it was offered."""
    answer_to: int = -1
    """The agent whose offer it took last."""
    answer_version: int = -1
    answer_role: int = -1
    """The role that the other agent has from now on."""

    def beyond(self, agents: int) -> int | None:
        """A place that it names and a plan of so many agents has not; None: there is none."""
        if (
            -1 <= self.role < agents
            and -1 <= self.lock < agents
            and -1 <= self.offer_to < agents
            and -1 <= self.answer_to < agents
            and -1 <= self.answer_role < agents
        ):
            return None
        named = (self.role, self.lock, self.offer_to, self.answer_to, self.answer_role)
        return next(place for place in named if not -1 <= place < agents)


NO_EXCHANGE = ExchangeState(role=-1)
"""Says nothing: its role is its own place."""


@row
class AgentState:
    """Sent every tick: kinematics and progress. A fixed binary layout (`mesh/payloads.py`)."""

    agent: int
    seq: int
    time_s: float
    plan_hash: int
    phase: Phase
    step: int
    """0 is preparation, k >= 1 is `steps[k - 1]` of the agent's group."""
    done: bool
    airborne: bool
    position_ned_m: Vector3
    velocity_ned_mps: Vector3
    stop_point_m: Point
    setpoint_mps: Point
    frame: Frame | None = None
    """The shared reference as this agent has it; the pinned agent's is the one that counts
    (`core/control/reference.py`)."""
    stage: int = 0
    """`ReturnStage` of the way back."""
    override: int = 0
    """`Command.tag` of the command that this agent flies instead of the mission's step; 0: none.
    Agents follow only peers with the same override."""
    gains_tag: int = 0
    """`Command.tag` of the gain update in force (`core/swarm/gain_update.py`); 0: the mission's
    own gains."""
    next_gains_tag: int = 0
    """The gain update that is decided and waits for its time; 0: none."""
    exchange: ExchangeState = NO_EXCHANGE
    response_s: float = 0.0
    """From a setpoint to the flown velocity: dead time and lag, as estimated in flight
    (`core/kernel/response.py`)."""
    doubt_s: float = 0.0
    """By how much that may be off."""
    left: CommandKind | None = None
    """The order (one of `LEAVING`) by which the agent has left the formation: an operator gave it
    to some agents alone."""
    down: bool = False
    """Its flight is over, or it waits to be launched: its vehicle stands on the ground,
    disarmed."""
    goal_height_m: float | None = None
    """The height above the common frame's origin that its vehicle flies to; None: the mission's
    slots have no heights."""


@row
class PairReport:
    """One pair in the avoidance region, as agent i sees it (docs/understand/law.md#sigma).
    Lengths in units."""

    peer: int
    neighbour: bool
    status: str
    """`paper`, `narrow`, `inactive` or `overspeed`."""
    distance: float
    sigma: float
    sigma_lb: float
    d_lb: float
    d_ub: float
    d: float | None
    alpha: float


@row
class SigmaReport:
    """Sent at 5 Hz while a pair is in the avoidance region, and once after."""

    agent: int
    time_s: float
    consensus: Point
    avoidance: Point
    pairs: tuple[PairReport, ...]


class Glimpse(NamedTuple):
    """What a state or a clock word says at first sight, unchecked."""

    agent: int
    time_s: float
    at_m: Point | None = None
    """(north, east); None: it is a clock word."""


@dataclass(frozen=True, slots=True)
class StepResult:
    """How a step went for one agent, from `start_s` to `end_s` (None: still running)."""

    name: str
    result: StepOutcome
    start_s: float
    end_s: float | None


@row
class LinkReport:
    """One mesh link as its receiver sees it, over the whole run so far."""

    age_s: float | None
    """Now; None: never heard, or expelled."""
    age_p50_s: float | None
    age_p99_s: float | None
    received: int
    lost: int
    clock_ahead_s: float | None = None
    """The sender's clock less the receiver's, within half a round trip; None: not known."""
    round_trip_s: float | None = None
    """The fastest recent way there and back."""


@dataclass(frozen=True, slots=True)
class TickReport:
    """The control loop's punctuality so far. Lateness and work in wall-clock milliseconds."""

    count: int = 0
    overruns: int = 0
    """Ticks skipped because the one before took too long."""
    late_p50_ms: float = 0.0
    late_p99_ms: float = 0.0
    late_max_ms: float = 0.0
    work_p50_ms: float = 0.0
    work_p99_ms: float = 0.0


@dataclass(frozen=True, slots=True)
class SafetyReport:
    """What the safety filter has done so far (`core/safety/safety_filter.py`), in ticks."""

    ticks: int = 0
    """The filter ran."""
    touched: int = 0
    """The filter changed the wish."""
    yielded: int = 0
    """The keep-outs excluded each other, and all gave way a little."""
    releases: int = 0
    """Dead-lock releases begun."""
    kept_from: tuple[int, ...] = ()
    """The aircraft it was kept apart from since the status before; 0: one without an agent."""


@dataclass(frozen=True, slots=True)
class VehicleLinkReport:
    """The MAVLink link between an agent and its vehicle, over the whole run so far."""

    received: int
    lost: int
    """By MAVLink's 8-bit seq: right where only the vehicle speaks on the link."""
    round_trip_s: float | None
    """TIMESYNC to the vehicle and back, the newest; mission time."""
    signed: bool = False
    """MAVLink 2 signing is on."""
    refused: str = ""
    """The frames that the link has refused of late, in words; ''."""
    refusals: dict[str, int] = field(default_factory=dict)
    """All of them, by reason."""
    unsafe: str = ""
    """The vehicle's failsafe parameters that another has changed in flight, of late, or ''."""


class RefusalReason(StrEnum):
    """Why a mesh message was not taken."""

    OTHER_OWNER = "other owner"
    """It speaks for another than the owner of the key that it came under."""
    TOO_LARGE = "too large"
    UNREADABLE = "unreadable"
    TOO_MANY = "too many"
    LINK = "link"
    """No message: a link to the mesh did not open."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """Mesh messages of one owner of keys that were refused for one reason."""

    owner: str
    """`agent 7`, `station station-77-a1b2c3`; `others`: of more owners than are kept apart. Of a
    link: why."""
    reason: RefusalReason
    words: str
    """The newest one: `a state under agent 7's key says agent 3`."""
    count: int
    """Over the whole run."""
    time_s: float
    """Of the newest one."""


@dataclass(frozen=True, slots=True)
class Echo:
    """A station's newest beacon sent back, which gives the station the round trip."""

    station: str
    beacon_s: float
    """`StationBeacon.time_s`."""
    held_s: float
    """From its receipt to this status."""


@dataclass(frozen=True, slots=True)
class Gains:
    """What of the law can be changed in flight (docs/understand/law.md#symbols)."""

    delta_a: float
    delta_l: float
    h: float
    kappa: float
    """Iterations a second."""
    own: tuple[tuple[str, float], ...] = ()
    """(name, value) of each number of an own law, in its order."""


@dataclass(frozen=True, slots=True)
class Tuning:
    """New gains, and the mission time from which they hold, on the sender's clock."""

    gains: Gains
    at_s: float
    ahead_s: tuple[tuple[int, float], ...] = ()
    """(agent, how far its clock is ahead of the sender's), where they differ."""
    zones: tuple[Zone, ...] | None = None
    """All zones that hold from then on; None: the plan's."""


@dataclass(frozen=True, slots=True)
class Departure:
    """By which order, and when [s], an agent has left the formation (`AgentState.left`)."""

    order: CommandKind
    time_s: float


@dataclass(frozen=True, slots=True)
class AgentStatus:
    """Sent at 2 Hz: everything about an agent that is not needed every tick."""

    agent: int
    time_s: float
    phase: Phase
    step: int
    done: bool
    reason: str
    """Why it waits, holds, lands or failed; '' when all is well."""
    outcome: Outcome
    mode: str
    armed: bool
    airborne: bool
    battery_percent: float | None
    height_m: float | None
    formation_error_m: float | None
    """Largest |e_j - mean e| over the agents that it hears, itself included."""
    nearest_agent: int | None
    nearest_m: float | None
    """Horizontal distance between positions."""
    heartbeat_age_s: float | None
    station_age_s: float | None
    setpoints: int
    setpoint_rate_hz: float
    neighbours: tuple[int, ...]
    """N_i now: without lost agents."""
    sigma_tally: dict[str, int]
    """Pair-ticks by status."""
    overspeed_ticks: int
    links: dict[int, LinkReport]
    """By peer id, of near peers (`core/swarm/hearing.py`)."""
    steps: tuple[StepResult, ...]
    tick: TickReport = field(default_factory=TickReport)
    bad_payloads: int = 0
    vehicle_link: VehicleLinkReport | None = None
    echo: Echo | None = None
    gains: Gains | None = None
    """The law in force."""
    zones: tuple[Zone, ...] | None = None
    """The zones in force; None: the plan's."""
    position_accuracy_m: float | None = None
    """Of its horizontal position, one standard deviation by the vehicle's own word."""
    roles: tuple[tuple[float, int], ...] = ()
    """(since [s], place in the plan whose slots it flies to), for every role but its first."""
    closings: tuple[tuple[float, int, int], ...] = ()
    """(since [s], how many places fewer its shape has, which of those is its own), for each time
    that the shape closed a gap; of none fewer, -1, when it was whole again."""
    safety: SafetyReport = field(default_factory=SafetyReport)
    own: OwnParameters | None = None
    """The vehicle's own values of the parameters that we change; None until they are known."""
    action: FailsafeAction | None = None
    """What it does instead of the mission; None: it flies the mission, or a command."""
    cause: Cause | None = None
    """Of the action."""
    left: Departure | None = None
    """None: the agent is part of the formation, or all agents were given the order."""
    without: tuple[int, ...] = ()
    """The peers that have left the formation, as they told."""
    refused: tuple[Refusal, ...] = ()
    """What it refused on the mesh in the last seconds (`mesh/gate.py`)."""
    doubted: dict[int, str] = field(default_factory=dict)
    """Why, by peer of which a word was not believed of late (`core/swarm/plausibility.py`)."""
    far_heard: int = 0
    """So many far peers are heard."""


@row
class ClockEcho:
    """A peer's word of its clock, given back (`core/swarm/clocks.py`)."""

    agent: int
    """The peer."""
    told_s: float
    """Its `ClockNews.time_s`."""
    held_s: float
    """From its receipt to this word [s]."""


class Answers(IntEnum):
    """Which answers an agent wants to its clock words. The numbers are on the mesh."""

    REGULAR = 0
    """Once a second: a peer has another clock than its own."""
    SOON = 1
    """It hears a peer whose clock it does not know."""
    NONE = 2
    """All peers are on its own clock; it speaks because a peer wants answers."""


@row
class ClockNews:
    """Sent at 1 Hz, at 5 Hz while a peer asks: what the own clock shows. Binary."""

    agent: int
    time_s: float
    wants: Answers
    echoes: tuple[ClockEcho, ...]


@dataclass(frozen=True, slots=True)
class LawNews:
    """Law and zones that were changed in flight, told while a peer flies others: one that was
    restarted or away takes them up (`core/swarm/gain_update.py`)."""

    agent: int
    tag: int
    """As in its states, `AgentState.gains_tag`."""
    for_s: float
    """So long they have been in force, by its clock."""
    gains: Gains
    zones: tuple[Zone, ...] | None = None
    """All of them; None: the plan's."""


@dataclass(frozen=True, slots=True)
class TargetWord:
    """Where a target is, told by whoever hears it: an agent, or `swarm-ctl target`."""

    name: str
    latitude_deg: float
    longitude_deg: float
    age_s: float
    """How old the position was when this was sent."""
    altitude_m: float | None = None
    """Above mean sea level; None: not known."""
    velocity_ned_mps: Vector3 | None = None
    """None: not known."""
    accuracy_m: float = 5.0
    """Of the position, one standard deviation."""
    agent: int = 0
    """Who tells it; 0: no agent."""
    station: str = ""
    """What brings it from a receiver; '': an agent tells it."""
    on_ground: bool = False
    """It flies, and stands on the ground now."""

    @property
    def teller(self) -> str:
        """`agent 3`."""
        return self.station or f"agent {self.agent}"


@dataclass(frozen=True, slots=True)
class Event:
    """Something worth a line in the log."""

    agent: int
    time_s: float
    level: Severity
    text: str


@dataclass(frozen=True, slots=True)
class Command:
    """An operator's order to agents. An `id` that was seen before is acknowledged again, and not
    carried out again."""

    id: str
    kind: str
    """A `CommandKind`. Agents refuse any other word by name, so it is kept as it came."""
    agents: tuple[int, ...]
    """The agents that are meant; empty: all."""
    time_s: float
    step: FormStep | MoveStep | FollowStep | GotoStep | None = None
    """What `form`, `move`, `follow` and `goto` want, made by the sender, so that all agents have
    the same."""
    plan_hash: int = 0
    """The plan that `step` was made for; 0: any."""
    at_step: int = 0
    """The mission step that `next` ends; 0: the current one. An agent past it does nothing."""
    tuning: Tuning | None = None
    """The gain update that `tune` asks to prepare and `apply` decides."""
    commits: int = 0
    """The `tag` of the `tune` that `apply` decides."""
    station: str = ""
    """Its sender: the owner of the key that it came under, as its receiver puts in."""
    number: int = 0
    """Of its sender's commands: rises from 1."""
    ahead_s: tuple[tuple[int, float], ...] = ()
    """(agent, how far its clock is ahead of the sender's), where they differ by seconds."""
    about: tuple[int, ...] = ()
    """The agents that `expel` and `readmit` speak of, to all others."""

    @property
    def tag(self) -> int:
        """A 32-bit fingerprint of the id, never 0."""
        return zlib.crc32(self.id.encode()) or 1


@dataclass(frozen=True, slots=True)
class Ack:
    """An agent's answer to a command; `reason` says why it was refused."""

    agent: int
    command: str
    accepted: bool
    reason: str


@dataclass(frozen=True, slots=True)
class StationBeacon:
    """Sent at 4 Hz by every ground station."""

    station: str
    time_s: float
    plan_hash: int


Payload: TypeAlias = (
    AgentState
    | AgentStatus
    | ClockNews
    | LawNews
    | TargetWord
    | SigmaReport
    | Event
    | Command
    | Ack
    | StationBeacon
)
