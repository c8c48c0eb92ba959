"""The lines that every screen has: title, tabs, the verdict, the last command's answers, the
keys."""

from __future__ import annotations

from typing import Final

from swarm_ctl.commands.parse import KINDS, ranges_of_law
from swarm_ctl.core.agent.progress import step_name
from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.text import agents_named, printable, ranges
from swarm_ctl.station.dashboard.columns import UNICODE, fit
from swarm_ctl.station.dashboard.picture import Picture
from swarm_ctl.station.dashboard.styled_line import Line
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.summaries import command_words, verdict
from swarm_ctl.station.picture.view import CommandView, SwarmView

SCREENS: Final = ("swarm", "links", "sigma", "log", "help")
BAR_STYLE: Final = {
    Level.WELL: "black on bright_green",
    Level.WAITING: "black on bright_cyan",
    Level.WARNING: "black on bright_yellow",
    Level.ERROR: "bold white on red",
}
_ANSWERED_S: Final = 20.0
"""How long (wall clock) an answered command stays on the screen."""


def title_line(picture: Picture, width: int) -> Line:
    """Mission, step, time, how many are heard; on the right what this station has missed."""
    view = picture.view
    gap = "  ·  " if width >= 100 else " · "
    minutes, seconds = divmod(max(0.0, view.time_s), 60)
    heard = sum(agent.phase is not None and not agent.lost for agent in view.agents)
    line = Line(f" {printable(view.plan.name)}", "bold").add(gap, "dim")
    line.add(
        f"step {view.step}/{len(view.plan.steps)}: {step_name(view.plan, view.step)}", "bold"
    ).add(gap, "dim")
    line.add(f"{minutes:02.0f}:{seconds:04.1f}")
    line.add(f" ×{view.speedup:g}" if view.speedup != 1 else "").add(gap, "dim")
    everybody = heard == len(view.agents)
    line.add(f"{heard}/{len(view.agents)} agents", "" if everybody else "bold yellow")
    if view.stations_there > 1:
        line.add(gap, "dim").add(f"{view.stations_there} stations")
    missed = _missed(view)
    return line.to(width - len(missed) - 1).add(missed, "yellow") if missed else line


def _missed(view: SwarmView) -> str:
    health = view.health
    parts = [
        f"{health.frames_dropped} frame{'s' if health.frames_dropped > 1 else ''} skipped"
        if health.frames_dropped
        else "",
        f"{health.bad_payloads} unreadable" if health.bad_payloads else "",
    ]
    return ", ".join(part for part in parts if part)


def tabs_line(picture: Picture, shown: str, unacknowledged: int, width: int) -> Line:
    """The screens, and on the right the figures that decide."""
    line = Line(" ")
    for k, name in enumerate(SCREENS):
        key = "?" if name == "help" else str(k + 1)
        words = f" {key} {name.capitalize()} "
        if name == "log" and unacknowledged:
            words = f" {key} Log {unacknowledged}! "
        line.add(words, "bold reverse" if name == shown else "", f"app.go('{name}')").add(" ")
    figures = _figures(picture.view, width - line.width - 1)
    return line.to(width - len(figures) - 1).add(figures)


def _figures(view: SwarmView, room: int) -> str:
    """Error, nearest, longest: as many as there is room for, the first ones first."""
    law, unit = view.plan.law, view.plan.unit_m
    near = min(
        ((a.nearest_m, a.id, a.nearest_agent) for a in view.agents if a.nearest_m is not None),
        default=None,
    )
    long = max(((e.length_m, e.a, e.b) for e in view.edges if e.length_m is not None), default=None)
    parts = [f"error {fit(view.error_m, 5, 2)} m"]
    if near:
        parts.append(
            f"nearest {near[1]}-{near[2]} {fit(near[0], 5, 2)} m (r_in {law.r_in * unit:g})"
        )
    if long:
        parts.append(f"longest {long[1]}-{long[2]} {fit(long[0], 5, 1)} m (r {law.r * unit:g})")
    for count in range(len(parts), 0, -1):
        text = " · ".join(parts[:count])
        if len(text) <= room:
            return text
    return ""


def verdict_line(picture: Picture, width: int) -> tuple[Line, str]:
    """The state of the swarm in one sentence, and the bar's style; how much more there is to say on
    the right."""
    (level, worst), *others = verdict(picture.view, picture.alarms)
    more = f" +{len(others)} " if others else " "
    line = Line(f" {UNICODE.of(level)} {worst}", click="app.go('log')")
    if line.width > width - len(more):
        line = Line(
            f" {UNICODE.of(level)} {worst}"[: max(1, width - len(more) - 1)] + "…",
            click="app.go('log')",
        )
    return line.to(width - len(more)).add(more), BAR_STYLE[level]


def command_line(picture: Picture, notice: str) -> Line:
    """What the station has to say; else the newest command, ticked off agent by agent."""
    view = picture.view
    if notice:
        return Line(f" {notice}", "cyan")
    commands = [c for c in view.commands if _current(c, view)]
    if not commands:
        return Line()
    return _answers(commands[-1], view)


def usage_line(typed: str, plan: Plan) -> Line:
    """What can be typed now."""
    kinds = [kind for kind in KINDS if kind.name.startswith(typed.split(" ")[0])]
    if len(kinds) == 1:
        kind = kinds[0]
        agents = "" if kind.for_all else " [@AGENTS]"
        does = ranges_of_law(plan) if kind.name == "tune" and " " in typed else kind.does
        return Line(f" {kind.name} {kind.usage}".rstrip() + agents, "bold").add(f"  {does}", "dim")
    return Line(" " + "  ".join(kind.name for kind in kinds or KINDS), "bold")


def _current(command: CommandView, view: SwarmView) -> bool:
    return view.time_s - command.received_s < _ANSWERED_S * max(1.0, view.speedup)


def _answers(command: CommandView, view: SwarmView) -> Line:
    meant = command.command.agents or tuple(agent.id for agent in view.agents if agent.in_plan)
    line = Line(f" {command_words(command.command)}", "bold magenta").add(" ")
    taken = [i for i in meant if i in command.acks and command.acks[i].accepted]
    refused: dict[str, list[int]] = {}
    for i in meant:
        if i in command.acks and not command.acks[i].accepted:
            # "agent 3 is ..." of many agents is one reason
            refused.setdefault(
                printable(command.acks[i].reason).replace(f"agent {i} ", "it "), []
            ).append(i)
    waiting = [i for i in meant if i not in command.acks]
    if not waiting and not refused:
        return line.add(f" {UNICODE.well} {agents_named(taken)}", "green")
    if len(meant) <= 12:
        for i in taken:
            line.add(f" {i}{UNICODE.well}", "green")
    elif taken:
        line.add(f" {len(taken)}{UNICODE.well}", "green")
    if waiting:
        line.add(f" {ranges(waiting)}{UNICODE.waiting}", "cyan")
    for reason, ids in refused.items():
        line.add(f"  {UNICODE.error} {agents_named(ids)}: {reason}", "yellow")
    return line


def keys_line(picture: Picture, shown: str, *, owns_run: bool, width: int) -> Line:
    """The keys that matter here; a click does the same."""
    marked = picture.chosen.marked
    who = f"{len(marked)} marked" if marked else "all"
    ended = all(agent.phase is Phase.ENDED for agent in picture.view.agents)
    line = (
        Line(" all agents have ended ", "bold")
        if ended
        else Line(f" {who}: ", "bold magenta" if marked else "bold")
    )
    if not ended:
        orders = (
            ("l", "land", "order('land')"),
            ("h", "hold", "order('hold')"),
            ("r", "resume", "order('resume')"),
        )
        key_words(line, (*orders, ("n", "next", "order('next')"), (":", "command", "command('')")))
    extra = {
        "swarm": (("space", "mark", "mark_cursor"), ("s", "sort", "sort_next")),
        "links": (("v", "view", "metric_next"),),
        "log": (("/", "filter", "filter"), ("w", "worst", "level_next")),
    }.get(shown, ())
    last = "^C land all" if owns_run and not ended else "q leave" if not owns_run else ""
    seen = (("x", "seen", "acknowledge"),) if picture.alarms else ()
    for key in (*extra, *seen):
        if line.width + len(key[0]) + len(key[1]) + 2 + len(last) + 2 <= width:
            key_words(line, (key,))
    if last and line.width + len(last) + 2 <= width:
        line.to(width - len(last) - 1).add(
            last, "bold", "app.interrupt" if owns_run else "app.leave"
        )
    return line


def key_words(line: Line, keys: tuple[tuple[str, str, str], ...]) -> None:
    """Append (key, what it does, the action of a click on it)."""
    for key, words, action in keys:
        click = f"app.{action}"
        line.add(" ").add(key, "bold", click).add(f" {words}", "", click)
