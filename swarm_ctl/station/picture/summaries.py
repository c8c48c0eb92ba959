"""What a view has to say, gathered into as few lines as possible; for screens and logs alike."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from swarm_ctl.commands.answers import others
from swarm_ctl.core.model.messages import ENDING, Command, CommandKind, Event, Phase, Severity
from swarm_ctl.core.model.plan import EVERYONE
from swarm_ctl.core.model.text import agents_counted, agents_named, printable, ranges
from swarm_ctl.core.swarm.gain_update import named
from swarm_ctl.station.picture.alarms import Alarm, Level
from swarm_ctl.station.picture.view import AgentView, CommandView, SwarmView

_MANY: Final = 6
_SYSTEM: Final = re.compile(r"sysid (\d+)$")


@dataclass(frozen=True, slots=True)
class Saying:
    """The same event of one or more agents."""

    time_s: float
    level: Severity
    agents: tuple[int, ...]
    text: str


def gather_events(events: Iterable[Event]) -> list[Saying]:
    """Events in their order, the same words of several agents as one, at the time of the first."""
    found: dict[tuple[Severity, str], Saying] = {}
    done: list[Saying] = []
    for event in events:
        key = (event.level, event.text)
        known = found.get(key)
        if known is None or event.agent in known.agents:
            if known is not None:
                done.append(known)
            known = Saying(event.time_s, event.level, (), printable(event.text))
        found[key] = Saying(known.time_s, known.level, (*known.agents, event.agent), known.text)
    return sorted([*done, *found.values()], key=lambda saying: saying.time_s)


def by_reason(alarms: Iterable[Alarm]) -> list[list[Alarm]]:
    """Alarms that are one line, in their order: of one reason, or of one kind that measures."""
    found: dict[tuple[str, str], list[Alarm]] = {}
    for alarm in alarms:
        found.setdefault(alarm.line, []).append(alarm)
    return list(found.values())


def line_of(same: Sequence[Alarm]) -> str:
    """Their line: all agents where the words are the same, or where more than `_MANY` agents have
    an alarm of the name; else the first one's words, and the other agents."""
    first, *others = same
    ids = {agent for alarm in same for agent in alarm.agents}
    if all(alarm.words == first.words for alarm in others):
        return printable(f"{agents_counted(ids)}: {first.words}")
    if len(ids) > _MANY:
        return f"{agents_counted(ids)}: {first.name} ({printable(first.text)}, and others)"
    agents = agents_named(agent for alarm in others for agent in alarm.agents)
    return f"{printable(first.text)} (and {len(others)} more: {agents})"


def gather_alarms(alarms: Iterable[Alarm]) -> list[tuple[Level, str]]:
    """The lines of alarms, in their order."""
    return [(same[0].level, line_of(same)) for same in by_reason(alarms)]


def verdict(view: SwarmView, alarms: Sequence[Alarm]) -> list[tuple[Level, str]]:
    """The state of the whole swarm in words, the most important first; never empty."""
    if alarms:
        (_, first), *others = gather_alarms(alarms)
        return [(max(alarm.level for alarm in alarms), first), *others]
    waits = waiting(view)
    if waits:
        return [(Level.WAITING, line) for line in waits]
    last = [agent.status for agent in view.agents]
    if all(status and status.phase is Phase.ENDED for status in last):
        # The verdict is made when all has ended, and may be another one.
        return [(Level.WELL, "all agents have ended, and say: completed")]
    return [(Level.WELL, "all well")]


def waiting(view: SwarmView) -> list[str]:
    """Which agents the flight waits for, and why; one line a reason, most agents first."""
    unheard = [agent.id for agent in view.agents if agent.phase is None]
    lines = [f"waiting for {agents_counted(unheard)}"] if unheard else []
    told = sorted(reasons(view).items(), key=lambda item: -len(item[1]))
    return lines + [f"{agents_counted(ids)}: {why}" for why, ids in told]


def reasons(view: SwarmView) -> dict[str, list[int]]:
    """Why agents are not in the air yet: the reason, and whose it is. Those that name one system id
    each are one reason."""
    found: dict[str, list[int]] = {}
    systems: dict[str, list[int]] = {}
    for agent in view.agents:
        early = agent.phase in (Phase.CONNECT, Phase.PREPARE, Phase.ARM)
        if early and agent.status is not None and agent.status.reason:
            why = printable(agent.status.reason)
            if named := _SYSTEM.search(why):
                why = why.removesuffix(named[1])
                systems.setdefault(why, []).append(int(named[1]))
            found.setdefault(why, []).append(agent.id)
    return {f"{why}{ranges(systems.get(why, ()))}": ids for why, ids in found.items()}


def command_words(command: Command) -> str:
    """What was commanded, as far as it fits into a line."""
    words = printable(command.kind)
    step = command.step
    if step is not None and step.new_shape is not None:
        return f"{words} {printable(step.new_shape.shape)}"
    if step is not None and step.follows is not None:
        return printable(step.title)
    if step is not None and step.way_m:
        return f"{words} to {', '.join(f'{x:.4g}' for x in step.way_m[-1])} m"
    if command.tuning is None:
        return words
    if command.kind == CommandKind.ZONE or (command.commits and command.tuning.zones is not None):
        zones, when = command.tuning.zones, f"from {command.tuning.at_s:.1f} s"
        names = ", ".join(printable(zone.name) for zone in zones or ()) or "none"
        law = named(command.tuning.gains)  # the change may be one of either
        return f"zones {names}; {law} {when}" if command.commits else f"ask for zones {names}"
    law = named(command.tuning.gains)
    return f"tune {law} from {command.tuning.at_s:.1f} s" if command.commits else f"ask for {law}"


def group_words(command: CommandView, view: SwarmView) -> str:
    """`@scouts`, where a command is for all agents of one group, and for them alone; else ''."""
    given = command.command.agents
    named = [g for g in view.plan.groups if g.name != EVERYONE and g.members == set(given)]
    return f"@{named[0].name}" if given and named else ""


def flown_order(agent: AgentView, view: SwarmView) -> str:
    """The order that an agent flies instead of the mission's step; '': none."""
    tag = agent.state.override if agent.state is not None else 0
    if not tag:
        return ""
    known = (c.command for c in view.commands if c.command.tag == tag)
    return next(map(command_words, known), "an order")


def refusals(command: CommandView, view: SwarmView) -> dict[str, list[int]]:
    """Why agents that were meant refuse: the reason, and whose it is."""
    found: dict[str, list[int]] = {}
    for i, ack in sorted(command.acks.items()):
        if not ack.accepted and i in meant_by(command, view):
            # "agent 3 is ..." of many agents is one reason
            found.setdefault(printable(ack.reason).replace(f"agent {i} ", "it "), []).append(i)
    return found


def meant_by(command: CommandView, view: SwarmView) -> tuple[int, ...]:
    """The agents that a command is for: those that it names; else all but those that have left the
    formation: of those, one that is down and refuses was not meant, nor is one that comes down by
    `return` or `resume` (`SwarmNow.meant`)."""
    given, left = command.command, view.left
    named = given.agents
    if len(named) > 1:  # of a group those that have left it are not asked
        named = tuple(i for i in named if i not in left or i in command.acks) or named
    return named or tuple(
        agent.id
        for agent in view.agents
        if agent.in_plan and (agent.id not in left or _answers_for_all(agent, command))
    )


def _answers_for_all(agent: AgentView, command: CommandView) -> bool:
    """It has left the formation, and answers an order that ends the mission all the same."""
    ack, state = command.acks.get(agent.id), agent.state
    spared = state is None or state.down
    if state is not None and command.command.kind in (CommandKind.RETURN, CommandKind.RESUME):
        spared = spared or state.left in ENDING  # it comes down already
    return ack is not None and (ack.accepted or not spared)


def taken_by(command: CommandView, view: SwarmView) -> list[int]:
    """The agents that accepted it, or show that they obey it."""
    ok = command.shown.union(i for i, ack in command.acks.items() if ack.accepted)
    return [i for i in meant_by(command, view) if i in ok]


def open_of(command: CommandView, view: SwarmView) -> list[int]:
    """The agents of which no answer was heard."""
    known = command.shown.union(command.acks)
    return [i for i in meant_by(command, view) if i not in known]


def answers(command: CommandView, view: SwarmView) -> str:
    """How far a command is acknowledged: the agents that took it, refused it, have not answered;
    and what those do that it does not name."""
    meant, taken = meant_by(command, view), taken_by(command, view)
    open_ = open_of(command, view)
    parts = [f"acknowledged by {agents_counted(taken)}"] if taken else []
    parts += [
        f"refused by {agents_counted(ids)}: {why}" for why, ids in refusals(command, view).items()
    ]
    waits = "no answer heard from" if command.over else "waiting for"
    parts += [f"{waits} {agents_counted(open_)}"] if open_ else []
    given = command.command
    left = view.left.union(meant)
    rest = others(given.kind, taken, view.plan, left, view.beside(meant)) if given.agents else ""
    whom = f" {words}" if (words := group_words(command, view)) else ""
    return f"{command_words(given)}{whom}: " + ", ".join(parts) + (f"; {rest}" if rest else "")
