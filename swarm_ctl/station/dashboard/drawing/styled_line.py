"""Styled words at fixed widths: lines, signs, numbers and gauges of the panels painted by hand.

Colours are names of the sixteen; the application turns them into those of its theme.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Final

from rich.cells import cell_len, set_cell_size
from rich.console import Console
from rich.segment import Segment
from rich.style import Style
from rich.text import Text

from swarm_ctl.station.picture.alarms import Level

WELL, WAITING, DASH = "✓", "…", "–"
SIGN: Final = {Level.WELL: WELL, Level.WAITING: WAITING, Level.WARNING: "!", Level.ERROR: "✗"}
LEVEL_STYLE: Final = {
    Level.WELL: "green",
    Level.WAITING: "cyan",
    Level.WARNING: "yellow",
    Level.ERROR: "bold red",
}
ALARM_STYLE: Final = {
    Level.WELL: "black on bright_green",
    Level.WAITING: "black on bright_cyan",
    Level.WARNING: "black on bright_yellow",
    Level.ERROR: "bold bright_white on red",
}
"""Where the ground says it: bars, and ids on the map, whose letters have their agents' colours."""
MARKED: Final = "bold magenta"
_BLOCKS: Final = "▁▂▃▄▅▆▇█"


@cache
def style(name: str, click: str = "") -> Style:
    """A style by its words (`bold red`); `click` is the action a mouse click on it means."""
    plain = Style.parse(name)
    return plain + Style(meta={"@click": click}) if click else plain


class StyledLine:
    """One line, built from left to right."""

    def __init__(self, words: str = "", name: str = "", click: str = "") -> None:
        self.segments: list[Segment] = []
        self.width = 0
        if words:
            self.add(words, name, click)

    @classmethod
    def of(cls, segments: list[Segment], width: int) -> StyledLine:
        """A line whose segments and width are known."""
        line = cls()
        line.segments, line.width = segments, width
        return line

    def add(self, words: str, name: str = "", click: str = "") -> StyledLine:
        """Append words."""
        self.segments.append(Segment(words, style(name, click)))
        self.width += cell_len(words)
        return self

    def put(self, other: StyledLine) -> StyledLine:
        self.segments += other.segments
        self.width += other.width
        return self

    def to(self, column: int) -> StyledLine:
        """Fill with blanks up to a column."""
        return self.add(" " * (column - self.width)) if column > self.width else self

    def fit(self, width: int, name: str = "") -> list[Segment]:
        """Exactly `width` cells, all of them on the background of `name`."""
        segments = Segment.adjust_line_length(self.segments, width)
        return list(Segment.apply_style(segments, style(name))) if name else segments

    def folded(self, console: Console, width: int) -> list[StyledLine]:
        """Itself, where it fits; else on as many lines as its words need."""
        if self.width <= width:
            return [self]
        words = Text.assemble(*((part.text, part.style or "") for part in self.segments))
        rows = words.wrap(console, max(8, width - 1))
        indent = Segment(" ")
        return [
            StyledLine.of([indent] * (k > 0) + list(row.render(console)), row.cell_len + (k > 0))
            for k, row in enumerate(rows)
        ]

    @property
    def text(self) -> str:
        return "".join(segment.text for segment in self.segments)


def level_line(level: Level, words: str) -> StyledLine:
    """A sentence with the sign and the colour of its level."""
    return StyledLine(f" {SIGN[level]} {words}", LEVEL_STYLE[level])


def right(words: str, size: int) -> str:
    """At the right end of `size` cells, cut if need be."""
    return " " * max(0, size - cell_len(words)) + set_cell_size(words, min(size, cell_len(words)))


def fit(value: float | None, width: int, decimals: int) -> str:
    """A number with as many of its decimals as fit into `width`; a dash for none."""
    if value is None:
        return DASH
    for decimals_left in range(decimals, -1, -1):
        text = f"{value:z.{decimals_left}f}"  # z: no -0.0
        if len(text) <= width:
            return text
    return "9" * (width - 1) + "+" if value > 0 else "-" * width


def blocks(values: Sequence[float], width: int, most: float) -> str:
    """The newest `width` values as blocks, oldest first, from 0 to at least `most`."""
    shown = values[-width:]
    top = max([most, *shown])
    return "".join(_BLOCKS[min(7, max(0, int(8 * value / top)))] for value in shown).ljust(width)


def gauge(share: float, width: int) -> tuple[str, str, str]:
    """A rail with a marker at `share` (0..1): (before, marker, after), `width` cells in all."""
    column = round(min(1.0, max(0.0, share)) * (width - 1))
    return "─" * column, "┃", "─" * (width - 1 - column)


def bar(share: float, width: int) -> str:
    """A bar filled up to `share` (0..1)."""
    filled = round(min(1.0, max(0.0, share)) * width)
    return "█" * filled + "░" * (width - filled)
