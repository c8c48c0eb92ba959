"""Lines of a screen: styled words at fixed widths, gauges, sparklines. Colours are names of the
sixteen; the application turns them into those of its light or dark theme.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Final

from rich.cells import cell_len, set_cell_size
from rich.segment import Segment
from rich.style import Style

_BLOCKS: Final = "▁▂▃▄▅▆▇█"


@cache
def style(name: str, click: str = "") -> Style:
    """A style by its words (`bold red`); `click` is the action a mouse click on it means."""
    plain = Style.parse(name)
    return plain + Style(meta={"@click": click}) if click else plain


class Line:
    """One line, built from left to right."""

    def __init__(self, words: str = "", name: str = "", click: str = "") -> None:
        self.segments: list[Segment] = []
        self.width = 0
        if words:
            self.add(words, name, click)

    def add(self, words: str, name: str = "", click: str = "", *, size: int | None = None) -> Line:
        """Append words, cut or filled to `size` cells."""
        if size is not None:
            words = set_cell_size(words, size)
        self.segments.append(Segment(words, style(name, click)))
        self.width += cell_len(words)
        return self

    def put(self, other: Line) -> Line:
        """Append another line."""
        self.segments += other.segments
        self.width += other.width
        return self

    def to(self, column: int) -> Line:
        """Fill with blanks up to a column."""
        return self.add(" " * (column - self.width)) if column > self.width else self

    def fit(self, width: int, name: str = "") -> list[Segment]:
        """Exactly `width` cells, all of them on the background of `name`."""
        segments = Segment.adjust_line_length(self.segments, width)
        return list(Segment.apply_style(segments, style(name))) if name else segments

    @property
    def text(self) -> str:
        """The words alone."""
        return "".join(segment.text for segment in self.segments)


def right(words: str, size: int) -> str:
    """At the right end of `size` cells."""
    return " " * max(0, size - cell_len(words)) + set_cell_size(words, min(size, cell_len(words)))


def sparkline(values: Sequence[float], width: int, most: float | None = None) -> str:
    """The newest `width` values, oldest first, from 0 to `most` (their own largest where not
    given)."""
    shown = values[-width:]
    top = max([most or 0.0, *shown])
    if top <= 0.0:
        return ("▁" * len(shown)).ljust(width)
    return "".join(_BLOCKS[min(7, max(0, int(8 * value / top)))] for value in shown).ljust(width)


def gauge(share: float, width: int, marker: str = "┃", rail: str = "─") -> tuple[str, str, str]:
    """A rail with a marker at `share` (0..1): (before, marker, after), `width` cells in all."""
    place = round(min(1.0, max(0.0, share)) * (width - 1))
    return rail * place, marker, rail * (width - 1 - place)


def bar(share: float, width: int) -> str:
    """A bar filled up to `share` (0..1)."""
    filled = round(min(1.0, max(0.0, share)) * width)
    return "█" * filled + "░" * (width - filled)


def wrapped(words: Iterable[str], width: int, indent: int = 2) -> list[str]:
    """Words on as many lines as they need; all but the first are indented."""
    lines, line = [], ""
    for word in words:
        if line and cell_len(line) + 1 + cell_len(word) > width:
            lines.append(line)
            line = " " * indent + word
        else:
            line = f"{line} {word}" if line else word
    return [*lines, line] if line else lines
