"""What all screens have in common."""

from __future__ import annotations

from textual.containers import VerticalScroll
from textual.widget import Widget
from textual.widgets import TabPane

from swarm_ctl.station.dashboard.drawing.picture import Picture


class Pane(TabPane):
    """One screen: it draws pictures, and has something that scrolls."""

    def draw(self, picture: Picture) -> None:
        raise NotImplementedError

    @property
    def scroller(self) -> Widget:
        return self.query_one(VerticalScroll)
