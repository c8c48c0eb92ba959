"""Verdict, cause and forecast agree with the truth."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from swarm_ctl.core.model.causes import Cause
from swarm_ctl.core.model.messages import CommandKind, Outcome, Phase, StepOutcome
from swarm_ctl.core.model.plan import Policy
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.vehicle import MISPLACED_M
from swarm_ctl.fuzz.invariants.places import closest
from swarm_ctl.fuzz.invariants.seen import Seen
from swarm_ctl.mission.checks.group_checks import crowded
from swarm_ctl.mission.compile.forecast import forecast
from swarm_ctl.report.judge.summary import StepVerdict
from swarm_ctl.runfolder.truth import EventKind

_BATTERY_S: Final = 600.0
"""A full one lasts so long."""
_FAIR: Final = 1.5
_FAIR_S: Final = 8.0
"""A step in fair weather takes at most so many times its forecast, and so much more."""
_FAIR_SHARE: Final = 0.8
"""There pairs come no nearer than this share of the forecast: 0.86 was the least in 40 flights."""


def verdict_agrees(seen: Seen) -> Iterator[str]:
    """With the truth, and with what the agents say of themselves."""
    flown, summary, truth = seen.flown, seen.flown.summary, seen.truth
    word = f"the verdict is {summary.outcome}"
    if (summary.outcome is Outcome.COMPLETED) != (summary.cause is None):
        yield f"{word}, its cause {summary.cause}"
    if summary.outcome is Outcome.COMPLETED:
        yield from (f"{word}, but {text}" for text in _against_completed(seen))
    elif not summary.reason:
        yield f"{word}, without a reason"
    yield from _who_was_first(seen)
    pairs = {
        (a, b): found[0]
        for a, b in itertools.combinations(seen.ids, 2)
        if (found := closest(seen, a, b, None, autopilots=True)) is not None
    }
    named_pairs = [set(finding.agents) for finding in summary.findings]
    for (a, b), near_m in pairs.items():
        if near_m < seen.r_in_m - 0.01 and not any({a, b} <= named for named in named_pairs):
            yield f"no finding names agents {a} and {b}, which were {near_m:.2f} m apart"
    least_m = min((_both_up(seen, a, b) for a, b in pairs), default=math.inf)
    told_m = summary.min_distance_m
    if seen.plan.wake is None and (math.inf if told_m is None else told_m) > least_m + 0.05:
        yield f"its smallest distance in the air is {told_m} m, and it was {least_m:.2f} m"
    crashed = {event.sysid for event in truth.events if event.event in _FALLEN}
    named = {agent for finding in summary.findings for agent in finding.agents}
    unsaid = {seen.agent_of[sysid] for sysid in crashed if sysid in seen.agent_of} - named
    if unsaid:
        yield f"no finding names {agents_named(sorted(unsaid))}, which fell or collided"
    if not flown.all_down and summary.outcome is not Outcome.FAILED:
        yield f"{word}, but not all are down"
    yield from _causes(seen)


def _both_up(seen: Seen, a: int, b: int) -> float:
    """The smallest distance of two vehicles while both are in the air [m]."""
    up = seen.airborne(a) & seen.airborne(b)
    apart = np.linalg.norm(seen.track(a)[up, :2] - seen.track(b)[up, :2], axis=1)
    return float(apart.min(initial=math.inf))


_FALLEN: Final = (EventKind.CRASH, EventKind.COLLISION, EventKind.DISARM)


def _against_completed(seen: Seen) -> Iterator[str]:
    """What a completed flight can't have."""
    flown, summary = seen.flown, seen.flown.summary
    left = {each.agent for each in summary.left}
    waited = {
        agent.id
        for agent in seen.plan.agents
        if agent.waits and not seen.events(agent.id, EventKind.LIFTOFF)
    }
    for step in summary.steps:
        of = step.agents or seen.ids
        if (left | waited).issuperset(of):  # ended by the operator, or never launched
            continue
        planned = seen.plan.group_of(of[0], step.step).step(step.step)
        goes_on = planned is not None and planned.on_timeout is Policy.CONTINUE
        late = step.result is StepVerdict.TIMEOUT and not goes_on
        if late or step.result in (StepVerdict.ABORTED, StepVerdict.NOT_REACHED):
            yield f"step {step.step} ({step.name}) is {step.result}"
    for each in summary.agents:
        if each.outcome is not Outcome.COMPLETED and each.agent not in left:
            yield f"agent {each.agent} is {each.outcome}"
    for agent in seen.ids:
        last = seen.statuses[agent][-1:]
        if not last or (last[0].phase is not Phase.ENDED and agent not in seen.elsewhen):
            yield f"agent {agent} did not live to its end"
        if agent in left | waited:
            continue
        count, flew = len(seen.route(agent).steps), len(last[0].steps) - 1 if last else 0
        if flew < count and not _comes_back(seen, agent):
            yield f"agent {agent} flew {flew} of {count} steps"
        if not seen.events(agent, EventKind.LIFTOFF):
            yield f"agent {agent} never flew"
        if seen.route(agent).steps[-1].goes_home:
            north, east = seen.plan.agent(agent).start
            home = (north * seen.unit_m, east * seen.unit_m)
            off_m = math.dist(seen.track(agent)[-1, :2], home)
            if off_m > MISPLACED_M + 1.0:
                yield f"agent {agent} came down {off_m:.1f} m from its start"
    for name, code in (summary.exit_codes or {}).items():
        number = name.removeprefix("agent-")
        gone = number.isdigit() and (int(number) in left or _comes_back(seen, int(number)))
        if code != 0 and name.startswith("agent-") and not gone:
            yield f"{name} exited with {code}"
    if flown.up:
        yield f"{agents_named(flown.up)} had not ended"


_ORDERLY: Final = frozenset({0, 1, 130})
"""Exit codes of processes that ended by themselves."""


class _BrokeOff(NamedTuple):
    """An agent that failed by itself, and not for another one or an order."""

    agent: int
    at_s: float
    cause: Cause
    reason: str


def _broke_off(seen: Seen) -> list[_BrokeOff]:
    """All of them that no order took away before, the first one first."""
    found = list[_BrokeOff]()
    for agent in set(seen.ids) - seen.elsewhen:
        last = seen.statuses[agent][-1:]
        own = last and last[0].outcome is Outcome.FAILED and last[0].left is None
        cause = last[0].cause if own else None
        if cause in (None, Cause.PEER, Cause.ORDER, Cause.STARTER):
            continue
        broken = (StepOutcome.ABORTED, StepOutcome.TIMEOUT)
        found += [
            _BrokeOff(agent, step.end_s, cause, last[0].reason)
            for step in last[0].steps[-1:]
            if step.result in broken and step.end_s is not None
        ]
    return sorted(found, key=lambda each: each.at_s)


def _who_was_first(seen: Seen) -> Iterator[str]:
    """An order does not excuse who failed by itself before the first one was given; it does who
    failed after it. Who failed first is the cause."""
    summary, failed = seen.flown.summary, _broke_off(seen)
    ends = (CommandKind.LAND, CommandKind.RETURN, CommandKind.KILL)
    given_s = min(
        (order.at_s for agent in seen.ids for order in seen.orders(agent, *ends)), default=math.inf
    )
    first = failed[0] if failed else None
    if summary.outcome is Outcome.ABORTED and first and first.at_s < given_s - 1.0:
        yield (
            f"the verdict is aborted, but agent {first.agent} had failed at {first.at_s:.1f} s"
            f" ({first.reason})"
        )
    found = summary.findings or summary.refused_orders
    if summary.outcome is not Outcome.FAILED or found or seen.elsewhen:
        return
    last = [said[-1] for said in seen.statuses.values() if said]
    by_order = [s for s in last if s.outcome is Outcome.ABORTED and s.left is None]
    final = len(last) == len(seen.ids) and all(s.phase is Phase.ENDED for s in last)
    orderly = _ORDERLY.issuperset((summary.exit_codes or {}).values())
    later = any(s.outcome is Outcome.FAILED and s.left is not None for s in last)  # when, is unsaid
    if by_order and final and orderly and not later:
        obeyed = {status.agent for status in by_order}
        own_s = [order.at_s for agent in obeyed for order in seen.orders(agent, *ends)]
        if own_s and (first is None or first.at_s > min(own_s)):
            yield (
                f"the verdict is failed ({summary.reason}), but agents were ordered to end it at"
                f" {min(own_s):.1f} s, before any failed"
            )
    mine = [each for each in failed if each.cause is summary.cause]
    if first and mine and first.at_s < mine[0].at_s - 1.0:
        yield (
            f"the cause is {summary.cause}, of {mine[0].at_s:.1f} s, but agent {first.agent} failed"
            f" at {first.at_s:.1f} s ({first.reason})"
        )


def _comes_back(seen: Seen, agent: int) -> bool:
    return any(agent in (each.restart or ()) for each in seen.of("restart"))


def _causes(seen: Seen) -> Iterator[str]:
    """A cause needs what can bring it about."""
    cause, words = seen.flown.summary.cause, seen.flown.summary.reason
    named = {name for _, _, _, values, _ in seen.faults for name in values} | {*seen.parameters}
    piloted = any(pilot for _, _, _, _, pilot in seen.faults)
    mesh = bool(seen.flown.scenario.mesh.model_dump(exclude_defaults=True))
    can: dict[Cause, bool] = {
        # an agent that lies says that a command holds it
        Cause.ORDER: any(order.sent is not None for order in seen.flown.orders)
        or bool(seen.of("says")),
        Cause.STARTER: False,
        Cause.PILOT: piloted or bool(named) or bool(seen.of("kill", "stop", "restart", "clock")),
        Cause.WIND: seen.wind_mps > 0,
        Cause.BATTERY: any(name.startswith("SIM_BATT") for name in named)
        or seen.flown.end_s > _BATTERY_S,
        Cause.STATION: mesh
        or bool(seen.of("station", "part", "clock", "stop"))
        or bool(seen.flown.scenario.clocks),
        Cause.LINK: mesh
        or bool(named)
        or bool(seen.of("part", "clock", "stop", "says", "restart")),
        Cause.PROCESS: bool(seen.of("kill", "station", "restart")),
        Cause.MACHINE: False,
        Cause.FINDING: bool(seen.flown.summary.findings or seen.flown.summary.refused_orders),
        Cause.FALL: bool(named),
    }
    if cause is not None and not can.get(cause, True):
        yield f"the cause is {cause} ({words}), and nothing of that kind happened"


def forecast_holds(seen: Seen) -> Iterator[str]:
    """In fair weather."""
    if not seen.fair:
        return
    summary = seen.flown.summary
    autopilots = [entry.autopilot for entry in seen.flown.mission.fleet.agents]
    expected = forecast(seen.plan, autopilots)
    if any(step.expected_s is None for step in expected) or any(crowded(seen.plan)):
        return  # `validate` says that it may not get there
    # the judge takes an agent's times for the truth's, so what it finds of other clocks is not held
    # against the flight
    own = [said[-1].outcome for said in seen.statuses.values() if said]
    completed = not seen.one_clock and own.count(Outcome.COMPLETED) == len(seen.ids)
    if summary.outcome is not Outcome.COMPLETED and not completed:
        yield f"{summary.outcome}: {summary.reason}"
        return
    if not seen.timely:
        return
    for at, step in zip(seen.plan.all_steps(), expected, strict=True):
        found = [
            said[-1].steps[at.number]
            for said in map(seen.statuses.__getitem__, at.group.ids)
            if said and len(said[-1].steps) > at.number
        ]
        ends_s = [result.end_s for result in found if result.end_s is not None]
        if not ends_s or step.expected_s is None or at.step.barrier:  # there a group waits
            continue
        start_s, end_s = min(result.start_s for result in found), max(ends_s)
        took_s, most_s = end_s - start_s, _FAIR * step.expected_s + _FAIR_S
        name = f"step {at.number} ({at.name})"
        if took_s > most_s:
            yield f"{name} took {took_s:.1f} s; forecast: {step.expected_s:.1f} s"
        if step.form is None or step.form.smallest_pair is None:
            continue
        near_m = _nearest_between(seen, at.group.ids, start_s, end_s)
        if near_m < _FAIR_SHARE * step.form.smallest_m:
            forecast_m = step.form.smallest_m
            words = f"{near_m:.2f} m apart; forecast: {forecast_m:.2f} m"
            yield f"in {name} a pair was {words}"


def _nearest_between(seen: Seen, ids: tuple[int, ...], from_s: float, to_s: float) -> float:
    """The smallest horizontal distance of two of these agents' vehicles in that time [m], but for
    those that are apart by height."""
    time_s, columns = seen.truth.time_s, [seen.column[agent] for agent in ids]
    places = seen.truth.position_ned_m[(time_s >= from_s) & (time_s <= to_s)][:, columns]
    between = places[:, :, None] - places[:, None]
    apart = np.linalg.norm(between[..., :2], axis=-1)
    apart[np.abs(between[..., 2]) >= seen.plan.layer_m] = np.inf
    apart[:, range(len(ids)), range(len(ids))] = np.inf
    return float(apart.min(initial=np.inf))
