"""The swarm at one moment, as a ground station knows it: immutable values that screens, logs and
alarms read.

Made by `model.Model` from mesh messages and nothing else. Times are mission seconds of the station;
lengths are metres unless a name says units; positions are in the common frame.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Final

from swarm_ctl.core.model.messages import (
    Ack,
    AgentState,
    AgentStatus,
    Command,
    Event,
    LinkReport,
    PairReport,
    Phase,
    Refusal,
    SigmaReport,
)
from swarm_ctl.core.model.plan import GroupPlan, Plan, Point
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.errors import UnknownAgentError
from swarm_ctl.station.picture.history import Histories
from swarm_ctl.station.picture.protection import LOCAL, Protection, protection_words

_STATION_S: Final = 2.0
"""A station that was not heard for eight of its beacons has left."""


def newest(state: AgentState | None, status: AgentStatus | None) -> AgentState | AgentStatus | None:
    """The younger of the two by the sender's clock; None where there is neither."""
    if state is None or status is None:
        return state or status
    return state if state.time_s >= status.time_s else status


@dataclass(frozen=True, slots=True)
class Reception:
    """How one agent's states arrive at this station. Percentiles and losses over the last
    `WINDOW_S`, mission time."""

    age_s: float | None = None
    """Since the newest state was true; None: never heard."""
    age_p50_s: float | None = None
    """Age that a state reached before the next one came, weighted by the time it took."""
    age_p99_s: float | None = None
    received: int = 0
    """Over the whole run."""
    lost: int = 0
    """Missing by `seq`, over the whole run."""
    late: int = 0
    """Came after a newer one, or twice; over the whole run."""
    restarts: int = 0
    """How often `seq` began anew."""
    recent_loss: float = 0.0
    """Share (0..1) lost in the window."""
    tick_rate_hz: float | None = None
    """The sender's ticks per mission second, by its own `seq` and clock; None: not yet known."""
    clock_ahead_s: float | None = None
    """The sender's clock less this station's, 0 where they may be one; None: not known."""


@dataclass(frozen=True, slots=True)
class AgentView:
    """One agent: its newest messages, and what the station makes of them."""

    id: int
    in_plan: bool
    state: AgentState | None
    status: AgentStatus | None
    link: Reception
    """Of its states; an agent sends none without a fresh position from its vehicle."""
    silence_s: float | None
    """Since anything was heard from it; None: never heard."""
    lost: bool
    """Silent for the plan's `agent_lost_after_s`, and it had not ended."""
    error_m: float | None
    """Its own |e_i - mean e| among the live agents, from the first `form` step on."""
    nearest_agent: int | None
    nearest_m: float | None
    """Horizontal, to the nearest agent ever heard, at their last known positions."""
    target_m: Point | None = None
    """Its slot (north, east) of the newest `form` step, laid under the live agents as they are."""
    sigma: SigmaReport | None = None
    """Its newest one, while a pair is in the avoidance region."""
    round_trip_s: float | None = None
    """A beacon of this station to the agent and back, without the time it lay there; None: not
    measured."""
    law_since_s: float = -math.inf
    """When this station saw its law change last."""

    @property
    def newest(self) -> AgentState | AgentStatus | None:
        """The younger of state and status: both tell phase, step, done, airborne."""
        return newest(self.state, self.status)

    @property
    def phase(self) -> Phase | None:
        """None: never heard."""
        return self.newest.phase if self.newest else None

    @property
    def airborne(self) -> bool:
        """By its newest message."""
        return self.newest is not None and self.newest.airborne

    @property
    def off_ground(self) -> bool:
        """In the air, by its vehicle's word too: it is armed before it lifts off."""
        return self.airborne and (self.status is None or self.status.airborne)

    @property
    def live(self) -> bool:
        """In the air and heard."""
        return self.airborne and not self.lost


@dataclass(frozen=True, slots=True)
class PairView:
    """A pair in the avoidance region, as one or both of its agents reported it."""

    a: int
    b: int
    distance_m: float
    """Between the points the law was fed with; the smaller report."""
    sides: tuple[tuple[int, PairReport], ...]
    """(agent, its report), lower id first."""


@dataclass(frozen=True, slots=True)
class LinkView:
    """One mesh link between agents, as its receiver reports it."""

    receiver: int
    sender: int
    report: LinkReport


@dataclass(frozen=True, slots=True)
class EdgeView:
    """One neighbour pair (a < b) of the graph in force, and how long it is now; None while either
    is not in the formation."""

    a: int
    b: int
    length_m: float | None


@dataclass(frozen=True, slots=True)
class CommandView:
    """A command seen on the mesh, and the answers of the agents."""

    command: Command
    received_s: float
    acks: Mapping[int, Ack]
    shown: frozenset[int] = frozenset()
    """The agents whose answer was not heard, and whose states say that they obey."""
    over: bool = False
    """Its sender repeats it no more: an answer that was not heard will not come."""


@dataclass(frozen=True, slots=True)
class StationHealth:
    """What this station itself has missed, over the whole run."""

    bad_payloads: int = 0
    frames_dropped: int = 0
    """Views that a slow terminal never showed."""
    refused: tuple[Refusal, ...] = ()
    """Messages that this station refused of late."""


@dataclass(frozen=True, slots=True)
class TargetView:
    """A target, as an agent knows it that hears what this station hears."""

    name: str
    at_m: Point
    """(north, east) now, by its motion; of one that is silent, where that led for a moment."""
    age_s: float
    """Of the newest word that was believed."""
    teller: str
    """Whose word that was."""
    fresh: bool = True
    """It was heard a moment ago: a formation flies after it."""
    up_m: float | None = None
    """Above the origin; None: not known."""
    off_m: float | None = None
    """How far the centre of the formation that follows it is from its place about it, in the plane;
    None: none follows it, or it is silent."""


@dataclass(frozen=True, slots=True)
class FollowView:
    """A formation that follows a target."""

    target: str
    agents: tuple[int, ...]
    """Those of the formation that are heard."""
    for_s: float
    """How long it has."""


@dataclass(frozen=True, slots=True)
class GroupView:
    """A group that flies now: an agent is in one of its steps."""

    plan: GroupPlan
    step: int
    """The furthest step of its agents; 0 is preparation."""
    agents: tuple[int, ...]
    """Those in its steps, but for those that have left the formation."""
    silent: tuple[int, ...]
    """Those of them that are lost."""
    error_m: float | None
    """Largest |e_i - mean e| of its live agents."""
    waits_for: tuple[int, ...] = ()
    """The agents that the others are done before: of its own, or of other groups; () while none of
    it is done."""
    waits_s: float | None = None
    """How long the first of them has waited; None: it does not, or has not told yet since when."""

    @property
    def name(self) -> str:
        """As orders have it behind `@`."""
        return self.plan.name

    @property
    def step_name(self) -> str:
        """Of its step."""
        return self.plan.step_name(self.step)


@dataclass(frozen=True, slots=True)
class SwarmView:
    """Everything a screen may show."""

    time_s: float
    since_s: float
    """When this station began to listen."""
    plan: Plan
    plan_hash: int
    speedup: float
    agents: tuple[AgentView, ...]
    """All of the plan's, heard or not, and any stranger; by id."""
    pairs: tuple[PairView, ...]
    """Nearest first."""
    links: tuple[LinkView, ...]
    edges: tuple[EdgeView, ...]
    group: GroupPlan
    """The one that is furthest; `step` is of it."""
    step: int
    """The furthest step any agent is in; 0 is preparation."""
    error_m: float | None
    """Largest |e_i - mean e| of the live agents."""
    events: tuple[Event, ...]
    """The last ones, oldest first."""
    event_count: int
    """How many there were in all."""
    commands: tuple[CommandView, ...]
    """The last ones, oldest first."""
    stations: Mapping[str, float]
    """When each station's beacon was last heard, this one included."""
    groups: tuple[GroupView, ...] = ()
    """Those that fly now, in the order of the plan."""
    targets: tuple[TargetView, ...] = ()
    """Those of which a word has come."""
    follows: tuple[FollowView, ...] = ()
    histories: Histories = field(default_factory=Histories)
    doubted: Mapping[int, str] = field(default_factory=dict)
    """Why, by agent of which this station did not believe a word of late."""
    health: StationHealth = field(default_factory=StationHealth)
    protection: Protection = LOCAL

    def step_name(self, agent: AgentView) -> str:
        """Of the step that this agent is in; '' where it was never heard."""
        if agent.newest is None:
            return ""
        if not agent.in_plan:
            return self.group.step_name(agent.newest.step)
        step = agent.newest.step
        return self.plan.group_of(agent.id, step).step_name(step)

    @property
    def protected(self) -> list[tuple[str, bool]]:
        """What keeps others off the swarm, in words (`protection_words`)."""
        planned = [agent for agent in self.agents if agent.in_plan]
        heard = [agent for agent in planned if agent.phase is not None and not agent.lost]
        links = [agent.status.vehicle_link for agent in heard if agent.status is not None]
        signed = sum(link is not None and link.signed for link in links)
        return protection_words(self.protection, len(heard), signed, len(planned))

    @property
    def stations_there(self) -> int:
        """How many stations there are now, this one included."""
        return sum(self.time_s - heard_s <= _STATION_S for heard_s in self.stations.values())

    @property
    def zones(self) -> tuple[Zone, ...]:
        """In force, by the newest word of an agent."""
        told = [agent.status for agent in self.agents if agent.status is not None]
        newest = max(told, key=lambda status: status.time_s, default=None)
        return self.plan.zones if newest is None or newest.zones is None else newest.zones

    @property
    def laws(self) -> dict[int, tuple[AgentView, ...]]:
        """The agents that fly each law, by its tag; the law of most agents first. Silent agents and
        agents whose flight is over or taken over don't count."""
        found: dict[int, list[AgentView]] = {}
        for agent in self.agents:
            if (
                agent.state is not None
                and not agent.lost
                and agent.phase not in (Phase.YIELD, Phase.ENDED)
            ):
                found.setdefault(agent.state.gains_tag, []).append(agent)
        most_first = sorted(found.items(), key=lambda item: -len(item[1]))
        return {tag: tuple(agents) for tag, agents in most_first}

    @property
    def left(self) -> frozenset[int]:
        """The agents that have left the formation by an operator's order. Of one that has ended and
        was never heard by this station, its peers tell."""
        told = {i for agent in self.agents if agent.status for i in agent.status.without}
        return frozenset(
            agent.id
            for agent in self.agents
            if (agent.state.left is not None if agent.state is not None else agent.id in told)
        )

    def group_now(self, agent_id: int) -> GroupView | None:
        """In which the agent is now; None: it has left, or is a stranger."""
        return next((group for group in self.groups if agent_id in group.agents), None)

    def step_of(self, ids: Collection[int]) -> int:
        """The furthest step of the groups that these agents fly in; of all, where there are
        none."""
        steps = (group.step for group in self.groups if not set(ids).isdisjoint(group.agents))
        return max(steps, default=self.step)

    def beside(self, ids: Collection[int]) -> tuple[int, ...]:
        """The agents of the groups that fly now, and that none of these belongs to, nor did before
        it left."""
        apart = (group.agents for group in self.groups if not {*group.plan.ids} & {*ids})
        return tuple(sorted(agent for agents in apart for agent in agents))

    def whom(self, ids: Collection[int]) -> str:
        """These agents in words, by the names of groups where they are all of one: `scouts, agents
        5-7`."""
        left, names = set(ids), list[str]()
        for group in self.groups if len(self.plan.groups) > 1 else ():
            if group.agents and left.issuperset(group.agents):
                names.append(group.name)
                left -= set(group.agents)
        return ", ".join([*names, *([agents_named(left)] if left or not names else [])])

    def agent(self, agent_id: int) -> AgentView:
        """The agent with that id; UnknownAgentError, a KeyError, where there is none."""
        for agent in self.agents:
            if agent.id == agent_id:
                return agent
        known = agents_named(agent.id for agent in self.agents)
        raise UnknownAgentError(f"agent {agent_id}: there is none; allowed: {known}")
