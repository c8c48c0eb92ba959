"""The plan: everything the agents of one mission must agree on, as plain frozen data.

A mission file is turned into a plan once (`mission.compile.loader`); the plan's hash is compared by
every agent and station, so no two of them can fly different missions. What may differ from agent to
agent (endpoints, keys) is the fleet's.

Lengths in `LawParameters`, `starts` and `slots` are the paper's units; multiply by `unit_m` for
metres. Horizontal vectors are (north, east) in the common frame: the local tangent plane at
`origin`.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal, TypeAlias

Point = tuple[float, float]

_SLOW_LAG_S = 0.7
_CALM_RATE = 2.0


@dataclass(frozen=True, slots=True)
class Geodetic:
    """A point on the WGS-84 ellipsoid: degrees, degrees, metres above mean sea level."""

    lat_deg: float
    lon_deg: float
    alt_m: float


@dataclass(frozen=True, slots=True)
class LawParameters:
    """docs/pages/law.md#symbols, in units; defaults are Table I and the hexagon of section VI."""

    r: float = 4.5
    r_out: float = 1.5
    r_in: float = 0.5
    h: float = 0.005
    delta_l: float = 2.0
    delta_a: float = 0.1
    own: str = ""
    """NAME@DIGEST of an own law (`core/law/laws.py`); '': the paper's."""


@dataclass(frozen=True, slots=True)
class Response:
    """How a vehicle answers a velocity setpoint: dead time, then a first-order lag, with bounded
    acceleration."""

    dead_time_s: float = 0.4
    lag_s: float = 0.5
    acceleration_mps2: float = 2.8
    doubt_s: float = 0.5
    """Dead time and lag together may differ by this from the vehicle's own; `swarm-ctl measure`
    finds less."""

    @property
    def most_rate(self) -> float:
        """The most that kappa * h may be [1/s]. At 3 and more, four simulated PX4s that hold swing
        with setpoints from limit to limit, as a real one did for a minute; formations form as fast
        with 2, because the speed limit decides."""
        return _CALM_RATE if self.lag_s > _SLOW_LAG_S else math.inf


@dataclass(frozen=True, slots=True)
class Limits:
    """What an agent asks of its vehicle never exceeds these, but in a take-off."""

    speed_mps: float = 5.0
    """By the vehicle's position: the setpoint on the wire is less by the drift of the vehicle's
    velocity, so it may be more by `DRIFT_MAX_MPS` (`core/control/navigation.py`)."""
    climb_mps: float = 1.0
    descent_mps: float = 1.0


class Compensation(StrEnum):
    """The points that the law works on."""

    STOP_POINT = "stop_point"
    """Where the vehicle would come to rest if told to stop now (the default of flown missions)."""
    NONE = "none"
    """The positions: the paper's plain form."""


@dataclass(frozen=True, slots=True)
class Safety:
    """What stands between the law and the vehicles (`core/safety/constraints.py`,
    `core/safety/deadlock.py`, `core/law/mean_error_feedback.py`)."""

    filter: bool = True
    """No setpoint that brings two vehicles closer than their keep-out distance."""
    guard: bool = True
    """Neighbour links that the shape keeps are not stretched past r on the way."""
    release: bool = True
    """Out of dead-locks by going round each other."""
    align: bool = True
    """Mean-error feedback: against slow modes, each agent also moves to where all agents that it
    hears place its slot on the average."""


class Policy(StrEnum):
    """What an agent does when something it relies on is lost."""

    CONTINUE = "continue"
    HOLD = "hold"
    LAND = "land"
    """Hold for `hold_before_land_s`, then land in place."""
    RETURN = "return"
    """All at once, in layers of height, back to the own start; land in place where that is not
    possible."""


@dataclass(frozen=True, slots=True)
class Policies:
    """What an agent does about each loss or excess, and when it counts as one [mission s]."""

    agent_lost: Policy = Policy.LAND
    agent_lost_after_s: float = 5.0
    override_pause_s: float = 120.0
    """For so long at most, a command to some agents alone holds the mission up for the others; then
    those agents have left (`left_by_order`)."""
    left_by_order: Policy = Policy.CONTINUE
    """What the others do when an operator lands, calls back or kills some agents alone. `hold`
    lasts until the operator commands `resume`."""
    station_lost: Policy = Policy.LAND
    station_lost_after_s: float = 5.0
    hold_before_land_s: float = 3.0
    fence: Policy = Policy.LAND
    """Outside `Plan.fence`, or about to be: the stop point counts."""
    battery_low: Policy = Policy.LAND
    battery_reserve_percent: float = 20.0
    too_fast: Policy = Policy.LAND
    """Faster than `max_speed_mps`, or leaning more than `max_tilt_deg`: the vehicle no longer does
    what it is told."""
    max_speed_mps: float = 10.0
    max_tilt_deg: float = 60.0
    """A PX4 leans up to 45 degrees after a large step of its setpoint (MPC_TILTMAX_AIR), and a
    little beyond: 48 was seen."""
    wind: Policy = Policy.LAND
    """Stronger wind than `wind_limit_mps`, where the vehicle estimates it; where not, the tilt
    limit stands in."""
    wind_limit_mps: float = 12.0
    estimate: Policy = Policy.HOLD
    """In the air, when the vehicle says for `timeouts.ESTIMATE_DOUBT_S` that its own estimate is
    faulty, or less accurate than `position_accuracy_flight_m`."""
    position_accuracy_m: float = 1.0
    """With a less accurate position (one standard deviation) no vehicle takes off."""
    position_accuracy_flight_m: float = 2.0
    return_separation_m: float = 3.0
    """Between the heights of two agents that return."""
    return_speed_mps: float = 2.5


@dataclass(frozen=True, slots=True)
class Fence:
    """Where the vehicles may be: inside `polygon_m` ((north, east), in order; empty: anywhere), up
    to `height_m`."""

    polygon_m: tuple[Point, ...]
    height_m: float


@dataclass(frozen=True, slots=True)
class TakeoffStep:
    """Set the mode, arm, climb to `height_m` above the vehicle's own take-off point."""

    height_m: float
    timeout_s: float
    on_timeout: Policy = Policy.LAND
    kind: Literal["takeoff"] = "takeoff"


@dataclass(frozen=True, slots=True)
class FormStep:
    """Fly the law until the largest |e_i - mean e| stays under `tolerance_m` for `settle_s`.

    `slots` has one (north, east) offset in units per agent, in the order of `Plan.agents`.
    """

    shape: str
    slots: tuple[Point, ...]
    tolerance_m: float
    settle_s: float
    timeout_s: float
    neighbours: tuple[tuple[int, ...], ...] | None = None
    """N_i from this step on, in the order of `Plan.agents`; None: as before."""
    on_timeout: Policy = Policy.LAND
    exchange: bool = False
    """Agents that are in each other's way may take each other's slots
    (`core/swarm/exchange_protocol.py`)."""
    kind: Literal["form"] = "form"


@dataclass(frozen=True, slots=True)
class HoldStep:
    """Keep the last formation for `duration_s`."""

    duration_s: float
    timeout_s: float
    on_timeout: Policy = Policy.LAND
    kind: Literal["hold"] = "hold"


@dataclass(frozen=True, slots=True)
class MoveStep:
    """Take the formation's centre along `waypoints_m` (common frame) at `speed_mps`, keeping
    shape."""

    waypoints_m: tuple[Point, ...]
    speed_mps: float
    tolerance_m: float
    settle_s: float
    timeout_s: float
    on_timeout: Policy = Policy.LAND
    kind: Literal["move"] = "move"


@dataclass(frozen=True, slots=True)
class RotateStep:
    """Turn the formation about its centre to `angle_rad` from its last form step's slots (clockwise
    from above).

    `speed_mps` is the outermost slot's.
    """

    angle_rad: float
    speed_mps: float
    tolerance_m: float
    settle_s: float
    timeout_s: float
    on_timeout: Policy = Policy.LAND
    kind: Literal["rotate"] = "rotate"


@dataclass(frozen=True, slots=True)
class ScaleStep:
    """Widen or narrow the formation to `factor` times its last form step's slots; `speed_mps` is
    the outermost's."""

    factor: float
    speed_mps: float
    tolerance_m: float
    settle_s: float
    timeout_s: float
    on_timeout: Policy = Policy.LAND
    kind: Literal["scale"] = "scale"


@dataclass(frozen=True, slots=True)
class ReturnStep:
    """All at once, in layers of height, back to the own start; land there, disarm."""

    timeout_s: float
    on_timeout: Policy = Policy.LAND
    kind: Literal["return"] = "return"


@dataclass(frozen=True, slots=True)
class LandStep:
    """Stop, land in place, disarm."""

    timeout_s: float
    on_timeout: Policy = Policy.LAND
    kind: Literal["land"] = "land"


Step: TypeAlias = (
    TakeoffStep | FormStep | HoldStep | MoveStep | RotateStep | ScaleStep | ReturnStep | LandStep
)
"""`kind` names a step on screens, in results and in a plan's JSON. `on_timeout` is done when a step
takes too long; with `continue` all agents go on to the next step, as their time is over, too."""

Shaped: TypeAlias = FormStep | HoldStep | MoveStep | RotateStep | ScaleStep
"""The steps that fly a formation."""


@dataclass(frozen=True, slots=True)
class AgentPlan:
    """One agent's part of the plan: id (1..65535), planned start (north, east) in units, neighbours
    N_i by id."""

    id: int
    start: Point
    neighbours: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Plan:
    """A whole mission, checked. `agents` is sorted by id; `prepare_timeout_s` bounds the wait for a
    healthy vehicle."""

    name: str
    origin: Geodetic
    unit_m: float
    tick_s: float
    kappa: float
    law: LawParameters
    compensation: Compensation
    response: Response
    limits: Limits
    policies: Policies
    prepare_timeout_s: float
    agents: tuple[AgentPlan, ...]
    steps: tuple[Step, ...]
    fence: Fence | None
    safety: Safety

    def agent(self, agent_id: int) -> AgentPlan:
        """The part of `agent_id`; KeyError where the plan has no such agent."""
        for agent in self.agents:
            if agent.id == agent_id:
                return agent
        raise KeyError(agent_id)

    def hash(self) -> int:
        """A 64-bit fingerprint of the whole plan, the same on every machine (floats rounded to
        1e-9)."""
        return int(fingerprint_of(self), 16)

    def fingerprint(self) -> str:
        """The hash as 16 hexadecimal digits, for people and files."""
        return f"{self.hash():016x}"


def fingerprint_of(value: Any) -> str:
    """16 hexadecimal digits of plain frozen data, the same on every machine (floats rounded to
    1e-9)."""
    text = json.dumps(_canonical(value), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _canonical(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: _canonical(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {"": type(value).__name__} | fields
    if isinstance(value, tuple | list):
        return [_canonical(item) for item in value]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return round(float(value), 9)  # 3 and 3.0 are one plan, however it was built
    return value
