"""How the swarm has been over the last minutes: the nearest pair, and the formation error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from swarm_ctl.station.dashboard.drawing.canvas import Canvas, Floats
from swarm_ctl.station.dashboard.drawing.picture import Picture
from swarm_ctl.station.dashboard.drawing.styled_line import StyledLine, fit
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
