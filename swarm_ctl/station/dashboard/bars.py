"""The lines that every screen has: title, the verdict, the newest command's answers."""

from __future__ import annotations

from collections import Counter
from typing import Final

from swarm_ctl.commands.parse import KINDS, group_names, ranges_of_law
from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.text import agents_named, printable, ranges
from swarm_ctl.station.dashboard.drawing.picture import Picture
from swarm_ctl.station.dashboard.drawing.styled_line import (
    ALARM_STYLE,
    LEVEL_STYLE,
    SIGN,
    WAITING,
    WELL,
    StyledLine,
    fit,
)
from swarm_ctl.station.dashboard.panes.groups import flown
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.left_mission import is_out
from swarm_ctl.station.picture.summaries import (
    command_words,
    flown_order,
    group_words,
    meant_by,
    open_of,
    refusals,
    taken_by,
    verdict,
)
from swarm_ctl.station.picture.view import CommandView, SwarmView

_ENDS: Final = {
    Phase.RETURN: "fly home",
    Phase.LAND: "land",
    Phase.YIELD: "are flown by pilots",
    Phase.HOLD: "stop",
}
"""What agents do that have broken the mission off."""
_ANSWERED_S: Final = 20.0
"""How long (wall clock) an answered command stays on the screen."""
_EACH: Final = 12
"""Up to so many agents are ticked off one by one."""


def title_line(picture: Picture, width: int) -> StyledLine:
    """Mission, step, time, agents heard; on the right what this station has missed, and figures. On
    a narrow screen the step's name gives way to the nearest distance."""
    view = picture.view
    figures = _figures(view)
    for name in _step_names(view):
        line = _title(view, name, "  ·  " if width >= 100 else " · ")
        room = width - line.width - 2
        shown = next((text for text in figures if len(text) <= room), "")
        if shown or not figures:
            break
    return line.to(width - len(shown) - 1).add(shown)


def protection_line(picture: Picture) -> tuple[StyledLine, str]:
    """What keeps others off the swarm, and the line's style; empty of a mesh inside one
    computer."""
    view = picture.view
    line = StyledLine()
    is_open = view.protection.is_open
    for words, good in view.protected:
        line.add(" · " if line.width else " ", "" if is_open else "dim")
        line.add(printable(words), "" if good or is_open else "bold yellow")
    return line, ALARM_STYLE[Level.ERROR] if is_open else ""


def _step_names(view: SwarmView) -> list[str]:
    """Of the step that is flown, or that waits for an order to be flown; the longest first."""
    step = f"step {view.step}/{view.plan.last_step}"
    aloft = [agent for agent in view.agents if agent.airborne and not agent.lost]
    ends = Counter(_ENDS.get(agent.phase, "") for agent in aloft if agent.phase is not None)
    if ends and "" not in ends and all(map(is_out, aloft)):
        alike = len(ends) == 1
        end = ", ".join(f"{'all' if alike else n} {words}" for words, n in ends.most_common())
        return [f"{end}, {step} broken off", f"{end}, {step} off", end]
    orders = {flown_order(agent, view) for agent in aloft}
    if len(orders) == 1 and (order := orders.pop()):
        return [f"{step} waits: {order}", f"{step} waits", step]
    if len(view.groups) > 1:
        told = [(g.name, g.step, flown(g, view)) for g in view.groups if g.agents]
        whole = " · ".join(f"{name} {k} {words}" for name, k, words in told)
        short = ", ".join(f"{name} {k} {words.partition(' ')[0]}" for name, k, words in told)
        shortest = ", ".join(f"{name} {k}" for name, k, _ in told)
        return [f"step/{view.plan.last_step}: {whole}", short, shortest, step]
    name = view.group.step_name(view.step)
    return [f"{step}: {name}", f"{step}: {name.partition(' ')[0]}", step]


def _title(view: SwarmView, step: str, gap: str) -> StyledLine:
    minutes, seconds = divmod(max(0.0, view.time_s), 60)
    heard = sum(agent.phase is not None and not agent.lost for agent in view.agents)
    line = StyledLine(f" {printable(view.plan.name)}", "bold").add(gap, "dim")
    line.add(step, "bold").add(gap, "dim").add(f"{minutes:02.0f}:{seconds:04.1f}")
    line.add(f" ×{view.speedup:g}" if view.speedup != 1 else "").add(gap, "dim")
    agents = f"{heard}/{len(view.agents)} agents"
    line.add(agents, "" if heard == len(view.agents) else "bold yellow")
    if view.stations_there > 1:
        line.add(gap, "dim").add(f"{view.stations_there} stations")
    missed = _missed(view)
    if missed:
        line.add(gap, "dim").add(missed, "yellow")
    return line


def _missed(view: SwarmView) -> str:
    dropped, bad = view.health.frames_dropped, view.health.bad_payloads
    frames = f"{dropped} frame{'s' if dropped > 1 else ''} skipped" if dropped else ""
    return ", ".join(part for part in (frames, f"{bad} unreadable" if bad else "") if part)


def _figures(view: SwarmView) -> list[str]:
    """Nearest, error, longest: all of them, and ever fewer of them, the nearest to the last."""
    law, unit = view.plan.law, view.plan.unit_m
    near = [(a.nearest_m, a.id, a.nearest_agent) for a in view.agents if a.nearest_m is not None]
    long = [(edge.length_m, edge.a, edge.b) for edge in view.edges if edge.length_m is not None]
    parts = [] if view.error_m is None else [f"error {fit(view.error_m, 5, 2)} m"]
    shorter: list[str] = []
    if near:
        apart, a, b = min(near)
        pair, metres = f"nearest {a}-{b}", f"{fit(apart, 5, 2)} m"
        parts.insert(0, f"{pair} {metres} (r_in {law.r_in * unit:g})")
        shorter = [f"{pair} {metres}", f"nearest {metres}"]
    if long:
        length, a, b = max(long)
        parts.append(f"longest {a}-{b} {fit(length, 5, 1)} m (r {law.r * unit:g})")
    return [" · ".join(parts[:count]) for count in range(len(parts), 0, -1)] + shorter


def verdict_line(picture: Picture, width: int) -> tuple[StyledLine, str]:
    """The state of the swarm in one sentence, and the bar's style; how much more there is to say on
    the right."""
    (level, worst), *others = verdict(picture.view, picture.alarms)
    more = f"  {len(others)} more: 4 Log " if others else " "
    words = f" {SIGN[level]} {worst}"
    if StyledLine(words).width > width - len(more):
        words = words[: max(1, width - len(more) - 1)] + "…"
    line = StyledLine(words, click="app.go('log')")
    return line.to(width - len(more)).add(more), ALARM_STYLE[level]


def answers_line(picture: Picture) -> StyledLine:
    """The newest command, ticked off agent by agent; empty when it was answered long ago."""
    view = picture.view
    since_s = view.time_s - _ANSWERED_S * max(1.0, view.speedup)
    commands = [command for command in view.commands if command.received_s > since_s]
    return _answers(commands[-1], view) if commands else StyledLine()


def usage_line(typed: str, plan: Plan) -> StyledLine:
    """What can be typed now."""
    kinds = [kind for kind in KINDS if kind.name.startswith(typed.split(" ")[0])]
    if len(kinds) != 1:
        return StyledLine(" " + "  ".join(kind.name for kind in kinds or KINDS), "bold")
    kind = kinds[0]
    groups = group_names(plan)
    agents = " [@AGENTS]" if not kind.usage else " [@GROUP]" if kind.for_group and groups else ""
    does = ranges_of_law(plan) if kind.name == "tune" and " " in typed else kind.does
    line = StyledLine(f" {kind.name} {kind.usage}".rstrip() + agents, "bold")
    return line.add(f"  {does}", "dim")


def _answers(command: CommandView, view: SwarmView) -> StyledLine:
    meant, refused = meant_by(command, view), refusals(command, view)
    taken, waiting = taken_by(command, view), open_of(command, view)
    words = f"{command_words(command.command)} {group_words(command, view)}".rstrip()
    line = StyledLine(f" {words}", "bold").add(" ")
    if not waiting and not refused:
        return line.add(f" {WELL} {agents_named(taken)}", "green")
    if len(meant) <= _EACH:
        for i in taken:
            line.add(f" {i}{WELL}", "green")
    elif taken:
        line.add(f" {len(taken)}{WELL}", "green")
    if waiting and command.over:
        line.add(f"  no answer heard from {agents_named(waiting)}", "yellow")
    elif waiting:
        line.add(f" {ranges(waiting)}{WAITING}", "cyan")
    for reason, ids in refused.items():
        line.add(f"  {SIGN[Level.ERROR]} {agents_named(ids)}: {reason}", LEVEL_STYLE[Level.ERROR])
    return line
