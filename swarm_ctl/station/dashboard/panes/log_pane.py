"""The log screen: what the journal holds, filtered; the newest at the bottom."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from rich.text import Text
from textual.app import ComposeResult
from textual.events import Resize
from textual.geometry import Size
from textual.widget import Widget
from textual.widgets import RichLog

from swarm_ctl.core.model.text import ranges
from swarm_ctl.station.dashboard.drawing.picture import Chosen, Picture
from swarm_ctl.station.dashboard.drawing.styled_line import LEVEL_STYLE, SIGN, WELL, StyledLine
from swarm_ctl.station.dashboard.drawing.widgets import OnGround, Painted
from swarm_ctl.station.dashboard.panes.pane import Pane
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.journal import EntryKind, JournalLine

_KIND_STYLE: Final = {
    EntryKind.COMMAND: "bold",
    EntryKind.CLEARED: "green",
    EntryKind.STATION: "cyan",
}
_WORDS_AT: Final = 31


class EntryLog(RichLog, OnGround, can_focus=False):
    """Journal entries, long ones on several lines (cut to one, where `short`); stays at the end
    unless scrolled up."""

    def __init__(self, name: str) -> None:
        super().__init__(id=name, min_width=1)
        self._told: list[JournalLine] = []
        self._ends: list[int] = []
        """How many lines there are after each entry."""
        self._shape = (0, False)

    def show(self, entries: Sequence[JournalLine], *, short: bool = False) -> None:
        """Write what is new, and all from the first entry on that has changed."""
        width = self.scrollable_content_region.width
        pairs = enumerate(zip(self._told, entries, strict=False))
        same = next((k for k, (a, b) in pairs if a != b), min(len(self._told), len(entries)))
        if (width, short) != self._shape:
            same, self._shape = 0, (width, short)
        if same == len(entries) == len(self._told):
            return
        at_end = self.is_vertical_scroll_end
        del self.lines[self._ends[same - 1] if same else 0 :], self._ends[same:], self._told[same:]
        self._line_cache.clear()
        self.virtual_size = Size(width, len(self.lines))
        for entry in entries[same:]:
            self.write(self._text(entry, width, short), width=width, scroll_end=at_end)
            self._ends.append(len(self.lines))
            self._told.append(entry)
        self.refresh()

    def on_resize(self, event: Resize) -> None:
        """What was written was for another room."""
        super().on_resize(event)
        self.post_message(Painted.Sized())

    def _text(self, entry: JournalLine, width: int, short: bool) -> Text:
        bad = entry.level >= Level.WARNING
        name = LEVEL_STYLE[entry.level] if bad else _KIND_STYLE.get(entry.kind, "")
        sign = SIGN[entry.level] if bad else WELL if entry.kind is EntryKind.CLEARED else " "
        words = entry.text + (f" (×{entry.count})" if entry.count > 1 else "")
        words += "  [seen]" if entry.acknowledged else ""
        room = max(10, width - _WORDS_AT)
        agents = ranges(entry.agents)
        agents = agents if len(agents) <= _WORDS_AT - 20 else f"{len(entry.agents)} agents"
        head = Text.assemble(
            (f" {entry.time_s:7.1f} ", "dim"),
            (f"{sign} ", name),
            (f"{entry.kind:<8}", name or "dim"),
            (f"{agents:<{_WORDS_AT - 20}} ", "bold"),
        )
        text = Text(words, name)
        if short:
            text.truncate(room, overflow="ellipsis")
        rows = text.wrap(self.app.console, room)
        return head.append_text(Text("\n" + " " * _WORDS_AT).join(rows))


class LogPane(Pane):
    """The whole journal."""

    def compose(self) -> ComposeResult:
        yield Painted("empty")
        yield EntryLog("entries")

    @property
    def scroller(self) -> Widget:
        return self.query_one(EntryLog)

    def draw(self, picture: Picture) -> None:
        entries = [entry for entry in picture.entries if passes(entry, picture.chosen)]
        self.query_one(EntryLog).show(entries)
        words = "nothing passes the filter" if picture.entries else "nothing in the log yet"
        self.query_one(Painted).paint([] if entries else [StyledLine(f"   {words}", "dim")])


def passes(entry: JournalLine, chosen: Chosen) -> bool:
    """Level and words of the filter; every word must be somewhere in the line."""
    if entry.level < chosen.log_level:
        return False
    line = f"{entry.kind} {ranges(entry.agents)} {entry.text}".lower()
    return all(word in line for word in chosen.log_words.lower().split())
