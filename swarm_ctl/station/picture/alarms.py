"""What an operator must be told: `RULES`, a table of alarms, each a pure function of the view, with
threshold and reason.

Nothing is remembered here: an alarm is raised when it appears in a view and cleared when it does
not any more. Thresholds are mission time and metres.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from swarm_ctl.core.model.causes import Cause
from swarm_ctl.core.model.messages import (
    AgentStatus,
    CommandKind,
    Gains,
    PairReport,
    Phase,
    Refusal,
    RefusalReason,
    Severity,
)
from swarm_ctl.core.model.text import agents_named, printable
from swarm_ctl.core.model.timeouts import NEIGHBOUR_S, OWN_LOST_S
from swarm_ctl.core.swarm.gain_update import differences
from swarm_ctl.station.picture.left_mission import (
    failed,
    fallen,
    follows,
    holding,
    is_out,
    out_by_order,
    taken_over,
)
from swarm_ctl.station.picture.view import AgentView, SwarmView


class Level(IntEnum):
    """How things stand, in order; an alarm is a warning or an error."""

    WELL = 0
    WAITING = 1
    """Nothing is wrong, and nothing goes on yet."""
    WARNING = 2
    """Look at it."""
    ERROR = 3
    """The mission, or safety, is at stake."""


LEVEL_OF: Final = {
    Severity.INFO: Level.WELL,
    Severity.WARNING: Level.WARNING,
    Severity.ERROR: Level.ERROR,
}
"""Of an agent's events."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """One alarm that stands. `(name, agents)` tells it from others."""

    name: str
    level: Level
    agents: tuple[int, ...]
    words: str
    """What is the matter with the agents, with today's figures."""
    reason: str
    """Why the threshold is what it is."""
    measured: bool = True
    """The words have a figure of each case; else words that are equal are one reason."""

    @property
    def key(self) -> tuple[str, tuple[int, ...]]:
        """What stays the same while the words change."""
        return self.name, self.agents

    @property
    def line(self) -> tuple[str, str]:
        """Alarms that have the same one are told in one line."""
        return self.name, "" if self.measured else self.words

    @property
    def text(self) -> str:
        """The whole sentence."""
        return f"{agents_named(self.agents)}: {self.words}"


Found = Iterator[tuple[tuple[int, ...], str]]
"""(agents, words) of each case."""
Check = Callable[[SwarmView, float], Found]
"""The cases in a view, for a threshold."""


@dataclass(frozen=True, slots=True)
class Rule:
    """One row of the table."""

    name: str
    level: Level
    threshold: Callable[[SwarmView], float]
    reason: str
    check: Check
    measured: bool = True


def alarms(view: SwarmView) -> tuple[Alarm, ...]:
    """All alarms that stand in this view, the worst first, then in the table's order; before all,
    an order after which no agent flies the mission: nothing is newer."""
    found = [
        Alarm(rule.name, rule.level, agents, words, rule.reason, rule.measured)
        for rule in RULES
        for agents, words in rule.check(view, rule.threshold(view))
    ]
    over = all(is_out(agent) for agent in view.agents if agent.in_plan)
    return tuple(sorted(found, key=lambda a: (not (over and a.name == _BY_ORDER), -a.level)))


def _if(words_of: Callable[[AgentView], str | None]) -> Check:
    """A case for each agent that `words_of` has something to say of."""

    def check(view: SwarmView, _: float) -> Found:
        for agent in view.agents:
            words = words_of(agent)
            if words:
                yield (agent.id,), words

    return check


def _figure(of: Callable[[AgentView], float | None], words: str, *, least: bool = False) -> Check:
    """A case for each agent whose part is not over and whose figure is over the threshold, or under
    it where that is the `least`."""

    def check(view: SwarmView, limit: float) -> Found:
        for agent in view.agents:
            value = None if agent.phase in (None, Phase.ENDED) else of(agent)
            if value is not None and (value < limit if least else value > limit):
                usual_hz = 1 / view.plan.tick_s
                yield (agent.id,), words.format(value=value, usual_hz=usual_hz)

    return check


def _apart(value: float, limit: float, decimals: int) -> tuple[str, str]:
    """Both with as many decimals as it takes to tell them apart."""
    for digits in range(decimals, 7):
        words = f"{value:.{digits}f}", f"{limit:.{digits}f}"
        if words[0] != words[1]:
            break
    return words


def _too_close(view: SwarmView, r_in_m: float) -> Found:
    """On the ground the noise of a position is no approach."""
    flying = [(a.id, a.state.position_ned_m) for a in view.agents if a.off_ground and a.state]
    for k, (a, here) in enumerate(flying):
        for b, there in flying[k + 1 :]:
            apart = math.dist(here[:2], there[:2])
            if apart < r_in_m and abs(here[2] - there[2]) < view.plan.layer_m:
                short, limit = _apart(apart, r_in_m, 2)
                yield (a, b), f"{short} m apart, under r_in {limit} m"


def _silent(agent: AgentView) -> str | None:
    if not agent.lost or agent.silence_s is None:
        return None
    return f"not heard for {agent.silence_s:.1f} s"


def _other_plan(view: SwarmView, _: float) -> Found:
    for agent in view.agents:
        if agent.state is not None and agent.state.plan_hash != view.plan_hash:
            yield (agent.id,), f"another plan ({agent.state.plan_hash:016x})"


def _stranger(agent: AgentView) -> str | None:
    return None if agent.in_plan else "on the mesh and not in the plan"


def _sigma_bound(view: SwarmView, _: float) -> Found:
    for pair in view.pairs:
        for agent, report in pair.sides:
            broken = _broken_bound(report)
            if broken:
                yield (agent, report.peer), f"sigma of agent {agent} for {report.peer}: {broken}"


def _broken_bound(report: PairReport) -> str:
    if not (math.isfinite(report.sigma) and report.sigma > 0):
        return f"{report.sigma:g} is no positive number"
    if report.status not in ("paper", "narrow") or report.d is None:
        return ""
    if report.sigma <= report.sigma_lb:
        return f"{report.sigma:.3g} is not over its bound {report.sigma_lb:.3g}"
    if not report.d_lb < report.d < report.d_ub:
        return f"D {report.d:.3g} is not between {report.d_lb:.3g} and {report.d_ub:.3g}"
    return ""


def _mixed_laws(view: SwarmView, settled_s: float) -> Found:
    most, *others = view.laws.values() or ((),)
    newest_s = max((agent.law_since_s for agent in view.agents), default=-math.inf)
    if not others or view.time_s - newest_s <= settled_s:
        return  # a change is on its way to all agents
    for agents in others:
        gains, usual = _gains(agents), _gains(most)
        how = f": {differences(usual, gains)}" if gains and usual else ""
        ids = tuple(agent.id for agent in agents)
        usual_ids = agents_named(agent.id for agent in most)
        yield ids, f"another law than {usual_ids}{how}"


def _gains(agents: tuple[AgentView, ...]) -> Gains | None:
    """Of agents that fly one law, as the newest status among them has it."""
    told = [agent.status for agent in agents if agent.status is not None]
    return max(told, key=lambda status: status.time_s).gains if told else None


_GOES_HOME: Final = (Phase.LAND, Phase.RETURN, Phase.ENDED)
_TAKEN_S: Final = 1.0
"""By then all agents that hear a command fly it, and have said so."""


def _held_alone(view: SwarmView, limit_s: float) -> Found:
    """Agents that fly a command which was not given to all, or that not all have taken; but for
    those that were sent to a point, for whom nobody waits. An agent that lands waits for none; when
    all others do, all that a command still keeps in the air are named."""
    aloft = [a for a in view.agents if a.live and a.state and a.state.phase not in _GOES_HOME]
    flying = [a for a in aloft if a.state and a.state.left is not CommandKind.GOTO]
    if _others_are_home(view, aloft):
        flying = aloft
    elif all(a.state and a.state.override for a in flying):
        return
    tags = {a.id: a.state.override for a in flying if a.state and a.state.override}
    if tags:
        meant = [c for c in view.commands if not (c.command.agents or c.command.about)]
        to_all = {c.command.tag: c.received_s for c in meant}
        newest_s = max(to_all.values(), default=-math.inf)
        soon = view.time_s < newest_s + _TAKEN_S or len(tags) == len(flying)
        if to_all.keys() >= set(tags.values()) and soon:
            return  # no two agents take a command to all, or leave it, in the same moment
        sent = [c.command for c in view.commands]
        known = {c.tag: f"{c.kind} of {c.station}" if c.station else c.kind for c in sent}
        whose = sorted(
            {known.get(tag, "of nobody whom this station heard") for tag in tags.values()}
        )
        who = printable(", ".join(whose))
        others = {agent.id for agent in flying} - tags.keys()
        wait = f"the others wait {limit_s:g} s at most"
        if not others:
            wait = "no other agent flies the mission"
        elif _expelled(view, tags.keys(), others):
            wait = "expelled: nobody waits"
        elif others.issubset(view.beside(tags)):
            wait = f"where the groups meet, {wait}"
        yield tuple(tags), f"held by a command ({who}); {wait}"


def _others_are_home(view: SwarmView, aloft: list[AgentView]) -> bool:
    """All that are in the air fly a command, and an agent without it goes home, or is there."""
    tags = {a.state.override for a in aloft if a.state}
    states = (agent.state for agent in view.agents)
    home = (s for s in states if s and s.phase in _GOES_HOME and s.override not in tags)
    return 0 not in tags and any(home)


def _expelled(view: SwarmView, agents: Collection[int], others: Collection[int]) -> bool:
    """None of the others listens to these agents: each heard them once."""
    told = [k.report for k in view.links if k.sender in agents and k.receiver in others]
    return bool(told) and all(report.age_s is None and report.received for report in told)


def _pause_s(view: SwarmView) -> float:
    return view.plan.policies.override_pause_s


def _unheard(view: SwarmView, limit_s: float) -> Found:
    if view.time_s - view.since_s > limit_s:
        for agent in view.agents:
            if agent.silence_s is None:
                yield (agent.id,), "never heard"


def _target_silent(view: SwarmView, limit_s: float) -> Found:
    """Whoever follows it flies on for a moment, and stands."""
    ages_s = {target.name: target.age_s for target in view.targets}
    for follow in view.follows:
        age_s = ages_s.get(follow.target)
        if min(follow.for_s, math.inf if age_s is None else age_s) > limit_s:
            how = "was never heard" if age_s is None else f"has not been heard for {age_s:.1f} s"
            yield follow.agents, f"target {follow.target} {how}: the formation stands"


def _overspeed(view: SwarmView, _: float) -> Found:
    for pair in view.pairs:
        if any(report.status == "overspeed" for _, report in pair.sides):
            yield (pair.a, pair.b), "consensus alone leaves their safety region"


def _long_link(view: SwarmView, r_m: float) -> Found:
    apart = set[int]()
    for group in view.groups:
        step = group.plan.step(group.step)
        form = step.new_shape if step is not None else None
        comes = not group.plan.formed and group.step == group.plan.before + 1 > 1
        if form is not None and (form.neighbours is not None or comes):
            apart |= group.plan.members  # neighbours that come together only now
        if step is not None and step.file is not None:
            apart |= group.plan.members  # one behind the other they are far apart, as is meant
    for edge in view.edges:
        if not apart.isdisjoint((edge.a, edge.b)):
            continue
        if edge.length_m is not None and edge.length_m > r_m:
            long, limit = _apart(edge.length_m, r_m, 1)
            yield (edge.a, edge.b), f"their link is {long} m long, over r {limit} m"


def _old_link(view: SwarmView, limit_s: float) -> Found:
    flying = {agent.id for agent in view.agents if agent.live and agent.phase is not Phase.ENDED}
    for link in view.links:
        age, ends = link.report.age_s, (link.receiver, link.sender)
        if age is not None and age > limit_s and flying.issuperset(ends):
            yield ends, f"agent {link.receiver} last heard agent {link.sender} {age:.1f} s ago"


def _not_believed(view: SwarmView, _: float) -> Found:
    """An agent whose word cannot be true, by the others or by this station."""
    found: dict[int, tuple[list[int], str]] = {}
    for agent in view.agents:
        told = agent.status.doubted if agent.live and agent.status is not None else {}
        for peer, words in told.items():
            found.setdefault(peer, ([], words))[0].append(agent.id)
    for peer, words in view.doubted.items():
        found.setdefault(peer, ([], words))
    for peer, (by, words) in found.items():
        yield (peer,), f"not believed by {agents_named(by) if by else 'this station'}: {words}"


def _refused_messages(view: SwarmView, _: float) -> Found:
    """What agents refused on the mesh, or this station did: of one owner of keys, by reason."""
    found: dict[tuple[str, RefusalReason], tuple[set[int], Refusal]] = {}
    told = [(a.id, a.status.refused) for a in view.agents if a.live and a.status is not None]
    for agent, refusals in [*told, (None, view.health.refused)]:
        for refusal in refusals:
            by, newest = found.setdefault((refusal.owner, refusal.reason), (set(), refusal))
            by |= set() if agent is None else {agent}
    for by, newest in found.values():
        yield tuple(sorted(by)), f"refused on the mesh: {newest.words}"


def _of(value: Callable[[AgentStatus], float | None]) -> Callable[[AgentView], float | None]:
    return lambda agent: value(agent.status) if agent.status else None


_no_heartbeat: Final = _figure(
    _of(lambda status: status.heartbeat_age_s), "no heartbeat from its vehicle for {value:.1f} s"
)
_old_state: Final = _figure(
    lambda agent: agent.link.age_s if agent.live else None, "its last state is {value:.1f} s old"
)
_loss: Final = _figure(
    lambda agent: agent.link.recent_loss, "{value:.0%} of its states are lost on the way here"
)
_no_station: Final = _figure(
    _of(lambda status: status.station_age_s), "no station heard for {value:.1f} s"
)
_ticking_slowly: Final = _figure(
    lambda agent: agent.link.tick_rate_hz,
    "ticks at {value:.1f} Hz instead of {usual_hz:.0f} Hz",
    least=True,
)


def _slow_machine(view: SwarmView, limit_hz: float) -> Found:
    """Most agents tick slowly: what else goes wrong comes of that."""
    slow = [agent for (agent,), _ in _ticking_slowly(view, limit_hz)]
    if 2 * len(slow) > len(view.agents):
        usual_hz = 1 / view.plan.tick_s
        hz = statistics.median(view.agent(i).link.tick_rate_hz or 0.0 for i in slow)
        what = f" with --speedup {view.speedup:g}" if view.speedup != 1 else ""
        words = f"the machine can't keep up{what}: ticks {hz:.1f} of {usual_hz:.0f} Hz"
        yield tuple(agent.id for agent in view.agents), words


def _slow_ticks(view: SwarmView, limit_hz: float) -> Found:
    if not any(_slow_machine(view, limit_hz)):
        yield from _ticking_slowly(view, limit_hz)


_P99_TICKS: Final = 500
"""A loop that has just started was late while the machine was busy starting all of them; of so many
ticks, five may be."""
_late_ticks: Final = _figure(
    _of(lambda status: status.tick.late_p99_ms if status.tick.count >= _P99_TICKS else None),
    "ticks up to {value:.1f} ms late (p99)",
)
_battery: Final = _figure(
    # one that broke its mission off says so already
    _of(lambda status: None if status.cause is Cause.BATTERY else status.battery_percent),
    "battery at {value:.0f} %",
    least=True,
)


def _refused(agent: AgentView) -> str | None:
    report = agent.status.vehicle_link if agent.status else None
    return report.refused if report else None


def _unsafe(agent: AgentView) -> str | None:
    report = agent.status.vehicle_link if agent.status else None
    return (
        f"failsafe parameters changed in flight: {report.unsafe}"
        if report and report.unsafe
        else None
    )


_E, _W = Level.ERROR, Level.WARNING
_WORDS: Final = False
"""Not measured."""


def _is(value: float) -> Callable[[SwarmView], float]:
    return lambda _: value


def _r_in_m(view: SwarmView) -> float:
    return view.plan.law.r_in * view.plan.unit_m


def _r_m(view: SwarmView) -> float:
    return view.plan.law.r * view.plan.unit_m


def _lost_s(view: SwarmView) -> float:
    return view.plan.policies.agent_lost_after_s


def _half_alone_s(view: SwarmView) -> float:
    return view.plan.policies.station_lost_after_s / 2


def _tick_hz(view: SwarmView) -> float:
    return 0.8 / view.plan.tick_s


def _tick_ms(view: SwarmView) -> float:
    return 1000 * view.plan.tick_s / view.speedup


FOLLOWS: Final = "follows another"
_BY_ORDER: Final = "out by order"
RULES: Final[tuple[Rule, ...]] = (
    Rule("too close", _E, _r_in_m, "the law's inner radius", _too_close),
    Rule("slow machine", _E, _tick_hz, "a fifth of the ticks missing, of most", _slow_machine),
    Rule("silent", _E, _lost_s, "the mission's policy", _if(_silent)),
    Rule("fallen", _E, _is(0), "nothing carries the vehicle", _if(fallen), _WORDS),
    Rule("failed", _E, _is(0), "the agent says so", _if(failed), _WORDS),
    Rule("other plan", _E, _is(0), "two missions in one air", _other_plan),
    Rule("vehicle silent", _E, _is(OWN_LOST_S), "five heartbeats at 1 Hz", _no_heartbeat),
    Rule("not believed", _E, _is(0), "no vehicle of the plan does that", _not_believed, _WORDS),
    Rule(
        "parameters",
        _E,
        _is(0),
        "a silent agent's vehicle comes down by them",
        _if(_unsafe),
        _WORDS,
    ),
    Rule("sigma bound", _E, _is(0), "equations (52), (66) and (67)", _sigma_bound),
    Rule("mixed laws", _E, _is(1.0), "a change takes all agents within a few ticks", _mixed_laws),
    Rule(FOLLOWS, _W, _is(0), "another agent is the cause", _if(follows), _WORDS),
    Rule("taken over", _W, _is(0), "a pilot or a failsafe flies", _if(taken_over), _WORDS),
    Rule("holding", _W, _is(0), "a policy stopped the mission", _if(holding), _WORDS),
    Rule(_BY_ORDER, _W, _is(0), "it no longer flies the mission", _if(out_by_order), _WORDS),
    Rule("held alone", _W, _pause_s, "the mission's policy", _held_alone),
    Rule("never heard", _W, _is(5.0), "all processes hear each other within 2 s", _unheard),
    Rule("target silent", _W, _is(2.0), "a few words in a row are often lost", _target_silent),
    Rule("old state", _W, _is(NEIGHBOUR_S), "its neighbours stop following it", _old_state),
    Rule("overspeed", _W, _is(0), "D_ub <= 2: no sigma keeps this pair's link", _overspeed),
    Rule("long link", _W, _r_m, "the interaction range", _long_link),
    Rule("old link", _W, _is(NEIGHBOUR_S), "the neighbour is left out of the law", _old_link),
    Rule("loss", _W, _is(0.2), "what the law was tried with", _loss),
    Rule("no station", _W, _half_alone_s, "half way to the mission's policy", _no_station),
    Rule("slow ticks", _W, _tick_hz, "a fifth of the ticks missing", _slow_ticks),
    Rule("late ticks", _W, _tick_ms, "a whole tick, in wall-clock milliseconds", _late_ticks),
    Rule("refused frames", _W, _is(0), "forged, replayed or not signed", _if(_refused)),
    Rule("battery", _W, _is(20.0), "what the autopilots call low", _battery),
    Rule(
        "refused messages",
        _W,
        _is(0),
        "a message belongs to the owner of its key",
        _refused_messages,
        _WORDS,
    ),
    Rule("stranger", _W, _is(0), "another swarm under this one's name", _if(_stranger), _WORDS),
)
