"""Plain lines for a log: what has changed from one view to the next, each thing once. ASCII
only."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from swarm_ctl.core.model.messages import Event
from swarm_ctl.core.model.text import agents_named, printable
from swarm_ctl.station.picture.alarms import Alarm, alarms
from swarm_ctl.station.picture.protection import MeshKind
from swarm_ctl.station.picture.summaries import answers, gather_alarms, gather_events, reasons
from swarm_ctl.station.picture.view import GroupView, SwarmView

_FIGURE: Final = re.compile(r"[\d.]+([-, ]+\d+)*")


def log_lines(previous: SwarmView | None, view: SwarmView) -> list[str]:
    """Lines for everything new in `view` since `previous` (None: since nothing was known): steps,
    phases, events, commands, alarms raised and cleared. Of the first view, events and commands come
    first, at their own times.
    """
    past = [*_events(previous, view), *_commands(previous, view)]
    now = [
        *_protection(previous, view),
        *_step(previous, view),
        *_phases(previous, view),
        *_reasons(previous, view),
        *(words for _, words in past if previous),
        *_alarms(previous, view),
    ]
    said = [] if previous else sorted(past, key=lambda line: line[0])
    said += [(view.time_s, words) for words in now]
    return [f"[{t:7.1f} s] {words}".encode("ascii", "replace").decode() for t, words in said]


def _protection(previous: SwarmView | None, view: SwarmView) -> Iterator[str]:
    """What keeps others off the swarm: at once where something is amiss on an open mesh, else once
    all is as it should be."""
    words = _protected(view)
    if words and words != (_protected(previous) if previous else ""):
        yield words


def _protected(view: SwarmView) -> str:
    told = view.protected
    complete = view.protection.mesh is MeshKind.OPEN or all(good for _, good in told[:1])
    return ", ".join(words for words, _ in told) if complete else ""


def _step(previous: SwarmView | None, view: SwarmView) -> Iterator[str]:
    """Of each group that flies now; and for which other groups it begins to wait."""
    before = {(g.name, g.plan.before): g for g in previous.groups} if previous else {}
    for group in view.groups:
        old = before.get((group.name, group.plan.before))
        who = f"{group.name}: " if len(view.plan.groups) > 1 else ""
        new = group.step > (old.step if old is not None else group.plan.before)
        if new and not group.plan.waits_on(group.step):
            yield f"{who}step {group.step}/{view.plan.last_step}: {group.step_name}"
        late, was = _late(group), _late(old) if old is not None else frozenset[int]()
        if late and not (was and old is not None and old.step == group.step):
            yield f"{who}done with {group.step_name}, waits for {view.whom(late)}"


def _late(group: GroupView) -> frozenset[int]:
    """Those of other groups that it waits for, when all of its own are done."""
    own = group.plan.members.intersection(group.waits_for)
    return frozenset() if own else frozenset(group.waits_for)


def _phases(previous: SwarmView | None, view: SwarmView) -> Iterator[str]:
    before = {agent.id: agent.phase for agent in previous.agents} if previous else {}
    changed: dict[str, list[int]] = {}
    for agent in view.agents:
        old = before.get(agent.id)
        if agent.phase is not None and agent.phase is not old:
            words = (
                f"{old.name.lower()} -> {agent.phase.name.lower()}"
                if old is not None
                else agent.phase.name.lower()
            )
            changed.setdefault(words, []).append(agent.id)
    for words, ids in changed.items():
        yield f"{agents_named(ids)}: {words}"


def _reasons(previous: SwarmView | None, view: SwarmView) -> Iterator[str]:
    """Why agents wait; a figure that changes within the reason is not told again."""
    before = (
        {(i, _FIGURE.sub("", why)) for why, ids in reasons(previous).items() for i in ids}
        if previous
        else set()
    )
    for why, ids in reasons(view).items():
        new = [i for i in ids if (i, _FIGURE.sub("", why)) not in before]
        if new:
            yield f"{agents_named(new)}: {why}"


def _events(previous: SwarmView | None, view: SwarmView) -> Iterator[tuple[float, str]]:
    fresh = view.event_count - (previous.event_count if previous else 0)
    # a new step is told by the states already, once for all
    names = [(k, group.step_name(k)) for group in view.plan.groups for k in group.told_steps]
    steps = {f"step {k}: {name}" for k, name in names}
    new: tuple[Event, ...] = view.events[-fresh:] if fresh > 0 else ()
    if fresh > len(new):
        yield new[0].time_s, f"{fresh - len(new)} events came too fast to be told"
    for saying in gather_events(event for event in new if event.text not in steps):
        mark = "" if saying.level == "info" else f"{printable(saying.level).upper()}: "
        yield saying.time_s, f"{agents_named(saying.agents)}: {mark}{saying.text}"


def _commands(previous: SwarmView | None, view: SwarmView) -> Iterator[tuple[float, str]]:
    before = {c.command.id: answers(c, previous) for c in previous.commands} if previous else {}
    for command in view.commands:
        now = answers(command, view)
        if before.get(command.command.id) != now:
            yield command.received_s, f"command {now}"


def _alarms(previous: SwarmView | None, view: SwarmView) -> Iterator[str]:
    old = _by_key(previous) if previous else {}
    new = _by_key(view)
    for level, text in gather_alarms([alarm for key, alarm in new.items() if key not in old]):
        yield f"{level.name}: {text}"
    cleared: dict[str, list[int]] = {}
    for key, alarm in old.items():
        if key not in new:
            cleared.setdefault(alarm.name, []).extend(alarm.agents)
    for name, ids in cleared.items():
        yield f"cleared: {name} ({agents_named(ids)})"


def _by_key(view: SwarmView) -> dict[tuple[str, tuple[int, ...]], Alarm]:
    return {alarm.key: alarm for alarm in alarms(view)}
