"""The plan: everything the agents of one mission must agree on, as plain frozen data.

A mission file is turned into a plan once (`mission.compile.loader`); the plan's hash is compared by
every agent and station, so no two of them can fly different missions. What may differ from agent to
agent (endpoints, keys) is the fleet's.

Lengths in `LawParameters`, `starts` and `slots` are the paper's units; multiply by `unit_m` for
metres. Horizontal vectors are (north, east) in the common frame: the local tangent plane at
`origin`.

Fields that a mission file gives have their bounds here, and the words that describe them in the
file's schema (`mission/sections/section.py`).
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import itertools
import json
import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Annotated, Any, Final, NamedTuple

from annotated_types import Ge, Le

from swarm_ctl.core.model.geometry import Point as Point
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.policies import DERIVED
from swarm_ctl.core.model.policies import Policies as Policies
from swarm_ctl.core.model.policies import Policy as Policy
from swarm_ctl.core.model.steps.table import AnyStep
from swarm_ctl.core.model.targets import TargetPlan
from swarm_ctl.core.model.timeouts import FRESH_S
from swarm_ctl.core.model.zones import Zone as Zone

EVERYONE: Final = "all"
"""The name of the group of a mission that has no other."""
HEIGHT_DOUBT_M: Final = 0.5
"""What a vehicle's own estimate of its height is off by, at least: simulated ones stay under 0.2 m,
and a baro drifts with the weather."""
MOST_UP_M: Final = 120.0
"""From the flight height to a slot, up or down."""
_NEWER: Final = frozenset(
    {"wake", "ups_m", "targets", "before", "flies_m", "formed", "waits", "closed", "named"}
)
"""Fields that count in a plan's hash only where they say something: a plan that says nothing of
heights, targets, groups and agents that wait is the one that it was before there were any."""
_SLOW_LAG_S = 0.7
_CALM_RATE = 2.0


@dataclass(frozen=True, slots=True)
class Geodetic:
    """A point on the WGS-84 ellipsoid: degrees, degrees, metres above mean sea level."""

    lat_deg: Annotated[float, Ge(-89), Le(89)]
    """Nearer to a pole, no autopilot knows where east is."""
    lon_deg: Annotated[float, Ge(-180), Le(180)]
    alt_m: Annotated[float, Ge(-500), Le(9000)]
    """Metres above mean sea level."""


@dataclass(frozen=True, slots=True)
class Between:
    """The bounds of an own law's number, and what it means."""

    least: float
    most: float
    about: str = ""


@dataclass(frozen=True, slots=True)
class LawParameter:
    """A number of an own law, within the bounds that the law gives it."""

    name: str
    value: float
    least: float
    most: float


@dataclass(frozen=True, slots=True)
class LawParameters:
    """docs/understand/law.md#symbols, in units; defaults: Table I, the hexagon of section VI."""

    r: float = 4.5
    r_out: float = 1.5
    r_in: float = 0.5
    h: float = 0.005
    delta_l: float = 2.0
    delta_a: float = 0.1
    own: str = ""
    """NAME@DIGEST of an own law (`law_loader.py`); '': the paper's."""
    parameters: tuple[LawParameter, ...] = ()
    """Of the own law, in its order."""


@dataclass(frozen=True, slots=True)
class Response:
    """How a vehicle answers a velocity setpoint: dead time, then a first-order lag, with bounded
    acceleration."""

    dead_time_s: Annotated[float, Ge(0), Le(2)] = 0.4
    """Until the vehicle begins to react."""
    lag_s: Annotated[float, Ge(0.01), Le(5)] = 0.5
    """Time constant of the velocity."""
    acceleration_mps2: Annotated[float, Ge(0.1), Le(20)] = 2.8
    """The most that the vehicle accelerates or brakes."""
    doubt_s: Annotated[float, Ge(0.05), Le(1)] = 0.5
    """Dead time and lag together may differ from the vehicle's own by this. An agent keeps the
    distance and the speed that it asks for until its flight has told better."""

    @property
    def most_rate(self) -> float:
        """The most that kappa * h may be [1/s]. At 3 and more, four simulated PX4s that hold swing
        with setpoints from limit to limit, as a real one did for a minute; formations form as fast
        with 2, because the speed limit decides."""
        return _CALM_RATE if self.lag_s > _SLOW_LAG_S else math.inf


@dataclass(frozen=True, slots=True)
class Limits:
    """What an agent asks of its vehicle never exceeds these, but in a take-off."""

    # What the setpoint may be more is `DRIFT_MAX_MPS` (`core/control/navigation.py`).
    speed_mps: Annotated[float, Ge(0.1), Le(20)] = 5.0
    """Horizontal, by the vehicle's position. Where the velocity that the vehicle estimates is off
    by a drift, the setpoint on the wire is less by that drift: it may be up to 1 m/s more than
    this, and the vehicle's position does not move faster. Default: 5, less where
    law.r_out - law.r_in leaves less room to brake."""
    climb_mps: Annotated[float, Ge(0.1), Le(5)] = 1.0
    """After the take-off. A take-off climbs as the autopilot does: an ArduCopter flies its own, a
    PX4 is told 1.5 m/s at most (MPC_TKO_SPEED as delivered)."""
    descent_mps: Annotated[float, Ge(0.1), Le(3)] = 1.0


@dataclass(frozen=True, slots=True)
class Wake:
    """What the air below a vehicle asks of the others, in a mission whose slots have heights."""

    layer_m: Annotated[float, DERIVED, Ge(0.5), Le(50)]
    """Two vehicles that are closer than `law.r_in` have to differ in height by this much. Default:
    by `rotor_distance_m`, where one vehicle's wake costs the one below 1.6 times its power."""
    rotor_distance_m: Annotated[float, Ge(0.03), Le(5)] = 0.32
    """From the middle of one rotor to that of the next one beside it."""
    mass_kg: Annotated[float, Ge(0.02), Le(100)] = 1.5
    """Of a vehicle as it takes off. It decides how fast the wake is, which `validate` tells."""


class Compensation(StrEnum):
    """The points that the law works on."""

    STOP_POINT = "stop_point"
    """Where the vehicle would come to rest if told to stop now (the default of flown missions)."""
    NONE = "none"
    """The positions: the paper's plain form."""


@dataclass(frozen=True, slots=True)
class Safety:
    """What stands between the law and the vehicles (`core/kernel/constraints.py`,
    `core/kernel/wish.py`)."""

    filter: Annotated[bool, DERIVED] = True
    """Correct each velocity that would bring two vehicles closer than their keep-out distance."""
    guard: Annotated[bool, DERIVED] = True
    """Keep neighbour links shorter than r on the way, if the shape keeps them so."""
    release: Annotated[bool, DERIVED] = True
    """Resolve dead-locks: blocked agents go round each other."""
    align: Annotated[bool, DERIVED] = True
    """Form faster (mean error feedback): each agent also moves to where its slot lies by the mean
    of all agents that it hears, not only by its neighbours."""


@dataclass(frozen=True, slots=True)
class Fence:
    """Where the vehicles may be: inside `polygon_m` ((north, east), in order; empty: anywhere), up
    to `height_m`."""

    polygon_m: tuple[Point, ...]
    height_m: float


@dataclass(frozen=True, slots=True)
class AgentPlan:
    """One agent's part of the plan: id (1..65535), planned start (north, east) in units, neighbours
    N_i by id."""

    id: int
    start: Point
    neighbours: tuple[int, ...]
    waits: bool = False
    """It stays on the ground until an order `launch`; its places stay free as long."""


@dataclass(frozen=True, slots=True)
class ShapePlan:
    """A shape of the mission with a slot for each agent: (north, east) offsets in units, not yet
    dealt to them."""

    name: str
    slots: tuple[Point, ...]
    ups_m: tuple[float, ...] = ()
    """As `FormStep.ups_m`."""


@dataclass(frozen=True, slots=True)
class GroupPlan:
    """Agents, sorted by id, and the steps that they fly together: with a barrier, a shape, a frame,
    a graph and roles of their own. Slots and neighbours in its steps are in the order of `agents`.

    Where the swarm splits and joins, a group ends and others begin; the steps of each agent count
    on from one to the next (`core/model/route.py`).
    """

    name: str
    agents: tuple[AgentPlan, ...]
    """With the places where they are planned to be as its steps begin."""
    steps: tuple[AnyStep, ...]
    before: int = 0
    """How many steps its agents have flown before its first."""
    flies_m: float = 0.0
    """The flight height as its steps begin; 0: they stand on the ground."""
    ups_m: tuple[float, ...] = ()
    """How far above it each of them is then; (): all are at it."""
    formed: bool = False
    """They stand in a shape then."""

    @property
    def ids(self) -> tuple[int, ...]:
        """Of its agents."""
        return tuple(agent.id for agent in self.agents)

    @property
    def members(self) -> frozenset[int]:
        """Its agents, by id."""
        return frozenset(agent.id for agent in self.agents)

    @property
    def last(self) -> int:
        """The number of its last step."""
        return self.before + len(self.steps)

    @property
    def numbers(self) -> range:
        """Of its steps."""
        return range(self.before + 1, self.last + 1)

    @property
    def told_steps(self) -> range:
        """The numbers of its steps, and of the preparation before its first."""
        return self.numbers if self.before else range(self.last + 1)

    def step(self, number: int) -> AnyStep | None:
        """The step of this number; None: it has none."""
        return self.steps[number - self.before - 1] if number in self.numbers else None

    def step_name(self, number: int) -> str:
        """`prepare` for 0, then the mission file's own words (`form hexagon`); `?` where it has no
        such step."""
        step = self.step(number)
        return "prepare" if number == 0 else step.title if step is not None else "?"

    def waits_on(self, number: int) -> bool:
        """It joins in the step of this number as it did in the one before: it has fewer steps than
        the other groups."""
        step, before = self.step(number), self.step(number - 1)
        return step is not None and step.joins and before is not None and before.joins

    def formations(self, unit_m: float) -> list[PlannedFormation]:
        """Where the formation is planned to stand before the first step (index 0), and after its
        k-th step (index k, from 1)."""
        places = [agent.start for agent in self.agents]
        start = PlannedFormation.at_start(places, unit_m, self.flies_m, self.ups_m)
        start = replace(start, formed=self.formed)
        accumulated = itertools.accumulate(
            self.steps, lambda formation, step: step.after(formation), initial=start
        )
        return list(accumulated)


@dataclass(frozen=True, slots=True)
class NamedAgents:
    """Agents that an operator calls by one name."""

    name: str
    ids: tuple[int, ...]


class PlannedStep(NamedTuple):
    """One step of a flight: whose it is, and between which formations."""

    plan: Plan
    group: GroupPlan
    number: int
    """Of its agents, from 1."""
    step: AnyStep
    before: PlannedFormation
    after: PlannedFormation

    @property
    def name(self) -> str:
        """`form hexagon`."""
        return self.step.title

    @property
    def waits_on(self) -> bool:
        """As `GroupPlan.waits_on`."""
        return self.group.waits_on(self.number)


@dataclass(frozen=True)  # no slots: it keeps its hash
class Plan:
    """A whole mission, checked. `shapes`, by name, are those that may be ordered in flight;
    `prepare_timeout_s` bounds the wait for a healthy vehicle.

    Steps belong to a group. Who means one agent's asks `group_of`; who means all of the flight asks
    `groups` or `all_steps`.
    """

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
    groups: tuple[GroupPlan, ...]
    """By their first steps; each agent is in one of them at a time."""
    shapes: tuple[ShapePlan, ...]
    fence: Fence | None
    safety: Safety
    zones: tuple[Zone, ...]
    wake: Wake | None = None
    """None: all slots are at the flight height, and all vehicles count as in one plane."""
    targets: tuple[TargetPlan, ...] = ()
    """That may be followed, by name."""
    named: tuple[NamedAgents, ...] = ()
    """The mission's groups, for orders, whether they fly steps of their own or not."""

    @property
    def layer_m(self) -> float:
        """`Wake.layer_m`; infinite where all slots are at one height."""
        return math.inf if self.wake is None else self.wake.layer_m

    @property
    def slot_layer_m(self) -> float:
        """Agents at slots that differ in height by this much are apart by height, also by words
        that are just fresh (`core/kernel/heights.py`)."""
        return slot_layer_m(self.layer_m, self.limits)

    @property
    def agents(self) -> tuple[AgentPlan, ...]:
        """All, sorted by id, with the starts of their vehicles."""
        if len(self.groups) == 1:
            return self.groups[0].agents
        found = (agent for group in self.groups if not group.before for agent in group.agents)
        return tuple(sorted(found, key=lambda agent: agent.id))

    def agent(self, agent_id: int) -> AgentPlan:
        """The part of `agent_id`; KeyError where the plan has no such agent."""
        for agent in self.agents:
            if agent.id == agent_id:
                return agent
        raise KeyError(agent_id)

    def group_of(self, agent_id: int, step: int = 0) -> GroupPlan:
        """The group that `agent_id` flies in, in its step of this number; KeyError where the plan
        has no such agent, or no such step of it."""
        for group in self.groups:
            if (step in group.numbers or step == group.before == 0) and agent_id in group.ids:
                return group
        raise KeyError(agent_id)

    @property
    def last_step(self) -> int:
        """The number of the last step."""
        return max(group.last for group in self.groups)

    def steps_of(self, agent_id: int) -> list[AnyStep]:
        """All that `agent_id` flies, in whatever group."""
        return [step for group in self.groups if agent_id in group.ids for step in group.steps]

    def all_steps(self) -> list[PlannedStep]:
        """Those of all groups, group by group."""
        return [
            PlannedStep(self, group, number, step, before, after)
            for group in self.groups
            for number, step, (before, after) in zip(
                group.numbers,
                group.steps,
                itertools.pairwise(group.formations(self.unit_m)),
                strict=True,
            )
        ]

    def hash(self) -> int:
        """A 64-bit fingerprint of the whole plan, the same on every machine (floats rounded to
        1e-9)."""
        return self._hash

    @functools.cached_property  # 2 ms, and all agents of a flight on the virtual clock ask
    def _hash(self) -> int:
        return int(fingerprint_of(self), 16)

    def fingerprint(self) -> str:
        """The hash as 16 hexadecimal digits, for people and files."""
        return f"{self.hash():016x}"


def slot_layer_m(layer_m: float, limits: Limits) -> float:
    """`Plan.slot_layer_m`."""
    return layer_m + 2.0 * HEIGHT_DOUBT_M + (limits.climb_mps + limits.descent_mps) * FRESH_S


def fingerprint_of(value: Any) -> str:
    """16 hexadecimal digits of plain frozen data, the same on every machine (floats rounded to
    1e-9)."""
    text = json.dumps(_canonical(value), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _canonical(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        told = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        fields = {k: _canonical(v) for k, v in told.items() if v or k not in _NEWER}
        return {"": type(value).__name__} | fields
    if isinstance(value, tuple | list):
        return [_canonical(item) for item in value]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return round(float(value), 9)  # 3 and 3.0 are one plan, however it was built
    return value
