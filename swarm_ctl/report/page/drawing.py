"""How this project's figures look, and how they become PNG and SVG files. Imports matplotlib:
import it late."""

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

Floats = NDArray[np.float64]

COLOURS: Final = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#8C564B",
    "#7F7F7F",
    "#000000",
)
"""Told apart by colour-blind readers, too (Okabe and Ito), and repeated with other dashes."""
_DASHES: Final = ("-", "--", ":", "-.")
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


DPI: Final = 160
R_IN, R_OUT = r"r_\mathrm{in}", r"r_\mathrm{out}"


def figure(title: str, width: float = 5.2, height: float = 3.2) -> tuple[Figure, Axes]:
    """A figure with one pair of axes in the house's style [inches]: legible at 3.5, a column of a
    paper."""
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
    with mpl.rc_context(_STYLE):
        for path in paths:
            made.savefig(path, dpi=DPI, metadata={"Date": None} if path.suffix == ".svg" else None)
            made.set_layout_engine("none")  # laid out once, for both
    return paths


def grid(
    title: str, rows: int, columns: int, width: float, height: float, *, share_y: bool = False
) -> tuple[Figure, list[Axes]]:
    """A figure with several axes, row by row, that share their time."""
    with mpl.rc_context(_STYLE):
        made = Figure(figsize=(width, height), layout="constrained")
        panels = made.subplots(rows, columns, sharex=True, sharey=share_y, squeeze=False)
        made.suptitle(title, fontsize=10, x=0.01, ha="left")
    return made, list(panels.ravel())


def legend(axes: Axes, count: int, what: str = "") -> None:
    """Beside the axes; many entries in columns."""
    if count:
        beside = axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), ncols=1 + (count - 1) // 16, fontsize=9,
                             handlelength=1.4, columnspacing=0.8)  # fmt: skip
        beside.set_frame_on(False)
        if what:
            beside.set_title(what)
            beside.get_title().set_fontsize(9)


def bounds(axes: Axes, lines: Sequence[tuple[str, float]]) -> None:
    """Horizontal bounds with their names, as mathematics, above their right ends."""
    for name, value in lines:
        axes.axhline(value, color="#B00020", linewidth=1.0, linestyle=(0, (4, 3)))
        axes.annotate(f"${name}$", (1.0, value), xycoords=("axes fraction", "data"), xytext=(-2, 3),
                      textcoords="offset points", ha="right", fontsize=10, color="#B00020")  # fmt: skip


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
            low, high = (
                min(axes.get_ylim()[0] for axes in panels),
                max(axes.get_ylim()[1] for axes in panels),
            )
            for axes in panels:
                axes.set_ylim(low, high)


def trajectories(
    axes: Axes,
    tracks: Floats,
    names: Sequence[str],
    links: Sequence[tuple[int, int]] = (),
    unit: str = "units",
) -> None:
    """Tracks (T, 2, n) (north, east) from above: hollow at the start, filled at the end, the final
    shape dotted.

    Names stand beside the starts.
    """
    small = len(names) > 12
    for k, name in enumerate(names):
        colour = line_style(k)["color"]
        axes.plot(
            tracks[:, 1, k],
            tracks[:, 0, k],
            linewidth=0.8 if small else 1.2,
            color=colour,
            label=name,
        )
        axes.plot(
            *tracks[0, ::-1, k],
            "o",
            markersize=4 if small else 6,
            markerfacecolor="white",
            color=colour,
        )
        axes.plot(*tracks[-1, ::-1, k], "o", markersize=4 if small else 7, color=colour)
        axes.annotate(
            name,
            (tracks[0, 1, k], tracks[0, 0, k]),
            xytext=(4, 4),
            textcoords="offset points",
            fontsize=7 if small else 9,
        )
    ends = tracks[-1]
    for i, j in links:
        axes.plot(
            ends[1, [i, j]],
            ends[0, [i, j]],
            color="#555555",
            linewidth=0.9,
            linestyle=":",
            zorder=0,
        )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"east [{unit}]")
    axes.set_ylabel(f"north [{unit}]")


def hull_order(points: Floats) -> list[tuple[int, int]]:
    """Each of the points (2, n) with its nearest others, as lines that show a shape."""
    apart = np.hypot(*(points[:, :, None] - points[:, None]))
    np.fill_diagonal(apart, np.inf)
    return [
        (int(i), int(j))
        for i, j in zip(*np.nonzero(apart < 1.1 * apart.min()), strict=True)
        if i < j
    ]
