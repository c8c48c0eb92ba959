"""Textual's widgets as all screens use them: painted lines, and tables that change by cells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from rich.cells import cell_len, set_cell_size
from rich.console import Console
from rich.segment import Segment
from rich.style import Style
from textual.events import Click
from textual.geometry import Size
from textual.message import Message
from textual.renderables.sparkline import Sparkline
from textual.scroll_view import ScrollView
from textual.strip import Strip
from textual.widget import Widget
from textual.widgets import DataTable

from swarm_ctl.station.dashboard.drawing.styled_line import DASH, StyledLine, style


class OnGround(Widget):
    """Looks its own style up once: for each line it would take a tenth of all drawing."""

    _ground: Style | None = None

    @property
    def rich_style(self) -> Style:
        if self._ground is None:
            self._ground = super().rich_style
        return self._ground

    def notify_style_update(self) -> None:
        self._ground = None
        super().notify_style_update()


class Painted(ScrollView, OnGround, can_focus=False):
    """Lines painted by hand. Only changed lines are drawn again."""

    class Sized(Message):
        """There is another room to draw in."""

    class Clicked(Message):
        """On a cell of the painted widget of this name."""

        def __init__(self, name: str, column: int, row: int) -> None:
            super().__init__()
            self.name, self.column, self.row = name, column, row

    def __init__(self, name: str) -> None:
        super().__init__(id=name)
        self._strips: list[Strip] = []

    @property
    def room(self) -> tuple[int, int]:
        size = self.scrollable_content_region.size
        return size.width, size.height

    def paint(self, lines: Sequence[StyledLine], back: str = "", width: int | None = None) -> None:
        """Show other lines, each cut or filled to the width (by default the widget's own)."""
        width = self.room[0] if width is None else width
        before = self._strips
        self._strips = [Strip(line.fit(width, back), width) for line in lines]
        if len(self._strips) != len(before):
            self.virtual_size = Size(width, len(self._strips))
            self.refresh(layout=True)
            return
        for y, (old, new) in enumerate(zip(before, self._strips, strict=True)):
            if old != new:
                self.refresh_lines(y, 1)

    def on_resize(self) -> None:
        """What was drawn was for another room."""
        self.post_message(self.Sized())

    def on_click(self, event: Click) -> None:
        self.post_message(self.Clicked(str(self.id), event.x, event.y))

    def render_line(self, y: int) -> Strip:
        """One row of the widget, on the theme's own colours."""
        k = y + self.scroll_offset.y
        width = self.scrollable_content_region.width
        strip = self._strips[k] if k < len(self._strips) else Strip.blank(width)
        return strip.adjust_cell_length(width).apply_style(self.rich_style)


@dataclass(frozen=True, slots=True)
class WordsView:
    """Words of one style in a table."""

    words: str
    name: str = ""
    click: str = ""

    def segments(self, _: Console) -> list[Segment]:
        return [Segment(self.words, style(self.name, self.click))]


@dataclass(frozen=True, slots=True)
class Trend:
    """A series as a sparkline in a table."""

    values: tuple[float, ...]
    width: int

    def segments(self, console: Console) -> list[Segment]:
        values = self.values[-self.width :]
        if len(values) < 2:
            return [Segment(DASH, style("dim"))]
        return list(console.render(Sparkline(values, width=len(values))))


@dataclass(frozen=True, slots=True)
class Painting:
    """A cell painted by hand: (words, style) from left to right."""

    parts: tuple[tuple[str, str], ...]
    click: str = ""

    def segments(self, _: Console) -> list[Segment]:
        return [Segment(words, style(name, self.click)) for words, name in self.parts]


TableCell: TypeAlias = WordsView | Trend | Painting


@dataclass(frozen=True, slots=True)
class Heading:
    """A column of a table: its title, its width without the gap behind it, where its words go."""

    title: str
    width: int
    left: bool = False
    name: str = "bold dim"

    def label(self, column: int) -> Segment:
        """The title, with what `DataTable` makes a click on the header from."""
        meta = Style(meta={"row": -1, "column": column})
        return Segment(self.cell(self.title).words, style(self.name) + meta)

    def cell(self, words: str, name: str = "", click: str = "") -> WordsView:
        """Words at their place in the column, cut if need be, and the gap."""
        words = set_cell_size(words, self.width) if cell_len(words) > self.width else words
        room = " " * (self.width - cell_len(words))
        return WordsView(words + room + " " if self.left else room + words + " ", name, click)


class CellTable(DataTable[TableCell], OnGround, can_focus=False):
    """A `DataTable` that is told whole rows, and changes only the cells that say something else.

    Each row's first cell names it; no two are equal.
    """

    def __init__(self, name: str) -> None:
        super().__init__(id=name, cell_padding=0, cursor_type="row", show_cursor=False)
        self._headings: tuple[Heading, ...] = ()
        self._told: dict[str, Sequence[TableCell]] = {}
        self._order: list[str] = []
        self._head = Strip([])
        self._drawn: dict[int, tuple[Sequence[TableCell], Strip]] = {}

    @property
    def room(self) -> int:
        return self.scrollable_content_region.width

    def show(self, headings: tuple[Heading, ...], rows: Mapping[str, Sequence[TableCell]]) -> None:
        """Show these rows in their order."""
        widths = [heading.width for heading in headings]
        if widths != [h.width for h in self._headings] or rows.keys() != self._told.keys():
            self._build(headings, rows)
        else:
            self._change(rows)
        if headings != self._headings:
            self._head = Strip([heading.label(k) for k, heading in enumerate(headings)])
            self.refresh()
        self._headings, self._told = headings, dict(rows)

    def _build(self, headings: Sequence[Heading], rows: Mapping[str, Sequence[TableCell]]) -> None:
        self.clear(columns=True)
        for k, heading in enumerate(headings):
            self.add_column(heading.title, width=heading.width + 1, key=str(k))
        for key, row in rows.items():
            self.add_row(*row, key=key)
        self._order = list(rows)

    def _change(self, rows: Mapping[str, Sequence[TableCell]]) -> None:
        for key, row in rows.items():
            for k, (now, before) in enumerate(zip(row, self._told[key], strict=True)):
                if now != before:
                    self.update_cell(key, str(k), now)
        if list(rows) != self._order:
            self._order = list(rows)
            index = {row[0]: k for k, row in enumerate(rows.values())}
            self.sort("0", key=index.__getitem__)

    def on_resize(self) -> None:
        """What was drawn was for another room."""
        self.post_message(Painted.Sized())

    def render_line(self, y: int) -> Strip:
        """A row by its cells: `DataTable` forgets all that it has drawn when one cell changes, and
        its own way through Rich takes twenty times as long.
        """
        row = y - 1 + self.scroll_offset.y
        strip = self._head if y == 0 else self._row(row) if row < self.row_count else Strip([])
        ink = self.rich_style
        if self.show_cursor and y and row == self.cursor_row:
            ink += style("reverse")
        return strip.adjust_cell_length(self.size.width).apply_style(ink)

    def _row(self, row: int) -> Strip:
        cells = self._told[self._order[row]]
        told, strip = self._drawn.get(row, ((), Strip([])))
        if cells != told:
            segments = [segment for cell in cells for segment in cell.segments(self.app.console)]
            strip = Strip(segments)
            self._drawn[row] = cells, strip
        return strip
