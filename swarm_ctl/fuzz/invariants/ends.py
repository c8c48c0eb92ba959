"""All end, are down, and wait for each other on the way."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from swarm_ctl.core.model.causes import Cause
from swarm_ctl.core.model.messages import AgentState, Phase, StepOutcome
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.fuzz.invariants.seen import Seen


def all_end(seen: Seen) -> Iterator[str]:
    """Within the bound of the flight, but for who is taken."""
    up = [agent for agent in seen.flown.up if not math.isfinite(seen.taken[agent])]
    if up:
        yield f"{agents_named(up)} had not ended by {seen.flown.bound_s:.0f} s"


def all_are_down(seen: Seen) -> Iterator[str]:
    """And disarmed; nobody is done with a landing, or ends, before that."""
    truth = seen.truth
    if not len(truth.time_s):
        yield "there is no truth of it"
        return
    for agent in seen.ids:
        k = seen.column[agent]
        if not (truth.armed[-1, k] or truth.airborne[-1, k]) or math.isfinite(seen.taken[agent]):
            continue
        how = "in the air" if truth.airborne[-1, k] else "armed"
        yield f"the vehicle of agent {agent} was {how} at the end, {truth.time_s[-1]:.1f} s"
    for agent in sorted(set(seen.ids) - seen.elsewhen):
        last, k = seen.statuses[agent][-1:], seen.column[agent]
        yield from _ends_up(seen, agent)
        results = last[0].steps[1:] if last else ()
        for planned, step in zip(seen.route(agent).steps, results, strict=False):
            if not planned.goes_down or step.result is not StepOutcome.DONE or step.end_s is None:
                continue
            at = int(np.searchsorted(truth.time_s, step.end_s))
            on = at < len(truth.time_s) and (truth.armed | truth.airborne)[at, k]
            if on and step.end_s < min(seen.taken[agent], seen.lies[agent]):
                how = "in the air" if truth.airborne[at, k] else "armed"
                yield f"agent {agent} was done with `{step.name}` at {step.end_s:.1f} s, {how}"


def _ends_up(seen: Seen, agent: int) -> Iterator[str]:
    """An agent goes on until its vehicle is down and disarmed, or it says why not."""
    last, truth = seen.statuses[agent][-1:], seen.truth
    if not last or last[0].phase is not Phase.ENDED or last[0].cause in _OTHER_HANDS:
        return
    at_s = last[0].time_s
    at = min(int(np.searchsorted(truth.time_s, at_s + 0.2)), len(truth.time_s) - 1)
    if at_s < min(seen.taken[agent], seen.lies[agent]) and truth.armed[at, seen.column[agent]]:
        yield f"agent {agent} ended at {at_s:.1f} s, and its vehicle was armed"


_OTHER_HANDS: Final = (Cause.PILOT, Cause.VEHICLE, Cause.VEHICLE_LINK)


def steps_go_together(seen: Seen) -> Iterator[str]:
    """By the states of each tick: one begins a step, and another that it hears is not done yet with
    the one before, nor was."""
    if not seen.good_mesh or seen.of("part"):
        return
    given = [order.sent for order in seen.flown.orders if order.sent is not None]
    alone = {agent for sent in given for agent in (*sent.command.about, *sent.command.agents)}
    for sent in given:  # the others go on without those that alone carry it out
        taken = {agent for agent, ack in sent.acks.items() if ack.accepted}
        alone |= taken if len(taken) < len(sent.acks) else set()
    skipped = [o.at_s for o in seen.flown.orders if o.line.split()[0] in ("next", "resume")]
    free = [
        agent.id
        for agent in seen.plan.agents
        if not agent.waits
        and agent.id not in alone | seen.elsewhen
        and not math.isfinite(seen.first(agent.id, "says", "kill", "stop", "restart"))
    ]
    for agent in free:
        last = seen.statuses[agent][-1:]
        for k, step in enumerate(last[0].steps if last else ()):
            at_s = step.start_s
            if k == 0 or any(abs(at_s - skip_s) < 3.0 for skip_s in skipped):
                continue
            for other, number in seen.routes.awaited(agent, k - 1).items():
                if other == agent or other not in free or seen.timed_out(agent, k - 1):
                    continue
                if _not_done(seen.states[other], number, at_s):
                    yield (
                        f"agent {agent} began step {k} ({step.name}) at {at_s:.1f} s, and agent"
                        f" {other} was not done with step {number}"
                    )


def _not_done(said: list[AgentState], number: int, at_s: float) -> bool:
    """Whether an agent that told this was not done with the step of this number in any of its
    states from the last second before."""
    heard = [s for s in said if at_s - 1.0 <= s.time_s <= at_s + 1e-3]
    return bool(heard) and not any(
        (s.step, s.done) >= (number, True) or _apart_from(s) for s in heard
    )


def _apart_from(state: AgentState) -> bool:
    """The others need not wait for it: it gave up, left, or a pilot has its vehicle."""
    over = (Phase.LAND, Phase.RETURN, Phase.YIELD, Phase.ENDED)
    return state.left is not None or state.phase in over
