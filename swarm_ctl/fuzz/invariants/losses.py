"""What must hold where something is lost or in excess: the policy of it acts, in its time and no
lighter than it says; and no failsafe acts for nothing."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

from swarm_ctl.core.agent.agent import STATUS_EVERY_S
from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import AgentStatus, CommandKind, Phase, StepOutcome, StepResult
from swarm_ctl.core.model.plan import Policy
from swarm_ctl.core.model.steps.table import AnyStep
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.timeouts import ESTIMATE_DOUBT_S
from swarm_ctl.core.swarm.hearing import SMALL_SWARM
from swarm_ctl.fuzz.invariants.seen import FLIES, Seen
from swarm_ctl.mavlink.telemetry.estimate import LEAST_SATELLITES

ACTS_S: Final = 6.0
"""After the time of a policy: for the word to come, and the statuses at 2 Hz."""
_BLIND_S: Final = 1.5
"""Without a position for so long an agent says so."""
_EARLY_S: Final = 2.0
"""Holds begin and end between two statuses."""
_SOON_S: Final = 1.0
"""By so much a loss may seem to be older than it is."""
_SILENCES: Final = ("kill", "stop", "restart", "part", "station", "clock", "says", "vehicle")
"""What may make an agent, or the station, be heard no more."""
_PAUSES: Final = "hold form move follow goto launch join expel resume next"
"""Orders that stop the clock of a step, or end it."""


def policies_act(seen: Seen) -> Iterator[str]:
    """All of this module."""
    yield from _times_out(seen)
    yield from _gives_up_early(seen)
    yield from _runs_empty(seen)
    yield from _flies_against_a_pilot(seen)
    yield from _flies_blind(seen)
    yield from _as_its_policy_says(seen)
    yield from _for_nothing(seen)
    yield from _stands_before_it_lands(seen)
    for due in _dues(seen):
        least = FailsafeAction(due.policy.value) if due.policy is not Policy.CONTINUE else None
        for agent in due.agents:
            if least is not None and _does_less(seen, agent, due, least):
                yield f"{due.words} at {due.at_s:g} s, and agent {agent} did not {due.policy}"


class _Due(NamedTuple):
    """A loss that is certain, and what it has to bring about in some agents."""

    policy: Policy
    at_s: float
    by_s: float
    agents: list[int]
    words: str
    gone: frozenset[int] = frozenset()
    """The agents that are lost."""


def _dues(seen: Seen) -> Iterator[_Due]:
    """An agent that is dead or stopped, a station that is gone, a vehicle that doubts its estimate:
    all long enough."""
    policies = seen.plan.policies
    for from_s, until_s, agents, values, _ in seen.faults if seen.from_start else ():
        few = values.get("SIM_GPS_SATS", LEAST_SATELLITES) < LEAST_SATELLITES
        vague = values.get("SIM_GPS_ACC", 0.0) > policies.position_accuracy_flight_m
        by_s = from_s + ESTIMATE_DOUBT_S + ACTS_S
        if (few or vague) and until_s >= by_s:
            words = f"the receiver of {agents_named(agents)} was in doubt"
            yield _Due(policies.estimate, from_s, by_s, [*agents], words)
    if not seen.good_mesh or seen.of("clock", "says") or not seen.one_clock:
        return
    for each in seen.of("kill", "stop", "station"):
        gone = frozenset(each.kill or each.stop or ())
        back = [b.at_s for b in seen.of("restart") if gone & set(b.restart or ())]
        ends = [each.until_s] if each.for_s else []
        until_s = min([*ends, *(at for at in back if at > each.at_s)], default=math.inf)
        policy, after_s = policies.agent_lost, policies.agent_lost_after_s
        words = f"{agents_named(sorted(gone))} fell silent"
        if each.kind == "station":
            policy, after_s = policies.station_lost, policies.station_lost_after_s
            words = "the station was gone"
        by_s = each.at_s + after_s + ACTS_S + (1.0 if len(seen.ids) > SMALL_SWARM else 0.0)
        if until_s >= by_s and not any(_has_left(seen, lost, each.at_s) for lost in gone):
            others = [agent for agent in seen.ids if agent not in gone]
            yield _Due(policy, each.at_s, by_s, others, words, gone)


def _does_less(seen: Seen, agent: int, due: _Due, least: FailsafeAction) -> bool:
    """At that time the agent flies its mission, or does what weighs less."""
    dead_s = min(seen.taken[agent], seen.first(agent, "kill", "stop"))
    said = [s for s in seen.statuses[agent] if s.time_s <= due.by_s]
    if dead_s < due.by_s or agent in seen.elsewhen or not said:
        return False
    now = said[-1]
    route = seen.route(agent)
    down = bool(now.step) and route.steps[min(now.step, len(route.steps)) - 1].goes_down
    if now.time_s < due.by_s - 1.5 or down or now.phase not in FLIES or not now.airborne:
        return False  # it has ended, or is on its way down
    if due.gone:
        # it waits for those of its group; on the way back each flies for itself
        over = [s for lost in due.gone for s in seen.statuses[lost][-1:] if s.phase is Phase.ENDED]
        away = now.phase is Phase.RETURN or now.left is not None or seen.plan.agent(agent).waits
        if over or away or not due.gone & route.group(now.step).members:
            return False
    return now.action is None or now.action.rank < least.rank


def _has_left(seen: Seen, agent: int, at_s: float) -> bool:
    """By an order, before it fell silent: the others are told to go on without it. Or it was never
    in the air, or on the ground again."""
    said = [s for s in seen.statuses[agent] if s.time_s <= at_s]
    return not said or said[-1].left is not None or not said[-1].airborne


def _as_its_policy_says(seen: Seen) -> Iterator[str]:
    """Each agent names the cause of what it does: it does what the policy of this cause says."""
    for agent, said in seen.statuses.items():
        for status in said:
            asked = _asked(seen, status) if status.action is not None else None
            if asked is not None and status.action not in asked:
                yield (
                    f"agent {agent} did {status.action} for {status.cause} at {status.time_s:.1f} s"
                    f" ({status.reason}); its policy says {' or '.join(sorted(asked))}"
                )
                break


def _asked(seen: Seen, status: AgentStatus) -> set[str] | None:
    """What an agent may do for the cause that it names; None: no policy is for that."""
    policies, cause = seen.plan.policies, status.cause
    steps = seen.route(status.agent).steps
    step = steps[min(status.step, len(steps)) - 1] if status.step else None
    policy = (
        {
            Cause.PEER: policies.agent_lost,
            Cause.STATION: policies.station_lost,
            Cause.FENCE: policies.fence,
            Cause.BATTERY: policies.battery_low,
            Cause.SPEED: policies.too_fast,
            Cause.WIND: policies.wind,
            Cause.ESTIMATE: policies.estimate,
            Cause.TIMEOUT: step.on_timeout if step is not None else Policy.LAND,
        }.get(cause)
        if cause is not None
        else None
    )
    if policy is None:
        return None
    ends = (CommandKind.LAND, CommandKind.RETURN, CommandKind.KILL)
    given = seen.orders(status.agent, *ends)
    if any(order.at_s <= status.time_s for order in given):
        return None  # it has failed, and does as it was ordered
    asked = {policy.value}
    # who can't return lands, and who is not up in time; on the ground, and where all go home,
    # nobody waits for a lost agent
    alone = cause is Cause.PEER and (not status.airborne or step is None or step.goes_home)
    climbs = cause is Cause.TIMEOUT and step is not None and step.climbs_to_m is not None
    if policy is Policy.RETURN or alone or climbs:
        asked.add(FailsafeAction.LAND.value)
    return asked


def _for_nothing(seen: Seen) -> Iterator[str]:
    """Nobody is given up before it was silent for the policy's time."""
    policies = seen.plan.policies
    first_s = min((each.at_s for each in seen.of(*_SILENCES, "pilot")), default=math.inf)
    if not seen.good_mesh or seen.flown.scenario.mesh.loss or not seen.one_clock:
        return
    for cause, words, after_s in (
        (Cause.PEER, "has not been heard", policies.agent_lost_after_s),
        (Cause.STATION, "", policies.station_lost_after_s),
    ):
        for agent, said in seen.statuses.items():
            early = (s for s in said if s.action is not None and s.cause is cause)
            early = (
                s for s in early if words in s.reason and s.time_s < first_s + after_s - _SOON_S
            )
            if (status := next(early, None)) is not None:
                yield (
                    f"agent {agent} did {status.action} at {status.time_s:.1f} s"
                    f" ({status.reason}), and nothing was lost before {first_s:g} s"
                )


def _stands_before_it_lands(seen: Seen) -> Iterator[str]:
    """`hold_before_land_s`, of who lands by a policy of land."""
    least_s = seen.plan.policies.hold_before_land_s
    lands = (Cause.PEER, Cause.STATION, Cause.FENCE, Cause.BATTERY, Cause.WIND, Cause.ESTIMATE)
    for agent in set(seen.ids) - seen.elsewhen:
        said, until_s = seen.statuses[agent], min(seen.taken[agent], seen.lies[agent])
        held = [s for s in said if s.action is FailsafeAction.LAND and s.airborne]
        if not held or held[0].cause not in lands or held[0].time_s > until_s:
            continue
        before = [s for s in said if s.time_s < held[0].time_s][-1:]
        flew = bool(before) and before[0].phase is Phase.FLY and before[0].action is None
        begins = next((s for s in held if s.phase is Phase.LAND), None)
        # who comes back, or goes over from another action, has stood, or counts anew
        if not flew or begins is None or begins.cause is not held[0].cause:
            continue
        if begins.step and seen.route(agent).steps[begins.step - 1].lands_in_place:
            continue  # it had begun to come down, by the mission
        if begins.time_s - before[0].time_s < least_s - STATUS_EVERY_S:
            yield (
                f"agent {agent} began to land {begins.time_s - before[0].time_s:.1f} s after it"
                f" gave up ({begins.reason}); policies.hold_before_land_s: {least_s:g}"
            )


def _results(seen: Seen, agent: int) -> Iterator[tuple[StepResult, AnyStep]]:
    """Its own, with what was planned."""
    said = seen.statuses[agent][-1:]
    return zip(said[0].steps[1:] if said else (), seen.route(agent).steps, strict=False)


def _times_out(seen: Seen) -> Iterator[str]:
    """No step takes longer than its time-out, but for `continue`; some orders stop its clock."""
    ordered = any(order.line.split()[0] in _PAUSES.split() for order in seen.flown.orders)
    if ordered or seen.of("says", "stop", "restart"):
        return
    for agent in set(seen.ids) - seen.elsewhen:
        last_s = max((s.time_s for s in seen.statuses[agent][-1:]), default=0.0)
        for result, step in _results(seen, agent):
            took_s = (last_s if result.end_s is None else result.end_s) - result.start_s
            ends = step.on_timeout not in (Policy.CONTINUE, Policy.HOLD)
            ends = ends and not step.goes_down
            until_s = result.start_s + took_s
            held = sum(
                s.action is FailsafeAction.HOLD and result.start_s <= s.time_s <= until_s
                for s in seen.statuses[agent]
            )
            if ends and took_s > step.timeout_s + held * STATUS_EVERY_S + ACTS_S:
                yield (
                    f"agent {agent} was in {result.name} for {took_s:.0f} s, its time-out is"
                    f" {step.timeout_s:g} s"
                )


def _gives_up_early(seen: Seen) -> Iterator[str]:
    """The time-out of a step waits for what holds it up: an order, or a policy."""
    for agent in set(seen.ids) - seen.elsewhen:
        changed_s = min(seen.lies[agent], seen.first(agent, "stop", "restart"))
        for result, step in _results(seen, agent):
            end_s = result.end_s
            if result.result is not StepOutcome.TIMEOUT or end_s is None or end_s > changed_s:
                continue
            held = sum(
                s.action is FailsafeAction.HOLD or s.reason.startswith("the operator commands")
                for s in seen.statuses[agent]
                if result.start_s < s.time_s < end_s
            )
            took_s, waited_s = end_s - result.start_s, held * STATUS_EVERY_S
            if took_s < step.timeout_s + waited_s - _EARLY_S:
                yield (
                    f"agent {agent} gave {result.name} up after {took_s:.0f} s, of which it was"
                    f" held for {waited_s:.0f} s; its time-out is {step.timeout_s:g} s"
                )


def _runs_empty(seen: Seen) -> Iterator[str]:
    """With a battery under its reserve, as the vehicle tells it, an agent does what the policy
    says, or more; but for one that is on its way down."""
    policies = seen.plan.policies
    if policies.battery_low is Policy.CONTINUE:
        return
    least = FailsafeAction(policies.battery_low.value).rank
    for agent, said in seen.statuses.items():
        low = [
            s
            for s in said
            if s.battery_percent is not None
            and s.battery_percent < policies.battery_reserve_percent
            and s.time_s < min(seen.taken[agent], seen.first(agent, "kill", "stop"))
        ]
        late = [s for s in low if s.time_s > low[0].time_s + 2.0]
        steps = seen.route(agent).steps
        late = [s for s in late if s.airborne and s.phase in FLIES]
        late = [s for s in late if not (s.step and steps[min(s.step, len(steps)) - 1].goes_down)]
        if any(s.action is None or s.action.rank < least for s in late):
            yield (
                f"agent {agent} flew on with a battery under"
                f" {policies.battery_reserve_percent:g} % from {low[0].time_s:.1f} s on"
            )


def _flies_against_a_pilot(seen: Seen) -> Iterator[str]:
    """A pilot who takes a vehicle has it: its agent does not fly its mission on. A PX4 without
    sticks refuses a manual mode in flight."""
    px4 = {entry.id for entry in seen.flown.mission.fleet.agents if entry.autopilot == "px4"}
    for from_s, _, agents, _, pilot in seen.faults if seen.from_start else ():
        for agent in agents if pilot else ():
            before = [s for s in seen.statuses[agent] if s.time_s <= from_s][-1:]
            if not before or before[0].phase not in FLIES or not before[0].airborne:
                continue
            until_s = min(
                from_s + 2.0 * ACTS_S,
                seen.first(agent, "kill", "stop", "clock"),
                *(order.at_s for order in seen.orders(agent) if order.at_s > from_s - 1.0),
            )
            refused = pilot == "manual" and agent in px4
            if refused or agent in seen.elsewhen or seen.taken[agent] < from_s:
                continue
            late = [s for s in seen.statuses[agent] if from_s + ACTS_S < s.time_s < until_s]
            if any(s.phase is Phase.FLY and s.action is None and s.airborne for s in late):
                yield f"a pilot took agent {agent}'s vehicle at {from_s:g} s, and it flew on"


def _flies_blind(seen: Seen) -> Iterator[str]:
    """Without a position an agent waits, says why, and tells none. Whatever fault ends first gives
    it back."""
    for from_s, _, agents, values, _ in seen.faults if seen.from_start else ():
        for agent in agents if values.get("SIM_GPS_OFF") == 1 else ():
            others = (f for f in seen.faults if agent in f[2] and "SIM_GPS_OFF" in f[3])
            ends_s = [until_s for _, until_s, *_ in others if until_s > from_s]
            hands_s = min(*ends_s, seen.first(agent, "kill", "stop", "clock", "restart"))
            if agent in seen.elsewhen or seen.taken[agent] < from_s:
                continue
            late = [s for s in seen.statuses[agent] if from_s + _BLIND_S < s.time_s < hands_s]
            if any(s.phase is Phase.FLY and s.airborne and not s.reason for s in late):
                yield f"agent {agent} had no position from {from_s:g} s on, and flew on"
            told_s = [
                s.time_s for s in seen.states[agent] if from_s + _BLIND_S < s.time_s < hands_s
            ]
            if told_s:
                yield (
                    f"agent {agent} had no position from {from_s:g} s on, and told one at"
                    f" {told_s[0]:.1f} s"
                )
