"""Causes that no agent can see for itself: a computer that did not keep up, links that were late or
cut. Pure."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Final

from swarm_ctl.core.model.messages import AgentStatus
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.timeouts import FRESH_S, OWN_LOST_S

_KEPT_UP: Final = 0.8
"""A fifth of the ticks missing, as for the alarm `slow ticks`."""
_SPARE: Final = 0.9
"""Of the speed that the machine reached: a loop needs room."""
_LOSS: Final = 0.2
"""What the law was tried with."""
_ENOUGH: Final = 20
"""States of a link that figures are made of."""


def slow_machine(statuses: Sequence[AgentStatus], plan: Plan, speedup: float) -> str:
    """That the machine did not keep up, in figures, and what would do; '' where it did.

    By the agent in the middle: a single one that stood still is no slow machine.
    """
    shares = [s.tick.count / (s.tick.count + s.tick.overruns) for s in statuses if s.tick.count]
    share = statistics.median(shares) if shares else 1.0
    if share >= _KEPT_UP:
        return ""
    usual_hz, would = 1 / plan.tick_s, _SPARE * share * speedup
    what = f" with --speedup {speedup:g}" if speedup != 1 else ""
    remedy = f"about {int(would)} would do" if would >= 1 else "fewer agents, or a longer tick_s"
    remedy += ", or --lockstep" if would >= 1 and speedup > 1 else ""
    figures = f"ticks {share * usual_hz:.1f} of {usual_hz:.0f} Hz"
    return f"this machine can't keep up{what} ({figures}); {remedy}"


def bad_links(statuses: Sequence[AgentStatus], plan: Plan) -> str:
    """Which agents did not hear which that lived on, or the worst link that was late or lossy; ''
    where none was."""
    deaf = _deaf(statuses, plan.policies.agent_lost_after_s)
    if deaf:
        receivers, senders = ({pair[k] for pair in deaf} for k in (0, 1))
        which = "each other" if receivers == senders else f"{agents_named(senders)}, which lived on"
        return f"the mesh fell apart: {agents_named(receivers)} no longer heard {which}"
    links = [(s.agent, sender, link) for s in statuses for sender, link in s.links.items()]
    mute = _without_vehicle(statuses)
    links = [each for each in links if each[1] not in mute and each[2].received >= _ENOUGH]
    found = [
        (link.age_p50_s or 0.0, link.lost / (link.received + link.lost), s, r)
        for r, s, link in links
    ]
    bad = [each for each in found if each[0] > FRESH_S or each[1] > _LOSS]
    if not bad:
        return ""
    age_s, loss, sender, receiver = max(bad)
    worst = f"agent {sender}'s states reached agent {receiver} {age_s:.1f} s old (median)"
    return f"{len(bad)} of {len(links)} mesh links were late: {worst}, {loss:.0%} lost"


def _deaf(statuses: Sequence[AgentStatus], after_s: float) -> list[tuple[int, int]]:
    """(receiver, sender) where the sender lived on for so long unheard."""
    mute = _without_vehicle(statuses)
    ends_s = {s.agent: s.time_s for s in statuses if s.agent not in mute}
    return [
        (s.agent, sender)
        for s in statuses
        for sender, link in s.links.items()
        if link.age_s is not None
        and sender in ends_s
        # by the clocks of both: they are one on one machine
        and min(s.time_s, ends_s[sender] - (link.clock_ahead_s or 0.0)) - s.time_s + link.age_s
        > after_s
    ]


def _without_vehicle(statuses: Sequence[AgentStatus]) -> set[int]:
    """The agents that no longer heard their vehicles at their ends: they had no state to send, and
    no link is to blame."""
    return {
        s.agent for s in statuses if s.heartbeat_age_s is None or s.heartbeat_age_s > OWN_LOST_S
    }
