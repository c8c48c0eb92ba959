"""A drawing of braille dots (2 x 4 in a cell) under words; made anew for every picture, in
numpy."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt
from rich.segment import Segment

from swarm_ctl.station.dashboard.drawing.styled_line import StyledLine, style

_BITS: Final = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], dtype=np.uint8)
"""By (row, column) within a cell."""
Floats = npt.NDArray[np.float64]


class Canvas:
    """`width` x `height` cells. What is drawn later gives a cell its colour; words lie over all
    dots."""

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self._dots = np.zeros((height, width), dtype=np.uint8)
        self._ink = np.zeros((height, width), dtype=np.int16)
        self._names = [""]
        self._clicks = [""]
        self._words: dict[tuple[int, int], tuple[str, int]] = {}

    def dots(self, x: Floats, y: Floats, name: str) -> None:
        """Dots at (column, row) in dot coordinates (2 and 4 to a cell); those outside are left
        out."""
        column, row = np.rint(x).astype(np.intp), np.rint(y).astype(np.intp)
        inside = (column >= 0) & (column < 2 * self.width) & (row >= 0) & (row < 4 * self.height)
        column, row = column[inside], row[inside]
        cells = (row // 4, column // 2)
        np.bitwise_or.at(self._dots, cells, _BITS[row % 4, column % 2])
        self._ink[cells] = self._number(name, "")

    def line(
        self, a: tuple[float, float], b: tuple[float, float], name: str, every: float = 1.0
    ) -> None:
        """A straight line between two points in dot coordinates, a dot every so many."""
        steps = max(1, round(max(abs(b[0] - a[0]), abs(b[1] - a[1])) / every))
        share = np.linspace(0.0, 1.0, steps + 1)
        self.dots(a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), name)

    def circle(self, centre: tuple[float, float], radius: float, name: str) -> None:
        count = max(8, round(3.0 * radius))
        angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
        self.dots(centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle), name)

    def words(self, column: int, row: int, words: str, name: str, click: str = "") -> None:
        """One-cell characters from a cell on; those outside are left out."""
        ink = self._number(name, click)
        for k, character in enumerate(words):
            if 0 <= column + k < self.width and 0 <= row < self.height:
                self._words[row, column + k] = character, ink

    def _number(self, name: str, click: str) -> int:
        for k, known in enumerate(zip(self._names, self._clicks, strict=True)):
            if known == (name, click):
                return k
        self._names.append(name)
        self._clicks.append(click)
        return len(self._names) - 1

    def lines(self) -> list[StyledLine]:
        """All rows, from the top."""
        signs = np.where(self._dots > 0, 0x2800 + self._dots.astype(np.int32), ord(" "))
        ink = np.where(self._dots > 0, self._ink, 0)
        for (row, column), (character, number) in self._words.items():
            signs[row, column] = ord(character)
            ink[row, column] = number
        styles = [style(name, click) for name, click in zip(self._names, self._clicks, strict=True)]
        lines = []
        for row in range(self.height):
            text = "".join(map(chr, signs[row].tolist()))
            cuts = [0, *(np.flatnonzero(np.diff(ink[row])) + 1).tolist(), self.width]
            inks = ink[row].tolist()
            segments = [Segment(text[a:b], styles[inks[a]]) for a, b in pairwise(cuts)]
            lines.append(StyledLine.of(segments, self.width))
        return lines
