"""The swarm screen: the groups and the table of agents, the newest of the log, trends, the map."""

from __future__ import annotations

from typing import Final

from textual.app import ComposeResult
from textual.containers import Vertical
from textual.events import Resize
from textual.widget import Widget

from swarm_ctl.station.dashboard.drawing.picture import Picture
from swarm_ctl.station.dashboard.drawing.widgets import Painted
from swarm_ctl.station.dashboard.panes.agent_table import AgentTable
from swarm_ctl.station.dashboard.panes.groups import group_lines
from swarm_ctl.station.dashboard.panes.log_pane import EntryLog, passes
from swarm_ctl.station.dashboard.panes.pane import Pane
from swarm_ctl.station.dashboard.panes.swarm_map import MapScale, fitted, map_lines
from swarm_ctl.station.dashboard.panes.trends import LEAST_ROWS, MOST_ROWS, trend_lines

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
