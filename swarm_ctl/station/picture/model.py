"""Folds mesh messages into one immutable view. Knows no clock, no mesh and no screen."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from swarm_ctl.core.control.target import Targets
from swarm_ctl.core.law.formation import apart_in_height, centred, distances, errors
from swarm_ctl.core.law.graph import edges
from swarm_ctl.core.model.causes import FailsafeAction
from swarm_ctl.core.model.geometry import centred as centred_slots
from swarm_ctl.core.model.geometry import turned
from swarm_ctl.core.model.messages import (
    Ack,
    AgentState,
    AgentStatus,
    Command,
    CommandKind,
    Event,
    PairReport,
    Payload,
    Phase,
    SigmaReport,
    StationBeacon,
    TargetWord,
)
from swarm_ctl.core.model.plan import GroupPlan, Plan, Point, Policy
from swarm_ctl.core.model.planned_formation import Frame
from swarm_ctl.core.model.route import Routes
from swarm_ctl.core.model.steps.follow import FollowStep
from swarm_ctl.core.model.targets import TargetNow
from swarm_ctl.core.model.timeouts import NEIGHBOUR_S
from swarm_ctl.core.swarm.in_plan import InPlan
from swarm_ctl.core.swarm.plausibility import SUSPECT_S
from swarm_ctl.station.picture.answered import CommandLog
from swarm_ctl.station.picture.history import HistoryKeeper
from swarm_ctl.station.picture.link_stats import Receiver
from swarm_ctl.station.picture.view import (
    AgentView,
    EdgeView,
    FollowView,
    GroupView,
    LinkView,
    PairView,
    SwarmView,
    TargetView,
    newest,
)

_EVENTS: Final = 1000
"""Half as many as the log has entries: one view leaves room for what stood there."""
_STRANGERS: Final = 32
"""Agents that are not in the plan, and stations: of more than these nothing is shown."""
_STAYS: Final = (None, FailsafeAction.HOLD)
_SIGMA_S: Final = 1.0
"""A sigma report older than this is history: they come at 5 Hz while a pair is active."""


@dataclass(slots=True)
class _Heard:
    """What came from one agent."""

    state: AgentState | None = None
    status: AgentStatus | None = None
    sigma: SigmaReport | None = None
    sigma_received_s: float = 0.0
    last_s: float | None = None
    """When anything came."""
    law_since_s: float = -math.inf
    """When its state first told of the law it flies now."""
    doubt: tuple[str, float] | None = None
    """Why a word of it was not believed, and when that came."""
    receiver: Receiver = field(default_factory=Receiver)

    def silence(self, now_s: float) -> float | None:
        return None if self.last_s is None else max(0.0, now_s - self.last_s)

    def active_sigma(self, now_s: float) -> SigmaReport | None:
        """The newest sigma report, while a pair is in the avoidance region."""
        return self.sigma if now_s - self.sigma_received_s <= _SIGMA_S else None

    @property
    def newest_step(self) -> int | None:
        """The furthest that it told of."""
        return max((told.step for told in (self.state, self.status) if told), default=None)

    @property
    def progress(self) -> tuple[int, bool]:
        """The furthest (step, done) that it told of; (-1, False): it was never heard."""
        told = ((each.step, each.done) for each in (self.state, self.status) if each)
        return max(told, default=(-1, False))

    @property
    def done_s(self) -> float | None:
        """When it was done with its step; None: it is not, or has not told yet when."""
        status, (step, done) = self.status, self.progress
        if status is None or not done or status.step != step or not status.steps:
            return None
        return status.steps[-1].end_s

    @property
    def in_formation(self) -> bool:
        """In its place or on its way there: off the ground by its vehicle's word too, and neither
        taking off nor going down, by the mission or without it."""
        state, status = self.state, self.status
        if state is None or not state.airborne or state.phase not in (Phase.FLY, Phase.HOLD):
            return False
        if state.left is CommandKind.GOTO:
            return False
        return status is None or (status.airborne and status.action in _STAYS)

    def lost(self, now_s: float, after_s: float) -> bool:
        told, silence = newest(self.state, self.status), self.silence(now_s)
        ended = told is not None and told.phase is Phase.ENDED
        return silence is not None and not ended and silence > after_s


class _Apart:
    """Horizontal distances [m] between the agents ever heard."""

    def __init__(self, starts: Mapping[int, Point], down_m: list[float], layer_m: float) -> None:
        self._at = {agent: k for k, agent in enumerate(starts)}
        ids = list(starts)
        self._between = distances(list(starts.values())) if len(starts) > 1 else np.zeros((0, 0))
        others = self._between + np.diag(np.full(len(self._between), np.inf))
        if len(others) and math.isfinite(layer_m):
            others[apart_in_height(down_m, layer_m)] = np.inf
        nearest = others.argmin(axis=1).tolist() if len(others) else []
        self.nearest = {
            i: (float(others[k, j]), ids[j])
            for k, (i, j) in enumerate(zip(ids, nearest, strict=False))
            if others[k, j] < np.inf
        }
        """(metres, the other's id), of those that are not in another layer."""

    def of(self, a: int, b: int) -> float:
        """Of two agents of whom states were heard."""
        return float(self._between[self._at[a], self._at[b]])


@dataclass(frozen=True, slots=True)
class _Moment:
    """What all agents' views at one time are made from."""

    now_s: float
    lost: set[int]
    groups: list[tuple[int, GroupPlan]]
    """Those that an agent is in, each with the furthest step of its agents."""
    apart: _Apart
    formation: set[int]
    """The agents that fly in it and are heard."""
    away_m: dict[int, float]
    """|e_i - mean e| of each agent of the formation."""
    targets_m: dict[int, Point]
    """Each agent's slot, laid under the formation."""
    centres: list[Point | None]
    """Of each group's formation; None: it has none yet."""
    follows: list[tuple[FollowStep, float] | None]
    """What each group follows, and since when."""


class Model:
    """The station's memory. `fold` takes every payload that arrives, `view` gives the picture at a
    moment."""

    def __init__(
        self, plan: Plan, *, speedup: float = 1.0, since_s: float = 0.0, station: str = ""
    ) -> None:
        self._plan = plan
        self._station = station
        self._plan_hash = plan.hash()
        self._speedup = speedup
        self._since_s = since_s
        self._in_plan, self._routes = InPlan(plan), Routes(plan)
        self._planned = frozenset(agent.id for agent in plan.agents)
        self._heard = {agent.id: _Heard() for agent in plan.agents}
        self._events: deque[Event] = deque(maxlen=_EVENTS)
        self._told: deque[Event] = deque(maxlen=_EVENTS)
        """As they came; `_events` have times of this station's clock."""
        self._event_count = 0
        self._commands = CommandLog(speedup)
        self._stations: dict[str, float] = {}
        self._targets = Targets(plan, own_id=0)
        """Believed as an agent believes them that hears the same words."""
        self._tellers: dict[str, str] = {}
        """Whose word of each target was believed last."""
        self._history = HistoryKeeper(self._heard)

    def states(self, now_s: float) -> tuple[AgentState, ...]:
        """The newest ones, of the plan's agents that are heard at `now_s`."""
        return tuple(
            heard.state
            for agent, heard in self._heard.items()
            if agent in self._planned
            and heard.state is not None
            and (heard.silence(now_s) or 0.0) <= NEIGHBOUR_S
        )

    def fold(self, payload: Payload, received_s: float) -> None:
        """Take one message in, as it arrived at `received_s`. Late and repeated ones change nothing
        but counters."""
        if not self._has_room(payload):
            return
        payload = self._in_plan.in_own_terms(payload)
        unknown = self._in_plan.unknown(payload)
        if unknown:
            self._doubt(payload, unknown, received_s)
            return
        match payload:
            case AgentState():
                heard = self._of(payload.agent, received_s)
                if heard.receiver.hear(payload.seq, payload.time_s, received_s):
                    if heard.state is not None and heard.state.gains_tag != payload.gains_tag:
                        heard.law_since_s = received_s
                    if heard.state is not None and payload.time_s <= heard.state.time_s:
                        heard.status = heard.sigma = None  # of the process before this one
                    heard.state = payload
                    self._history.state(payload)
                    self._commands.state(payload, received_s)
            case AgentStatus():
                heard = self._of(payload.agent, received_s)
                if heard.status is None or payload.time_s >= heard.status.time_s:
                    heard.status = payload
                    self._history.status(payload)
                    self._time_echo(payload, received_s)
            case SigmaReport():
                heard = self._of(payload.agent, received_s)
                if heard.sigma is None or payload.time_s >= heard.sigma.time_s:
                    heard.sigma, heard.sigma_received_s = payload, received_s
                    self._history.sigma(payload)
            case Event():
                self._tell(payload, self._said_s(payload, received_s))
            case Command():
                meant = payload.agents or tuple(self._planned)
                states = [self._heard[i].state for i in meant if i in self._heard]
                self._commands.hear(payload, received_s, [state for state in states if state])
            case Ack():
                self._commands.ack(payload)
            case TargetWord():
                self._sight(payload, received_s)
            case StationBeacon():
                self._stations[payload.station] = received_s
                if len(self._stations) > _STRANGERS:
                    del self._stations[min(self._stations, key=self._stations.__getitem__)]

    def _doubt(self, payload: Payload, words: str, received_s: float) -> None:
        """It names what the plan has not: it is in no view, and its sender is named."""
        agent = getattr(payload, "agent", None)
        if agent in self._heard:
            self._heard[agent].last_s = received_s
            self._heard[agent].doubt = (words, received_s)

    def _has_room(self, payload: Payload) -> bool:
        """Whether the speaker is known, or its table has a place for it."""
        if isinstance(payload, (AgentState, AgentStatus, SigmaReport, Event, Ack)):
            known = payload.agent in self._heard
            return known or len(self._heard) < len(self._planned) + _STRANGERS
        return True

    def recall(self, payload: Event | Command | Ack) -> None:
        """Take in what was said before this station listened, at the time that it tells."""
        if isinstance(payload, Event):
            if self._has_room(payload) and not self._in_plan.unknown(payload):
                self._tell(payload, payload.time_s)
            return
        self.fold(payload, payload.time_s if isinstance(payload, Command) else self._since_s)

    def _tell(self, event: Event, time_s: float) -> None:
        """Keep it with the time at which it was said, once."""
        if event not in self._told:
            self._told.append(event)
            self._events.append(replace(event, time_s=time_s))
            self._event_count += 1

    def _said_s(self, event: Event, received_s: float) -> float:
        """When it was said, by this station's clock: while the agent's is not known, and can't be
        this one, it was when it came."""
        heard = self._heard.get(event.agent)
        ahead_s = heard.receiver.ahead(received_s) if heard is not None else None
        if ahead_s is not None:
            return event.time_s - ahead_s
        return event.time_s if abs(received_s - event.time_s) <= NEIGHBOUR_S else received_s

    def _time_echo(self, status: AgentStatus, received_s: float) -> None:
        """A beacon of ours that came back tells the round trip, both loops' waiting included."""
        echo = status.echo
        if echo is not None and echo.station == self._station:
            heard = self._heard[status.agent]
            heard.receiver.answered(
                echo.beacon_s, status.time_s - echo.held_s, status.time_s, received_s
            )
            trip = received_s - echo.beacon_s - echo.held_s
            if trip >= 0.0:
                self._history.round_trip(status.agent, trip)

    def view(self, now_s: float) -> SwarmView:
        """The swarm at `now_s`."""
        moment = self._moment(now_s)
        step, group = max(moment.groups, key=lambda flown: flown[0])
        stations = self._stations | ({self._station: now_s} if self._station else {})
        return SwarmView(
            time_s=now_s,
            since_s=self._since_s,
            plan=self._plan,
            plan_hash=self._plan_hash,
            speedup=self._speedup,
            agents=tuple(self._agent(agent_id, moment) for agent_id in sorted(self._heard)),
            pairs=self._pairs(now_s),
            links=self._links(),
            edges=self._edges(moment),
            group=group,
            step=step,
            error_m=max(moment.away_m.values(), default=None),
            events=tuple(self._events),
            event_count=self._event_count,
            commands=self._commands.views(now_s),
            stations=stations,
            groups=tuple(self._grouped(moment)),
            targets=tuple(self._seen(moment)),
            follows=tuple(self._followed(moment)),
            histories=self._history.view(),
            doubted={
                agent_id: heard.doubt[0]
                for agent_id, heard in self._heard.items()
                if heard.doubt is not None and now_s - heard.doubt[1] <= SUSPECT_S
            },
        )

    def _grouped(self, moment: _Moment) -> Iterator[GroupView]:
        states = ((i, heard.state) for i, heard in self._heard.items())
        left = {i for i, state in states if state is not None and state.left is not None}
        gone = left | moment.lost if self._plan.policies.agent_lost is Policy.CONTINUE else left
        for step, group in moment.groups:
            here = [i for i in group.ids if i not in left and self._is_in(i, group)]
            done = [i for i in here if i not in gone and self._heard[i].progress == (step, True)]
            told_s = [at_s for i in done if (at_s := self._heard[i].done_s) is not None]
            late = dict[int, int]()
            if done:
                awaited = self._routes.awaited(done[0], step).items()
                late = {i: k for i, k in awaited if self._heard[i].progress < (k, True)}
            waits = tuple(sorted(late.keys() - gone))
            yield GroupView(
                group,
                step,
                tuple(here),
                silent=tuple(i for i in here if i in moment.lost),
                error_m=max((moment.away_m[i] for i in here if i in moment.away_m), default=None),
                waits_for=waits,
                waits_s=max(0.0, moment.now_s - min(told_s)) if waits and told_s else None,
            )

    def _is_in(self, agent: int, group: GroupPlan) -> bool:
        """By its newest step; one that was never heard is where it begins."""
        step = self._heard[agent].newest_step
        return (step if step is not None else 0) in group.told_steps

    def _sight(self, word: TargetWord, received_s: float) -> None:
        before = self._targets.now(word.name, received_s)
        self._targets.hear(word, received_s)
        deque(self._targets.say(received_s, None, (), 0.0), maxlen=0)  # the agents log it
        known = self._targets.now(word.name, received_s)
        if known is not None and (before is None or known.age_s < before.age_s):
            self._tellers[word.name] = word.teller

    def _seen(self, moment: _Moment) -> Iterator[TargetView]:
        for target in self._plan.targets:
            known = self._targets.now(target.name, moment.now_s)
            if known is not None:
                yield TargetView(
                    target.name,
                    (known.at.real, known.at.imag),
                    known.age_s,
                    self._tellers[target.name],
                    fresh=known.fresh,
                    up_m=known.height_m,
                    off_m=self._off(target.name, known, moment),
                )

    def _off(self, name: str, known: TargetNow, moment: _Moment) -> float | None:
        """How far a formation's centre is from its place about this target; None: none follows it,
        or where it is now is not known."""
        for follows, centre in zip(moment.follows, moment.centres, strict=True):
            if follows is None or centre is None or not known.fresh:
                continue
            step, _ = follows
            if step.target == name:
                turn = known.course if step.in_course else 1.0
                return abs(complex(*centre) - known.at - complex(*step.offset_m) * turn)
        return None

    def _followed(self, moment: _Moment) -> Iterator[FollowView]:
        for (_, group), follows in zip(moment.groups, moment.follows, strict=True):
            agents = tuple(sorted(moment.formation.intersection(group.ids)))
            if follows is not None and agents:
                step, since_s = follows
                yield FollowView(step.target, agents, max(0.0, moment.now_s - since_s))

    def _follows(
        self, group: GroupPlan, k: int, formation: set[int], now_s: float
    ) -> tuple[FollowStep, float] | None:
        """The step of following that a group flies, by an order or by its mission, and since when:
        `now_s`, until a status tells."""
        flown = [self._heard[agent].state for agent in formation.intersection(group.ids)]
        tags = {state.override for state in flown if state is not None and state.override}
        if tags:
            given = [a for a in self._commands if a.command.tag in tags]
            order = given[-1].command.step if given else None
            follows = order.follows if order is not None else None
            return (follows, given[-1].received_s) if follows is not None else None
        planned = group.step(k)
        follows = planned.follows if planned is not None else None
        statuses = [self._heard[agent].status for agent in group.ids]
        told = [status.steps for status in statuses if status is not None and status.step == k]
        since_s = min((steps[-1].start_s for steps in told if steps), default=now_s)
        return (follows, since_s) if follows is not None else None

    def _moment(self, now_s: float) -> _Moment:
        after_s = self._plan.policies.agent_lost_after_s
        lost = {agent_id for agent_id, heard in self._heard.items() if heard.lost(now_s, after_s)}
        groups = self._flown()
        formation = {i for i, heard in self._heard.items() if heard.in_formation} - lost
        away_m, targets_m, centres = dict[int, float](), dict[int, Point](), list[Point | None]()
        follows = list[tuple[FollowStep, float] | None]()
        for step, group in groups:
            away, targets, centre = self._errors(group, step, formation)
            away_m |= away
            targets_m |= targets
            centres.append(centre)
            follows.append(self._follows(group, step, formation, now_s))
        return _Moment(
            now_s,
            lost,
            groups,
            apart=self._apart(),
            formation=formation,
            away_m=away_m,
            targets_m=targets_m,
            centres=centres,
            follows=follows,
        )

    def _flown(self) -> list[tuple[int, GroupPlan]]:
        """The groups that an agent is in now, each with the furthest step of its agents; where
        nothing was heard yet, those that begin."""
        found = list[tuple[int, GroupPlan]]()
        for group in self._plan.groups:
            heard = [self._heard[agent].newest_step for agent in group.ids]
            steps = [step for step in heard if step is not None and step in group.told_steps]
            if steps or (not group.before and all(step is None for step in heard)):
                found.append((max(steps, default=0), group))
        return found or [(0, group) for group in self._plan.groups if not group.before]

    def _edges(self, moment: _Moment) -> tuple[EdgeView, ...]:
        states = {i: heard.state for i, heard in self._heard.items() if heard.state}
        return tuple(
            EdgeView(a, b, moment.apart.of(a, b) if {a, b} <= moment.formation else None)
            for step, group in moment.groups
            for a, b in edges_in_force(group, step, states)
        )

    def _links(self) -> tuple[LinkView, ...]:
        return tuple(
            LinkView(agent_id, sender, report)
            for agent_id, heard in sorted(self._heard.items())
            if heard.status
            for sender, report in sorted(heard.status.links.items())
        )

    def _of(self, agent_id: int, received_s: float) -> _Heard:
        heard = self._heard.get(agent_id)
        if heard is None:
            heard = self._heard[agent_id] = _Heard()
        heard.last_s = received_s
        return heard

    def _apart(self) -> _Apart:
        states = ((i, heard.state) for i, heard in self._heard.items())
        places = {i: state.position_ned_m for i, state in states if state}
        down_m = [down_m for _, _, down_m in places.values()]
        return _Apart({i: at[:2] for i, at in places.items()}, down_m, self._plan.layer_m)

    def _errors(
        self, group: GroupPlan, step: int, formation: set[int]
    ) -> tuple[dict[int, float], dict[int, Point], Point | None]:
        """|e_i - mean e| [m] of each agent that flies in a group's formation, in the shape of the
        newest `form` step; where each slot lies with their mean error taken out; and where the
        shape's centre is. Empty, and None, before the first one."""
        shape = self._shape(group, step)
        if shape is None:
            return {}, {}, None
        slots, points = {}, {}
        in_roles = not self._overridden(group)  # an operator's shape gives each its own slot
        for k, agent in enumerate(group.agents):
            state = self._heard[agent.id].state
            if state is None:
                continue
            slot = shape[state.exchange.role if in_roles and state.exchange.role in shape else k]
            slot = (self._closed_slot(group, step, agent.id) if in_roles else None) or slot
            frame = state.frame or Frame((0.0, 0.0))
            place = turned(slot, frame.angle_rad, frame.scale)
            slots[agent.id] = (place[0] * self._plan.unit_m, place[1] * self._plan.unit_m)
            if agent.id in formation:
                points[agent.id] = state.position_ned_m[:2]
        if not points:
            return {}, {}, None
        away = errors(list(points.values()), [slots[i] for i in points])
        sizes = np.linalg.norm(centred(away), axis=-1)
        north, east = np.mean(away, axis=0).tolist()
        targets = {i: (slot[0] + north, slot[1] + east) for i, slot in slots.items()}
        return dict(zip(points, sizes.tolist(), strict=True)), targets, (north, east)

    def _shape(self, group: GroupPlan, step: int) -> dict[int, Point] | None:
        """The newest slots, centred: an operator's since the mission's step began, or the
        mission's; None: none yet."""
        forms = [(group.before, tuple(a.start for a in group.agents))] if group.formed else []
        forms += [
            (k, form.slots)
            for k, s in zip(group.numbers, group.steps, strict=True)
            if k <= step and (form := s.new_shape) is not None
        ]
        for answered in self._commands:
            order = answered.command.step
            commanded = order.new_shape if order is not None else None
            resumed = bool(forms) and forms[-1][0] == step and not self._overridden(group)
            meant = answered.command.agents
            if (
                commanded is not None
                and (not meant or group.members.issubset(meant))
                and len(commanded.slots) == len(group.agents)  # else all agents refuse it
                and answered.at_step >= (forms[-1][0] if forms else 0)
                and not resumed
            ):
                forms.append((answered.at_step, commanded.slots))
        return dict(enumerate(centred_slots(forms[-1][1]))) if forms else None

    def _closed_slot(self, group: GroupPlan, step: int, agent: int) -> Point | None:
        """An agent's slot, centred, in the newest shape where that has closed a gap; None: it has
        not."""
        status = self._heard[agent].status
        if status is None or not status.closings:
            return None
        flown = zip(group.numbers, group.steps, strict=True)
        forms = [(k, form) for k, s in flown if k <= step and (form := s.new_shape) is not None]
        (since_s, fewer, place), (k, form) = status.closings[-1], forms[-1] if forms else (0, None)
        begun_s = status.steps[k].start_s if k < len(status.steps) else math.inf
        if form is None or since_s < begun_s or not 0 < fewer <= len(form.closed):
            return None
        slots = centred_slots(form.closed[fewer - 1])
        return slots[place] if 0 <= place < len(slots) else None

    def _overridden(self, group: GroupPlan) -> bool:
        states = [self._heard[agent].state for agent in group.ids]
        flying = [state for state in states if state is not None and state.left is None]
        return any(state.override for state in flying)

    def _agent(self, agent_id: int, moment: _Moment) -> AgentView:
        heard, now_s = self._heard[agent_id], moment.now_s
        near = moment.apart.nearest.get(agent_id)
        return AgentView(
            id=agent_id,
            in_plan=agent_id in self._planned,
            state=heard.state,
            status=heard.status,
            law_since_s=heard.law_since_s,
            link=heard.receiver.report(now_s),
            silence_s=heard.silence(now_s),
            lost=agent_id in moment.lost,
            error_m=moment.away_m.get(agent_id),
            nearest_agent=near[1] if near else None,
            nearest_m=near[0] if near else None,
            target_m=moment.targets_m.get(agent_id),
            round_trip_s=self._history.least_round_trip_s(agent_id),
            sigma=heard.active_sigma(now_s),
        )

    def _pairs(self, now_s: float) -> tuple[PairView, ...]:
        sides: dict[tuple[int, int], list[tuple[int, PairReport]]] = {}
        for agent_id, heard in sorted(self._heard.items()):
            sigma = heard.active_sigma(now_s)
            if sigma is not None:
                for report in sigma.pairs:
                    pair = (min(agent_id, report.peer), max(agent_id, report.peer))
                    sides.setdefault(pair, []).append((agent_id, report))
        found = (
            PairView(
                a, b, self._plan.unit_m * min(report.distance for _, report in both), tuple(both)
            )
            for (a, b), both in sides.items()
        )
        return tuple(sorted(found, key=lambda pair: pair.distance_m))


def edges_in_force(
    group: GroupPlan, step: int, states: Mapping[int, AgentState]
) -> tuple[tuple[int, int], ...]:
    """The pairs of neighbours in this step of a group, lower id first: the starts' graph, or the
    newest that a form step chose. That one is by slot, so it follows exchanged slots."""
    ids = group.ids
    forms = [
        form
        for s in group.steps[: max(0, step - group.before)]
        if (form := s.new_shape) is not None
    ]
    chosen = [form.neighbours for form in forms if form.neighbours is not None]
    if not chosen:
        return edges({agent.id: agent.neighbours for agent in group.agents})
    holders = {}
    for index, agent in enumerate(ids):
        role = states[agent].exchange.role if agent in states else index
        holders[ids[role if 0 <= role < len(ids) else index]] = agent
    by_slot = edges(dict(zip(ids, chosen[-1], strict=True)))
    pairs = ((holders.get(a, a), holders.get(b, b)) for a, b in by_slot)
    return tuple(sorted({(min(p), max(p)) for p in pairs if p[0] != p[1]}))
