"""The style of all figures, and their PNG and SVG files. Imports matplotlib: import it late."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from swarm_ctl.files import replacing
from swarm_ctl.station.picture.colours import COLOURS

Floats = NDArray[np.float64]

_DASHES: Final = ("-", "--", ":", "-.")
"""Colours repeat with other ones."""
_STYLE: Final[Any] = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "svg.fonttype": "none",
    "svg.hashsalt": "swarm_ctl",
    "figure.dpi": 100,
}
_UNDATED: Final = {"Date": None}

DPI: Final = 300
"""What print asks for."""
R_IN, R_OUT = r"r_\mathrm{in}", r"r_\mathrm{out}"


def figure(title: str, width: float = 5.2, height: float = 3.2) -> tuple[Figure, Axes]:
    """A figure with one pair of axes; sizes in inches. Legible at 3.5, a column of a paper."""
    with mpl.rc_context(_STYLE):
        made = Figure(figsize=(width, height), layout="constrained")
        axes = made.subplots()
        axes.set_title(title, fontsize=10, loc="left")
    return made, axes


def line_style(k: int) -> dict[str, Any]:
    """Colour and dashes of the k-th line."""
    return {
        "color": COLOURS[k % len(COLOURS)],
        "linestyle": _DASHES[k // len(COLOURS) % len(_DASHES)],
    }


def save(made: Figure, folder: Path, name: str) -> list[Path]:
    """Write `name`.png and `name`.svg; where they are."""
    paths = [folder / f"{name}.{kind}" for kind in ("png", "svg")]
    _lay_out(made)
    for path in paths:
        write(made, path)
    return paths


def _lay_out(made: Figure) -> None:
    """Once, for both files. Where a figure has a layout still to come, matplotlib draws it once
    more for each file, to no avail."""
    with mpl.rc_context(_STYLE):
        made.set_dpi(DPI)
        engine = made.get_layout_engine()
        if engine is not None:
            engine.execute(made)
            made.set_layout_engine(None)


def write(made: Figure, path: Path) -> None:
    """Write one file, of the kind that its name ends in."""
    with mpl.rc_context(_STYLE):
        kind = path.suffix[1:]
        with replacing(path) as file:
            made.savefig(file, format=kind, dpi=DPI, metadata=_UNDATED if kind == "svg" else None)


def grid(
    title: str,
    rows: int,
    columns: int,
    width: float,
    height: float,
    *,
    share_x: bool = True,
    share_y: bool = False,
) -> tuple[Figure, list[Axes]]:
    """A figure with several axes, row by row, that share their time unless told otherwise."""
    with mpl.rc_context(_STYLE):
        made = Figure(figsize=(width, height), layout="constrained")
        panels = made.subplots(rows, columns, sharex=share_x, sharey=share_y, squeeze=False)
        made.suptitle(title, fontsize=10, x=0.01, ha="left")
    return made, list(panels.ravel())


def legend(axes: Axes, count: int, what: str = "") -> None:
    """Beside the axes; many entries in columns."""
    if count:
        axes.legend(
            loc="center left",
            bbox_to_anchor=(1.0, 0.5),
            ncols=1 + (count - 1) // 16,
            columnspacing=0.8,
            handlelength=1.4,
            frameon=False,
            fontsize=9,
            title=what or None,
            title_fontsize=9,
        )


def bounds(axes: Axes, lines: Sequence[tuple[str, float]]) -> None:
    """Horizontal bounds with their names, as mathematics, above their right ends."""
    for name, value in lines:
        axes.axhline(value, color="#B00020", linewidth=1.0, linestyle=(0, (4, 3)))
        axes.annotate(
            f"${name}$",
            (1.0, value),
            xycoords=("axes fraction", "data"),
            xytext=(-2, 3),
            textcoords="offset points",
            ha="right",
            fontsize=10,
            color="#B00020",
        )


def broken(time: Floats, values: Floats, gap: float) -> tuple[Floats, Floats]:
    """The same curve with a hole wherever more than `gap` lies between two points."""
    holes = np.nonzero(np.diff(time) > gap)[0] + 1
    return np.insert(time, holes, np.nan), np.insert(values, holes, np.nan)


def log_ticks(axes: Axes) -> None:
    """A logarithmic y axis with plain numbers, also where it spans only a decade or two."""
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def same_scale(figures: Sequence[Figure]) -> None:
    """The same y axes in all of them, where they have as many and they are not maps."""
    for panels in zip(*(made.axes for made in figures), strict=False):
        if not any(axes.get_aspect() == 1.0 for axes in panels):
            lows, highs = zip(*(axes.get_ylim() for axes in panels), strict=True)
            for axes in panels:
                axes.set_ylim(min(lows), max(highs))


def trajectories(
    axes: Axes,
    tracks: Floats,
    names: Sequence[str],
    links: Sequence[tuple[int, int]] = (),
    unit: str = "units",
    inks: Sequence[int] | None = None,
) -> None:
    """Tracks (T, 2, n) (north, east) from above: hollow at the start, filled at the end, names
    beside the starts, the final shape dotted. `inks`: the number of each one's colour.
    """
    width, start_size, end_size, font = (0.8, 4, 4, 7) if len(names) > 12 else (1.2, 6, 7, 9)
    for k, name in enumerate(names):
        colour = line_style(k if inks is None else inks[k])["color"]
        north, east = tracks[:, :, k].T
        start = (east[0], north[0])
        axes.plot(east, north, linewidth=width, color=colour, label=name)
        axes.plot(*start, "o", markersize=start_size, markerfacecolor="white", color=colour)
        axes.plot(east[-1], north[-1], "o", markersize=end_size, color=colour)
        axes.annotate(name, start, xytext=(4, 4), textcoords="offset points", fontsize=font)
    dotted: dict[str, Any] = {"color": "#555555", "linewidth": 0.9, "linestyle": ":", "zorder": 0}
    for i, j in links:
        axes.plot(tracks[-1, 1, [i, j]], tracks[-1, 0, [i, j]], **dotted)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"east [{unit}]")
    axes.set_ylabel(f"north [{unit}]")


def hull_order(points: Floats) -> list[tuple[int, int]]:
    """Pairs of the points (2, n) that are about as close as the closest: a shape's outline."""
    apart = np.hypot(*(points[:, :, None] - points[:, None]))
    np.fill_diagonal(apart, np.inf)
    close = np.argwhere(np.triu(apart < 1.1 * apart.min()))
    return [(int(i), int(j)) for i, j in close]
