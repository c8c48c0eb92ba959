"""What an operator must be told: a table of alarms, each a pure function of the view, with
threshold and reason.

Nothing is remembered here: an alarm is raised when it appears in a view and cleared when it does
not any more. Thresholds are mission time and metres.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from swarm_ctl.core.model.messages import Gains, PairReport, Phase
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.timeouts import NEIGHBOUR_S, OWN_LOST_S
from swarm_ctl.core.swarm.gain_update import differences
from swarm_ctl.station.picture.view import AgentView, SwarmView


class Level(IntEnum):
    """How things stand; an alarm is a warning or an error."""

    WELL = 0
    WAITING = 1
    """Nothing is wrong, and nothing goes on yet."""
    WARNING = 2
    """Look at it."""
    ERROR = 3
    """The mission, or somebody's safety, is at stake."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """One alarm that stands. `(name, agents)` tells it from others; `text` holds today's
    figures."""

    name: str
    level: Level
    agents: tuple[int, ...]
    text: str
    reason: str
    """Why the threshold is what it is."""

    @property
    def key(self) -> tuple[str, tuple[int, ...]]:
        """What stays the same while the figures in `text` change."""
        return self.name, self.agents


Found = Iterator[tuple[tuple[int, ...], str]]
"""(agents, text) of each case."""


@dataclass(frozen=True, slots=True)
class Rule:
    """One row of the table."""

    name: str
    level: Level
    threshold: Callable[[SwarmView], float]
    reason: str
    check: Callable[[SwarmView, float], Found]


def alarms(view: SwarmView) -> tuple[Alarm, ...]:
    """All alarms that stand in this view, the worst first, then in the table's order."""
    found = [
        Alarm(rule.name, rule.level, agents, text, rule.reason)
        for rule in RULES
        for agents, text in rule.check(view, rule.threshold(view))
    ]
    return tuple(sorted(found, key=lambda alarm: -alarm.level))


def _apart(value: float, limit: float, decimals: int) -> tuple[str, str]:
    """Both with as many decimals as it takes to tell them apart."""
    for places in range(decimals, 7):
        words = f"{value:.{places}f}", f"{limit:.{places}f}"
        if words[0] != words[1]:
            break
    return words


def _active(view: SwarmView) -> Iterator[AgentView]:
    """Agents heard whose part is not over."""
    return (agent for agent in view.agents if agent.phase not in (None, Phase.ENDED))


def _too_close(view: SwarmView, r_in_m: float) -> Found:
    flying = [agent for agent in view.agents if agent.airborne and agent.state is not None]
    for k, a in enumerate(flying):
        for b in flying[k + 1 :]:
            if a.state and b.state:
                apart = math.dist(a.state.position_ned_m[:2], b.state.position_ned_m[:2])
                if apart < r_in_m:
                    short, limit = _apart(apart, r_in_m, 2)
                    yield (
                        (a.id, b.id),
                        f"agents {a.id} and {b.id} are {short} m apart, under r_in {limit} m",
                    )


def _silent(view: SwarmView, _: float) -> Found:
    for agent in view.agents:
        if agent.lost and agent.silence_s is not None:
            yield (agent.id,), f"agent {agent.id} has not been heard for {agent.silence_s:.1f} s"


def _failed(view: SwarmView, _: float) -> Found:
    for agent in view.agents:
        if agent.status is not None and agent.status.outcome == "failed":
            yield (
                (agent.id,),
                f"agent {agent.id} failed: {agent.status.reason or 'no reason given'}",
            )


def _other_plan(view: SwarmView, _: float) -> Found:
    for agent in view.agents:
        if agent.state is not None and agent.state.plan_hash != view.plan_hash:
            yield (agent.id,), f"agent {agent.id} flies another plan ({agent.state.plan_hash:016x})"


def _stranger(view: SwarmView, _: float) -> Found:
    for agent in view.agents:
        if not agent.in_plan:
            yield (agent.id,), f"agent {agent.id} is on the mesh and not in the plan"


def _vehicle_silent(view: SwarmView, limit_s: float) -> Found:
    for agent in _active(view):
        age = agent.status.heartbeat_age_s if agent.status else None
        if age is not None and age > limit_s:
            yield (agent.id,), f"agent {agent.id} has no heartbeat from its vehicle for {age:.1f} s"


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
        return  # a change is just being told
    for agents in others:
        gains, usual = _gains(agents), _gains(most)
        how = f": {differences(usual, gains)}" if gains and usual else ""
        ids = tuple(agent.id for agent in agents)
        yield (
            ids,
            f"{agents_named(ids)} flies another law than {agents_named(agent.id for agent in most)}{how}",
        )


def _gains(agents: tuple[AgentView, ...]) -> Gains | None:
    """Of agents that fly one law, as the newest status among them has it."""
    told = [agent.status for agent in agents if agent.status is not None]
    return max(told, key=lambda status: status.time_s).gains if told else None


def _taken_over(view: SwarmView, _: float) -> Found:
    for agent in view.agents:
        if agent.phase is Phase.YIELD:
            yield (agent.id,), f"a pilot or a failsafe has taken the vehicle of agent {agent.id}"


def _holding(view: SwarmView, _: float) -> Found:
    for agent in view.agents:
        # without a reason it is only braking before it lands
        if agent.phase is Phase.HOLD and agent.status is not None and agent.status.reason:
            yield (agent.id,), f"agent {agent.id} holds: {agent.status.reason}"


def _unheard(view: SwarmView, limit_s: float) -> Found:
    if view.time_s - view.since_s > limit_s:
        for agent in view.agents:
            if agent.silence_s is None:
                yield (agent.id,), f"agent {agent.id} was never heard"


def _no_state(view: SwarmView, limit_s: float) -> Found:
    for agent in _active(view):
        age = agent.link.age_s
        if agent.airborne and not agent.lost and age is not None and age > limit_s:
            yield (agent.id,), f"last state of agent {agent.id} is {age:.1f} s old"


def _overspeed(view: SwarmView, _: float) -> Found:
    for pair in view.pairs:
        if any(report.status == "overspeed" for _, report in pair.sides):
            yield (
                (pair.a, pair.b),
                f"consensus alone leaves the safety region of agents {pair.a} and {pair.b}",
            )


def _long_link(view: SwarmView, r_m: float) -> Found:
    for edge in view.edges:
        both = view.agent(edge.a).live and view.agent(edge.b).live
        if both and edge.length_m is not None and edge.length_m > r_m:
            long, limit = _apart(edge.length_m, r_m, 1)
            yield (edge.a, edge.b), f"link {edge.a}-{edge.b} is {long} m long, over r {limit} m"


def _old_link(view: SwarmView, limit_s: float) -> Found:
    ended = {
        agent.id
        for agent in view.agents
        if agent.phase is Phase.ENDED or agent.lost or not agent.airborne
    }
    for link in view.links:
        age = link.report.age_s
        if age is not None and age > limit_s and not {link.receiver, link.sender} & ended:
            yield (
                (link.receiver, link.sender),
                f"agent {link.receiver} last heard agent {link.sender} {age:.1f} s ago",
            )


def _lossy(view: SwarmView, share: float) -> Found:
    for agent in _active(view):
        if agent.link.recent_loss > share:
            yield (
                (agent.id,),
                f"{agent.link.recent_loss:.0%} of the states of agent {agent.id} are lost on the way here",
            )


def _no_station(view: SwarmView, limit_s: float) -> Found:
    for agent in _active(view):
        age = agent.status.station_age_s if agent.status else None
        if age is not None and age > limit_s:
            yield (agent.id,), f"agent {agent.id} has not heard a station for {age:.1f} s"


def _slow_ticks(view: SwarmView, least_hz: float) -> Found:
    for agent in _active(view):
        rate = agent.link.tick_rate_hz
        if rate is not None and rate < least_hz:
            yield (
                (agent.id,),
                f"agent {agent.id} ticks at {rate:.1f} Hz instead of {1 / view.plan.tick_s:.0f} Hz",
            )


def _late_ticks(view: SwarmView, limit_ms: float) -> Found:
    for agent in _active(view):
        if agent.status is not None and agent.status.tick.late_p99_ms > limit_ms:
            late = agent.status.tick.late_p99_ms
            yield (agent.id,), f"ticks of agent {agent.id} are up to {late:.1f} ms late (p99)"


def _battery(view: SwarmView, least: float) -> Found:
    for agent in _active(view):
        charge = agent.status.battery_percent if agent.status else None
        if charge is not None and charge < least:
            yield (agent.id,), f"battery of agent {agent.id} at {charge:.0f} %"


def _nothing(_: SwarmView) -> float:
    return 0.0


RULES: Final[tuple[Rule, ...]] = (
    Rule(
        "too close",
        Level.ERROR,
        lambda v: v.plan.law.r_in * v.plan.unit_m,
        "the law's inner radius",
        _too_close,
    ),
    Rule(
        "silent",
        Level.ERROR,
        lambda v: v.plan.policies.agent_lost_after_s,
        "the mission's policy",
        _silent,
    ),
    Rule("failed", Level.ERROR, _nothing, "the agent says so", _failed),
    Rule("other plan", Level.ERROR, _nothing, "two missions in one air", _other_plan),
    Rule(
        "vehicle silent",
        Level.ERROR,
        lambda _: OWN_LOST_S,
        "five heartbeats at 1 Hz",
        _vehicle_silent,
    ),
    Rule("sigma bound", Level.ERROR, _nothing, "equations (52), (66) and (67)", _sigma_bound),
    Rule(
        "mixed laws",
        Level.ERROR,
        lambda _: 1.0,
        "a change takes all agents within a few ticks",
        _mixed_laws,
    ),
    Rule("taken over", Level.WARNING, _nothing, "somebody else flies", _taken_over),
    Rule("holding", Level.WARNING, _nothing, "a policy stopped the mission", _holding),
    Rule(
        "never heard",
        Level.WARNING,
        lambda _: 5.0,
        "all processes hear each other within 2 s",
        _unheard,
    ),
    Rule(
        "old state",
        Level.WARNING,
        lambda _: NEIGHBOUR_S,
        "its neighbours stop following it",
        _no_state,
    ),
    Rule(
        "overspeed",
        Level.WARNING,
        _nothing,
        "D_ub <= 2: no sigma keeps this pair's link",
        _overspeed,
    ),
    Rule(
        "long link",
        Level.WARNING,
        lambda v: v.plan.law.r * v.plan.unit_m,
        "the interaction range",
        _long_link,
    ),
    Rule(
        "old link",
        Level.WARNING,
        lambda _: NEIGHBOUR_S,
        "the neighbour is left out of the law",
        _old_link,
    ),
    Rule("loss", Level.WARNING, lambda _: 0.2, "what the law was tried with", _lossy),
    Rule(
        "no station",
        Level.WARNING,
        lambda v: v.plan.policies.station_lost_after_s / 2,
        "half way to the mission's policy",
        _no_station,
    ),
    Rule(
        "slow ticks",
        Level.WARNING,
        lambda v: 0.8 / v.plan.tick_s,
        "a fifth of the ticks missing",
        _slow_ticks,
    ),
    Rule(
        "late ticks",
        Level.WARNING,
        lambda v: 1000 * v.plan.tick_s / v.speedup,
        "a whole tick, in wall-clock milliseconds",
        _late_ticks,
    ),
    Rule("battery", Level.WARNING, lambda _: 20.0, "what the autopilots call low", _battery),
    Rule("stranger", Level.WARNING, _nothing, "another swarm under this one's name", _stranger),
)
