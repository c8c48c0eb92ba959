"""What a failing test shows of its flights: the steps and the last events."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from swarm_ctl.api.flight import SwarmFlight
from swarm_ctl.core.model.text import printable, ranges

_EVENTS: Final = 10


def account(flight: SwarmFlight) -> str:
    """A flight so far, in lines for a terminal."""
    return "\n".join((*_steps(flight), "", *_last_events(flight)))


def _steps(flight: SwarmFlight) -> Iterator[str]:
    plan, statuses = flight.plan, flight.statuses()
    names = [
        (
            group,
            k,
            f"{group.name} {group.step_name(k)}" if len(plan.groups) > 1 else group.step_name(k),
        )
        for group in plan.groups
        for k in group.told_steps
        if not group.waits_on(k)
    ]
    wide = max(len(name) for _, _, name in names)
    yield f"step {'':{wide}}  from [s]    to [s]  agents"
    for group, k, name in names:
        told = {i: statuses[i] for i in group.ids if i in statuses}
        results = {i: s.steps[k] for i, s in told.items() if k < len(s.steps)}
        said: dict[str, list[int]] = {}
        for agent in group.agents:
            found = results.get(agent.id)
            said.setdefault(found.result if found else "not reached", []).append(agent.id)
        starts = [found.start_s for found in results.values()]
        ends = [found.end_s for found in results.values() if found.end_s is not None]
        since = f"{min(starts):.1f}" if starts else "-"
        until = f"{max(ends):.1f}" if starts and len(ends) == len(starts) else "-"
        agents = "; ".join(f"{ranges(ids)} {result}" for result, ids in said.items())
        yield f"{k:4} {name:{wide}}  {since:>8}  {until:>8}  {agents}"


def _last_events(flight: SwarmFlight) -> Iterator[str]:
    events = sorted(flight.events(), key=lambda event: event.time_s)
    yield f"the last {min(_EVENTS, len(events))} of {len(events)} events"
    for event in events[-_EVENTS:]:
        text = printable(event.text)
        yield f"[{event.time_s:7.1f} s] agent {event.agent}, {event.level}: {text}"
