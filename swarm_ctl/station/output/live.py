"""The live view: a whole screen drawn from one `SwarmView`, and from nothing else.

It has always the height it is given, so that a redraw moves nothing. Colours are the terminal's own
sixteen (light and dark alike), and every colour has a sign or a word beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderResult
from rich.segment import Segment
from rich.text import Text

from swarm_ctl.core.agent.progress import step_name
from swarm_ctl.core.model.messages import PairReport, Phase
from swarm_ctl.core.model.text import ranges
from swarm_ctl.station.output.columns import ASCII, COLUMNS, LEVEL_STYLE, UNICODE, Glyphs, Row, fit
from swarm_ctl.station.picture.alarms import Level, alarms
from swarm_ctl.station.picture.summaries import answers, gather_events, verdict
from swarm_ctl.station.picture.view import AgentView, PairView, SwarmView

_BAR_STYLE: Final = {
    Level.WELL: "black on green",
    Level.WAITING: "black on cyan",
    Level.WARNING: "black on yellow",
    Level.ERROR: "bold white on red",
}


def render(
    view: SwarmView, width: int | None = None, height: int | None = None, *, ctrl_c: str = ""
) -> ConsoleRenderable:
    """The view as a rich renderable of exactly `width` x `height` cells; the console's own size
    where not given.

    `ctrl_c`: what that means where it does not land the swarm.
    """
    return _Screen(view, width, height, ctrl_c)


@dataclass(frozen=True, slots=True)
class _Screen:
    view: SwarmView
    width: int | None
    height: int | None
    ctrl_c: str

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        width, height = (
            self.width or options.max_width,
            self.height or options.height or console.height,
        )
        plain = options.ascii_only
        for k, line in enumerate(
            _Drawing(self.view, width, ASCII if plain else UNICODE, self.ctrl_c).lines(height)
        ):
            line.truncate(width, overflow="crop" if plain else "ellipsis", pad=True)
            # Text.render leaves a plain line's own style to its caller
            for segment in Segment.apply_style(line.render(console), console.get_style(line.style)):
                # what others wrote may hold signs that this terminal can't show
                yield Segment(_ascii(segment.text), segment.style) if plain else segment
            if k + 1 < height:
                yield Segment.line()


class _Drawing:
    def __init__(self, view: SwarmView, width: int, glyphs: Glyphs, ctrl_c: str) -> None:
        self._ctrl_c = ctrl_c
        self._view = view
        self._width = width
        self._glyphs = glyphs
        self._alarms = alarms(view)

    def lines(self, height: int) -> list[Text]:
        """Everything from top to bottom, exactly `height` lines; in too little room the head comes
        first."""
        free = height - 5  # title, figures, bar, the table's head, footer
        agents = self._agents(max(1, free - 4))
        hidden = len(self._view.agents) - len(agents)
        free -= len(agents) + bool(hidden)
        (level, worst), *others = verdict(self._view, self._alarms)
        shown = others[: max(0, free // 2)]
        free -= len(shown)
        sigma_rows = max(0, min(8, (free - 4) // 3))
        parts: list[Text] = [self._title(), self._figures(), self._bar(level, worst)]
        parts += [
            Text(f" {self._glyphs.of(level)} {text}", style=LEVEL_STYLE[level])
            for level, text in shown
        ]
        parts += self._table(agents)
        if hidden:
            parts.append(Text(f"    and {hidden} more agents", style="dim"))
        if sigma_rows:
            parts += [
                self._rule(f"{self._glyphs.sigma}: pairs in the avoidance region"),
                *self._sigma(sigma_rows),
            ]
            free -= sigma_rows + 2
        if free > 1:
            parts += [self._rule("events"), *self._events(free - 1)]
        parts += [Text("")] * (height - 1 - len(parts))
        return [*parts[: height - 1], self._footer()]

    # --- the head ---

    def _title(self) -> Text:
        view, glyphs = self._view, self._glyphs
        minutes, seconds = divmod(max(0.0, view.time_s), 60)
        heard = sum(agent.phase is not None and not agent.lost for agent in view.agents)
        gap = self._gap()
        return Text.assemble(
            (f" {view.plan.name}", "bold"),
            gap,
            (f"step {view.step}/{len(view.plan.steps)}: {step_name(view.plan, view.step)}", "bold"),
            gap,
            f"{minutes:02.0f}:{seconds:04.1f}",
            f" {glyphs.times}{view.speedup:g}" if view.speedup != 1 else "",
            gap,
            f"{heard}/{len(view.agents)} agents",
            (
                f"{gap}{view.health.frames_dropped} views skipped"
                if view.health.frames_dropped
                else "",
                "yellow",
            ),
        )

    def _figures(self) -> Text:
        view, law = self._view, self._view.plan.law
        near = min(
            (
                (a.nearest_m, (a.id, a.nearest_agent))
                for a in view.agents
                if a.nearest_m is not None
            ),
            default=None,
        )
        long = max(
            ((e.length_m, (e.a, e.b)) for e in view.edges if e.length_m is not None), default=None
        )
        parts = [f"error {fit(view.error_m, 5, 2, self._glyphs)} m"]
        if near:
            parts.append(
                f"nearest {_pair(near[1])} {fit(near[0], 5, 2)} m (r_in {law.r_in * view.plan.unit_m:g})"
            )
        if long:
            parts.append(
                f"longest {_pair(long[1])} {fit(long[0], 5, 1)} m (r {law.r * view.plan.unit_m:g})"
            )
        return Text(" " + self._gap().join(parts))

    def _gap(self) -> str:
        space = "  " if self._width >= 100 else " "
        return f"{space}{self._glyphs.dot}{space}"

    def _bar(self, level: Level, text: str) -> Text:
        line = f" {self._glyphs.of(level)} {text}"
        return Text(line.ljust(self._width), style=_BAR_STYLE[level])

    # --- the table ---

    def _agents(self, room: int) -> list[AgentView]:
        """All agents if there is room, else those with alarms first; by id."""
        agents = self._view.agents
        if len(agents) <= room:
            return list(agents)
        chosen = sorted(agents, key=lambda agent: (-self._level(agent.id), agent.id))[
            : max(1, room - 1)
        ]
        return sorted(chosen, key=lambda agent: agent.id)

    def _level(self, agent_id: int) -> Level:
        return max(
            (alarm.level for alarm in self._alarms if agent_id in alarm.agents), default=Level.WELL
        )

    def _table(self, agents: Iterable[AgentView]) -> list[Text]:
        """A heading and one line per agent; what room there is goes between the columns."""
        columns = [
            column for column in COLUMNS if column.from_width <= self._width < column.below_width
        ]
        gap = " " * max(
            1, (self._width - sum(column.width for column in columns)) // (len(columns) - 1)
        )
        lines = [Text(gap.join(column.place(column.title) for column in columns), style="dim")]
        for agent in agents:
            row = Row(self._view, agent, self._level(agent.id), self._glyphs)
            line = Text(style="dim" if agent.phase is Phase.ENDED else "")
            for k, column in enumerate(columns):
                cell = column.cell(row, column.width)
                words, style = (cell, "") if isinstance(cell, str) else cell
                line.append((gap if k else "") + column.place(words), style=style)
            lines.append(line)
        return lines

    # --- sigma, events, footer ---

    def _rule(self, title: str) -> Text:
        line = self._glyphs.line
        return Text(f"{line}{line} {title} ".ljust(self._width, line), style="dim")

    def _sigma(self, rows: int) -> list[Text]:
        """A heading and exactly `rows` lines."""
        pairs = self._view.pairs
        chosen = pairs if len(pairs) <= rows else pairs[: rows - 1]
        lines = [self._sigma_line(pair) for pair in chosen] or [Text("   none", style="dim")]
        if len(chosen) < len(pairs):
            lines.append(
                Text(f"   and {len(pairs) - len(chosen)} more, further apart", style="dim")
            )
        heads = ("pair", "apart", "sigma", "over bound", "D", "status")
        return [Text(_sigma_cells(heads), style="dim"), *lines, *[Text("")] * (rows - len(lines))]

    def _sigma_line(self, pair: PairView) -> Text:
        sides = dict(pair.sides)
        both = [sides.get(pair.a), sides.get(pair.b)]
        statuses = list(dict.fromkeys(report.status for report in both if report))
        cells = (
            _pair((pair.a, pair.b)),
            f"{fit(pair.distance_m, 5, 2)} m",
            self._each(both, lambda report: report.sigma),
            self._each(both, lambda report: report.sigma_lb),
            self._each(both, lambda report: report.d),
            "/".join(statuses),
        )
        return Text(_sigma_cells(cells), style="yellow" if "overspeed" in statuses else "")

    def _each(
        self, both: Iterable[PairReport | None], of: Callable[[PairReport], float | None]
    ) -> str:
        """One figure as the two agents see it, in the order of the pair."""
        return "  ".join(
            f"{fit(of(report) if report else None, 5, 2, self._glyphs):>5}" for report in both
        )

    def _events(self, rows: int) -> list[Text]:
        """Exactly `rows` lines, the newest at the bottom."""
        sayings = gather_events(self._view.events)[-rows:]
        lines = []
        for saying in sayings:
            level = {"warning": Level.WARNING, "error": Level.ERROR}.get(saying.level)
            mark = self._glyphs.of(level) if level else " "
            lines.append(
                Text(
                    f" {mark} {saying.time_s:6.1f}  {ranges(saying.agents):<6} {saying.text}",
                    style=LEVEL_STYLE[level] if level else "",
                )
            )
        return [*lines, *[Text("")] * (rows - len(lines))]

    def _footer(self) -> Text:
        if all(agent.phase is Phase.ENDED for agent in self._view.agents):
            return Text(" all agents have ended", style="bold")
        if self._ctrl_c:
            return Text(f" {self._ctrl_c}", style="bold")
        landing = [command for command in self._view.commands if command.command.kind == "land"]
        if not landing:
            return Text(" Ctrl-C lands the swarm", style="bold")
        return Text(
            f" Ctrl-C again stops at once{self._gap()}{answers(landing[-1], self._view)}",
            style="bold",
        )


def _ascii(text: str) -> str:
    return text.encode("ascii", "replace").decode()


def _pair(pair: tuple[int, int | None]) -> str:
    return f"{pair[0]}-{pair[1]}"


def _sigma_cells(cells: Sequence[str]) -> str:
    pair, apart, sigma, bound, d, status = cells
    return f" {pair:>7}  {apart:>7}  {sigma:>12}  {bound:>12}  {d:>12}  {status}"
