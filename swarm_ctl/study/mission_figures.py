"""Figures of single missions: the paper's, and a row's. Imports matplotlib: import it late."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke

from swarm_ctl.files import named
from swarm_ctl.report.page.drawing import (
    R_IN,
    R_OUT,
    Floats,
    bounds,
    broken,
    figure,
    hull_order,
    legend,
    line_style,
    log_ticks,
    save,
    trajectories,
)
from swarm_ctl.study.batch.batch import Batch
from swarm_ctl.study.rerun import Rerun, Trace

_FRAMES: Final = 120
_OUTLINE: Final = (withStroke(linewidth=3.0, foreground="black"),)
"""Keeps a line visible on a cloud of dots of its own colour."""


def agent_names(n: int) -> list[str]:
    """1, 2, 3 ... as the paper counts."""
    return [str(k + 1) for k in range(n)]


def draw_mission(flown: Rerun, path: Path) -> None:
    """A row's tracks as a picture, or as an animation where the name ends in .gif."""
    title = f"row {flown.batch.row[0]}: smallest distance {flown.row['smallest_units']:.2f}, " + (
        f"formed after {flown.row['time_s']:.1f} s" if flown.row["converged"] else "not formed"
    )
    if math.isfinite(to_silent := flown.row["smallest_silent_units"]):
        title += f"\nsmallest distance to a vehicle that fell silent (×): {to_silent:.2f}"
    made, axes = figure(title, 5.2, 4.8)
    tracks = flown.trace.positions()
    trajectories(axes, tracks, agent_names(tracks.shape[2]), hull_order(flown.batch.slots[..., 0]))
    _draw_wood(flown.batch, axes)
    _draw_deaths(flown, axes)
    if path.suffix != ".gif":
        with named(path):
            made.savefig(path, dpi=150)
        return
    chosen = np.unique(np.linspace(0, len(tracks) - 1, _FRAMES).astype(int))
    radius = flown.batch.cell.law.r_out / 2
    dots = [
        Circle(p[::-1], radius, alpha=0.35, color=line_style(k)["color"])
        for k, p in enumerate(tracks[0].T)
    ]
    for dot in dots:
        axes.add_patch(dot)

    def show(frame: int) -> list[Circle]:
        for k, dot in enumerate(dots):
            dot.center = (tracks[frame, 1, k], tracks[frame, 0, k])
        return dots

    moving = FuncAnimation(made, show, frames=chosen.tolist())
    with named(path):
        moving.save(path, writer=PillowWriter(fps=20))


def _draw_deaths(flown: Rerun, axes: Axes) -> None:
    """Where each agent fell silent."""
    time_s, tracks = flown.trace.time_s, flown.trace.positions()
    for k, silent_s in enumerate(flown.batch.silent_s[:, 0].tolist()):
        if silent_s <= time_s[-1]:
            north, east = tracks[np.searchsorted(time_s, silent_s), :, k]
            axes.plot(east, north, "x", color="black", markersize=8, zorder=6)


def _draw_wood(batch: Batch, axes: Axes) -> None:
    """Trunks, and the way that all follow."""
    wood = batch.woods[0]
    if wood is None:
        return
    for at, radius in zip(wood.at.tolist(), wood.radius.tolist(), strict=True):
        axes.add_patch(Circle((at.imag, at.real), radius, color="#3b7d3b", alpha=0.6, zorder=0))
    way = wood.way_m / batch.cell.unit_m
    axes.plot(way.imag, way.real, "--", linewidth=1.0, color="#555555", zorder=1)
    axes.relim()


def start_picture(batch: Batch, folder: Path, name: str, title: str) -> None:
    """Where the agents start, their links, and their avoidance regions (Fig. 7)."""
    made, axes = figure(title, 5.0, 4.4)
    starts = batch.starts[..., 0]
    for i, j in np.argwhere(np.triu(batch.links[..., 0])):
        axes.plot(starts[1, [i, j]], starts[0, [i, j]], color="#888888", linewidth=0.9)
    for k in range(starts.shape[1]):
        colour = line_style(k)["color"]
        place, radius = (starts[1, k], starts[0, k]), batch.cell.law.r_out
        axes.add_patch(Circle(place, radius, fill=False, color=colour, alpha=0.4))
        axes.plot(*place, "o", color=colour)
        axes.annotate(str(k + 1), place, xytext=(5, 5), textcoords="offset points")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("y [units]")
    axes.set_ylabel("x [units]")
    save(made, folder, name)


def track_picture(batch: Batch, trace: Trace, folder: Path, name: str, title: str) -> None:
    """Tracks from start to shape (Figs. 8, 13)."""
    made, axes = figure(title, 5.2, 4.6)
    tracks = trace.positions()
    trajectories(axes, tracks, agent_names(tracks.shape[2]), hull_order(batch.slots[..., 0]))
    axes.set_xlabel("y [units]")
    axes.set_ylabel("x [units]")
    save(made, folder, name)


def distance_picture(
    batch: Batch, trace: Trace, iterations: Floats, folder: Path, name: str, title: str
) -> None:
    """Each agent's distance to its nearest, over iterations (Figs. 9, 14)."""
    made, axes = figure(title)
    nearest = nearest_distances(trace.positions())
    _lines(axes, iterations, nearest, agent_names(nearest.shape[1]))
    bounds(axes, [(R_IN, batch.cell.law.r_in), (R_OUT, batch.cell.law.r_out)])
    axes.set_ylim(bottom=0)
    axes.set_ylabel("nearest agent [units]")
    save(made, folder, name)


def nearest_distances(tracks: Floats) -> Floats:
    """(T, n) for tracks (T, 2, n)."""
    apart = np.hypot(*(tracks[:, :, :, None] - tracks[:, :, None]).transpose(1, 0, 2, 3))
    apart[:, np.arange(apart.shape[1]), np.arange(apart.shape[1])] = np.inf
    return np.asarray(apart.min(axis=-1))


def sigma_picture(
    trace: Trace, iteration_s: float, agents: Sequence[int], folder: Path, name: str, title: str
) -> None:
    """sigma_ij as the given agents (counted from 0) tune it while j is in their region (Figs. 10,
    15)."""
    made, axes = figure(title)
    wanted = sorted({(i, j) for _, i, j, *_ in trace.pairs if i in agents})
    for k, (i, j) in enumerate(wanted):
        seen = [(t, sigma) for t, a, b, _, sigma, _, _ in trace.pairs if (a, b) == (i, j)]
        rows = np.array(seen) / (iteration_s, 1.0)
        label = f"$\\sigma_{{{i + 1},{j + 1}}}$"
        curve = broken(rows[:, 0], rows[:, 1], 1.5)
        axes.plot(*curve, marker=".", markersize=2.5, linewidth=1.0, label=label, **line_style(k))
    log_ticks(axes)
    axes.set_xlabel("iteration")
    axes.set_ylabel("$\\sigma$")
    if wanted and len(wanted) <= 32:
        legend(axes, len(wanted))
    save(made, folder, name)


def error_picture(
    batch: Batch, trace: Trace, iterations: Floats, axis: int, folder: Path, name: str, title: str
) -> None:
    """e_i in one coordinate, over iterations (Figs. 11, 12, 16, 17)."""
    made, axes = figure(title)
    error = trace.positions()[:, axis] - batch.slots[axis, :, 0]
    _lines(axes, iterations, error, agent_names(error.shape[1]))
    axes.set_ylabel(f"$e_{'xy'[axis]}$ [units]")
    save(made, folder, name)


def sigma_against_distance(
    samples: list[tuple[str, Floats]], bounds_of: list[tuple[float, float]], folder: Path, name: str
) -> None:
    """All tuned sigmas against the distance at which they were tuned, with the median per bin."""
    made, axes = figure("$\\sigma$ against distance, every near pair of many missions")
    for k, ((label, points), (r_in, r_out)) in enumerate(zip(samples, bounds_of, strict=True)):
        if not len(points):
            continue
        share = (points[:, 0] - r_in) / (r_out - r_in)
        style = {"color": line_style(k)["color"]}
        axes.plot(share, points[:, 1], ".", markersize=1.0, alpha=0.15, rasterized=True, **style)
        edges = np.linspace(max(share.min(), 0.0), 1.0, 16)
        place = np.digitize(share, edges)
        filled = [b for b in range(1, 16) if np.count_nonzero(place == b) > 5]
        middle = [(edges[b - 1] + edges[min(b, 15)]) / 2 for b in filled]
        medians = [np.median(points[place == b, 1]) for b in filled]
        named = f"{label}, median"
        axes.plot(middle, medians, "o-", label=named, path_effects=_OUTLINE, zorder=5, **style)
    log_ticks(axes)
    axes.set_xlabel(f"$(x - {R_IN}) / ({R_OUT} - {R_IN})$: 0 at ${R_IN}$, 1 at ${R_OUT}$")
    axes.set_ylabel("$\\sigma$")
    made.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    save(made, folder, name)


def _lines(axes: Axes, iterations: Floats, values: Floats, names: Sequence[str]) -> None:
    for k, name in enumerate(names):
        axes.plot(iterations, values[:, k], linewidth=1.0, label=name, **line_style(k))
    axes.set_xlabel("iteration")
    if len(names) <= 12:
        legend(axes, len(names))
