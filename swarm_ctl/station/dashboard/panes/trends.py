"""How the swarm has been over the last minutes: the nearest pair, and the formation error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from swarm_ctl.station.dashboard.drawing.canvas import Canvas
from swarm_ctl.station.dashboard.drawing.picture import Picture
from swarm_ctl.station.dashboard.drawing.styled_line import StyledLine, fit
from swarm_ctl.station.picture.journal import TREND_S

LEAST_ROWS, MOST_ROWS = 10, 16
"""Of both strips: a title and a curve each."""
_SPANS_S: Final = (60.0, 120.0, TREND_S)
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

    def dot(time_s: float, value: float) -> tuple[float, float]:
        return wide * (1.0 - (now_s - time_s) / span_s), high * (1.0 - value / top)

    if bound is not None:
        canvas.line(dot(now_s - span_s, bound[1]), dot(now_s, bound[1]), "red dim", every=4.0)
    before: tuple[float, float] | None = None
    for time_s, value in points:
        if value is None:
            before = None
            continue
        if before is None or time_s - before[0] > _GAP_S:
            x, y = dot(time_s, value)
            canvas.dots(np.array([x]), np.array([y]), "")
        else:
            canvas.line(dot(*before), dot(time_s, value), "")
        before = time_s, value
    canvas.words(1, 0, f"{top:.3g} m", "dim")
    canvas.words(1, rows - 1, "0", "dim")
    head = StyledLine(f" {title}, last {span_s:g} s", "bold dim").add(
        f"  {fit(newest, 5, 2)} m", "bold"
    )
    if bound is not None:
        head.add(f"  {bound[0]} {bound[1]:g} m", "red")
    return [head, *canvas.lines()]
