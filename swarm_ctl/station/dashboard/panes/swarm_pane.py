"""The swarm screen: the groups and the table of agents, the newest of the log, trends, the map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.events import Resize
from textual.widget import Widget

from swarm_ctl.station.dashboard.drawing.canvas import Canvas, Floats
from swarm_ctl.station.dashboard.drawing.picture import Picture
from swarm_ctl.station.dashboard.drawing.styled_line import StyledLine, fit
from swarm_ctl.station.dashboard.drawing.widgets import Painted
from swarm_ctl.station.dashboard.panes.agent_table import AgentTable
from swarm_ctl.station.dashboard.panes.groups import group_lines
from swarm_ctl.station.dashboard.panes.log_pane import EntryLog, passes
from swarm_ctl.station.dashboard.panes.pane import Pane
from swarm_ctl.station.dashboard.panes.swarm_map import MapScale, fitted, map_lines
from swarm_ctl.station.picture.journal import TREND_S

LEAST_ROWS, MOST_ROWS = 10, 16
"""Of both strips: a title and a curve each."""
_SPANS_S: Final = (60.0, 120.0, TREND_S)
_FINE: Final = 16
"""Dots of a curve for each cell, so that a steep one has no holes."""
_GAP_S: Final = 5.0
"""Between two points that are farther apart there is no line: nothing was known."""


def trend_lines(picture: Picture, width: int, rows: int) -> list[StyledLine]:
    """So many lines, or one less; none before anything is known."""
    told, law = picture.trends, picture.view.plan.law
    if len(told) < 2 or width < 20:
        return []
    r_in_m = law.r_in * picture.view.plan.unit_m
    near = [(point.time_s, point.nearest_m) for point in told]
    error = [(point.time_s, point.error_m) for point in told]
    size = width, rows // 2 - 1
    return [
        *_strip("nearest pair in the air", near, size, ("r_in", r_in_m)),
        *_strip("formation error", error, size),
    ]


def _strip(
    title: str,
    points: Sequence[tuple[float, float | None]],
    size: tuple[int, int],
    bound: tuple[str, float] | None = None,
) -> list[StyledLine]:
    """The title with the newest value, and a curve of this size from 0 up; the newest point is at
    the right."""
    (now_s, newest), (width, rows) = points[-1], size
    span_s = next((s for s in _SPANS_S if s >= now_s - points[0][0]), TREND_S)
    most = max([value for _, value in points if value is not None], default=0.0)
    top = max(most, 1.25 * bound[1] if bound else 0.1)
    canvas = Canvas(width, rows)
    wide, high = 2.0 * width - 1.0, 4.0 * rows - 1.0

    def draw(share: Floats, values: Floats, name: str) -> None:
        canvas.dots(wide * share, high * (1.0 - values / top), name)

    if bound is not None:
        share = np.linspace(0.0, 1.0, width // 2)
        draw(share, np.full(len(share), bound[1]), "red dim")
    known = np.array([point for point in points if point[1] is not None], dtype=np.float64)
    if len(known) > 1:
        times_s, values = known.T
        share = np.linspace(0.0, 1.0, _FINE * width)
        at_s = now_s - span_s * (1.0 - share)
        after = np.searchsorted(times_s, at_s).clip(1, len(times_s) - 1)
        shown = (at_s >= times_s[0]) & (at_s <= times_s[-1])
        shown &= times_s[after] - times_s[after - 1] <= _GAP_S
        draw(share[shown], np.interp(at_s, times_s, values)[shown], "")
    canvas.words(1, 0, f"{top:.3g} m", "dim")
    canvas.words(1, rows - 1, "0", "dim")
    head = StyledLine(f" {title}, last {span_s:g} s", "bold dim").add(
        f"  {fit(newest, 5, 2)} m", "bold"
    )
    if bound is not None:
        head.add(f"  {bound[0]} {bound[1]:g} m", "red")
    return [head, *canvas.lines()]


_WIDE: Final = 120
"""From this width on the map stands beside the table, not under it."""
_TALL: Final = 14
"""From this height on a narrow screen has lines of the log between table and map."""
_LOG: Final = 8
"""Lines that trends leave to the log."""
_RECENT: Final = 60
"""Entries of the log beside the map: more than a terminal has lines."""


class SwarmPane(Pane):
    """What the agents do, and where they are."""

    def compose(self) -> ComposeResult:
        with Vertical(id="left"):
            yield Painted("groups")
            yield AgentTable("agents")
            yield EntryLog("recent")
            yield Painted("trends")
        yield Painted("map")

    def on_resize(self, event: Resize) -> None:
        """Lay out for the new size."""
        width, wide = event.size.width, event.size.width >= _WIDE
        self.set_class(wide, "wide")
        self.set_class(not wide and event.size.height < _TALL, "low")
        self.query_one("#left").styles.width = (80 if width < 140 else 105) if wide else "1fr"

    @property
    def scroller(self) -> Widget:
        return self.query_one(AgentTable)

    def map_scale(self, picture: Picture) -> MapScale:
        """Of the map as it is drawn now."""
        return fitted(picture, *self.query_one("#map", Painted).room)

    def draw(self, picture: Picture) -> None:
        groups = self.query_one("#groups", Painted)
        groups.display = len(picture.view.plan.groups) > 1
        if groups.display:
            groups.paint(group_lines(picture, groups.room[0]))
        self.query_one(AgentTable).draw(picture)
        recent, drawing = self.query_one(EntryLog), self.query_one("#map", Painted)
        if recent.display and recent.size.width:
            newest = picture.entries[-_RECENT:]
            shown = [entry for entry in newest if passes(entry, picture.chosen)]
            recent.show(shown, short=not self.has_class("wide"))
        trends = self.query_one("#trends", Painted)
        spare = self.size.height - len(picture.view.agents) - len(picture.view.groups) - _LOG
        rows = min(spare, MOST_ROWS)
        fits = self.has_class("wide") and rows >= LEAST_ROWS
        lines = trend_lines(picture, recent.size.width, rows) if fits else []
        trends.display = bool(lines)
        if lines:
            trends.styles.height = rows
            trends.paint(lines)
        drawing.paint(map_lines(picture, *drawing.room))
