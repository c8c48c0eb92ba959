"""The figures of a run, each from its `RunHistory`; None: nothing to draw. Imports matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from swarm_ctl.core.model.text import printable
from swarm_ctl.core.swarm.snapshot import TRAFFIC
from swarm_ctl.report.page.drawing import (
    R_IN,
    R_OUT,
    Floats,
    bounds,
    broken,
    figure,
    grid,
    hull_order,
    legend,
    line_style,
    log_ticks,
    trajectories,
)
from swarm_ctl.report.page.player_parts import labels
from swarm_ctl.report.page.run_history import RunHistory, least
from swarm_ctl.station.picture.colours import inks

_SHOWN: Final = 12
"""Agents with a panel of their own, at most."""
_SIGMA_GAP_S: Final = 1.0
"""A pair without a report for this long was not active: reports come at 5 Hz."""
_NAMED: Final = 32
"""Lines with a name in a legend, at most; more are thin."""


def tracks(history: RunHistory) -> Figure | None:
    """From above, start hollow, end filled, the shape dotted."""
    flight = history.flight
    flown = flight.live.any(axis=1) & (flight.time_s <= history.run.landing_s())
    if not flown.any():
        return None
    made, axes = figure("Trajectories: start hollow, end of formation flight filled", 5.2, 4.6)
    points = flight.points_m[flown].transpose(0, 2, 1)
    shape, colours = _shape(history), inks(history.plan)
    trajectories(axes, points, labels(history.plan), shape, unit="m", inks=colours)
    return made


def _shape(history: RunHistory) -> list[tuple[int, int]]:
    """Pairs of agents that are adjacent in the last shape that their last group flew."""
    found = []
    last = (group for group in history.run.groups if group.start_s(group.plan.last + 1) == np.inf)
    for group in last:
        formation, at = group.newest_formation(history.plan.unit_m), group.columns
        pairs = hull_order(np.array(formation.offsets).T) if formation.formed else []
        found += [(at[i], at[j]) for i, j in pairs]
    return found


def nearest(history: RunHistory) -> Figure | None:
    """Each agent's distance to the nearest vehicle."""
    title = f"Distance to the nearest vehicle, while flying ({history.by})"
    law, unit_m = history.plan.law, history.plan.unit_m
    limits = [(R_IN, law.r_in * unit_m), (R_OUT, law.r_out * unit_m)]
    made = _lines(history, history.nearest(), history.agents, "agent", title, limits)
    if made is not None:
        made.axes[0].set(ylim=(0, None), ylabel="distance [m]")
    return made


def sigma(history: RunHistory) -> Figure | None:
    """sigma of each pair that came into the avoidance region."""
    pairs = sorted(history.heard.sigmas.items())
    if not pairs:
        return None
    made, axes = figure("$\\sigma$ of each active pair: $i$-$j$ as agent $i$ adapts it")
    for k, ((i, j), rows) in enumerate(pairs):
        numbers = np.array(rows)
        curve = broken(numbers[:, 0], numbers[:, 2], _SIGMA_GAP_S)
        style = {"marker": ".", "markersize": 4, "linewidth": 0.8, **line_style(k)}
        axes.plot(*curve, label=f"{i}-{'aircraft' if j == TRAFFIC else j}", **style)
    log_ticks(axes)
    axes.set_xlabel("mission time [s]")
    axes.set_ylabel("$\\sigma$")
    _name(axes, len(pairs), "pair")
    return made


def error(history: RunHistory) -> Figure | None:
    """How far each agent is from its place in the shape, wherever the shape stands."""
    away_m = history.deviations()
    if not np.isfinite(away_m).any():
        return None
    title = "Formation error: distance from the place in the shape"
    made, panels = _panels(title, ("north [m]", "east [m]"))
    for k, agent in enumerate(history.agents):
        style = {"linewidth": _width(len(history.agents)), **line_style(k)}
        for axes, values in zip(panels, away_m[:, k].T, strict=True):
            axes.plot(history.flight.time_s, values, label=str(agent), **style)
    _name(panels[0], len(history.agents), "agent")
    return made


def heights(history: RunHistory) -> Figure | None:
    """Of each agent, where the mission has several."""
    steps = (step for group in history.run.groups for step in group.plan.steps)
    if not any(form.ups_m for step in steps if (form := step.new_shape) is not None):
        return None
    up_m = np.where(history.flight.live, -history.flight.position_ned_m[..., 2], np.nan)
    title = f"Height above the origin ({history.by})"
    made = _lines(history, up_m, history.agents, "agent", title)
    if made is not None:
        made.axes[0].set_ylabel("height [m]")
    return made


def target(history: RunHistory) -> Figure | None:
    """How far the formation was from its places about its target, and how old the news was."""
    times, off_m = history.flight.time_s, history.off_targets()
    followed = np.isfinite(off_m).any(axis=1)
    if not followed.any():
        return None
    made, (off, age) = grid("Following: distance from the places about the target", 2, 1, 5.2, 4.2)
    shown = (times >= times[followed][0]) & (times <= times[followed][-1])
    for k, agent in enumerate(history.agents):
        off.plot(times[shown], off_m[shown, k], linewidth=0.8, label=str(agent), **line_style(k))
    seconds, first = np.unique(np.floor(times[shown]), return_index=True)
    age.margins(y=0.2)
    for track in history.targets():
        oldest_s = np.maximum.reduceat(track.at(times[shown])[1], first)
        age.step(seconds, oldest_s, where="post", linewidth=1.0, color="black")
    off.set(ylabel="off its place [m]", yscale="log", ylim=(0.03, None))
    age.set(ylabel="oldest news in a second [s]", xlabel="mission time [s]")
    age.set_ylim(bottom=0)
    _name(off, len(history.agents), "agent")
    return made


def links(history: RunHistory) -> Figure | None:
    """Length of each link of the start graph."""
    names = [f"{i}-{j}" for i, j in history.links]
    limits = [("r", history.plan.law.r * history.plan.unit_m)]
    title = f"Length of each neighbour link ({history.by})"
    made = _lines(history, history.lengths(), names, "link", title, limits)
    if made is not None:
        made.axes[0].set_ylabel("length [m]")
    return made


def mesh(history: RunHistory) -> Figure | None:
    """Age of the oldest state, and loss where there is any, as each agent hears its peers."""
    heard_of = sorted(history.heard.statuses.items())
    statuses = {i: [s for s in found if s.links] for i, found in heard_of}
    if not any(statuses.values()):
        return None
    ages, shares = [], []
    for found in statuses.values():
        ages.append([max((x.age_s or 0.0 for x in s.links.values()), default=0.0) for s in found])
        heard = [sum(link.received for link in s.links.values()) for s in found]
        lost = [sum(link.lost for link in s.links.values()) for s in found]
        shares.append(
            [100 * gone / max(gone + got, 1) for gone, got in zip(lost, heard, strict=True)]
        )
    told = {"oldest state [s]": ages, "lost so far [%]": shares}
    shown = {
        label: lines for label, lines in told.items() if label.startswith("old") or _any(lines)
    }
    made, panels = _panels("Mesh links, as each agent hears them", shown)
    for axes, lines in zip(panels, shown.values(), strict=True):
        for k, (agent, found) in enumerate(statuses.items()):
            times = [s.time_s for s in found]
            axes.plot(times, lines[k], linewidth=1.0, label=str(agent), **line_style(k))
        axes.set_ylim(bottom=0)
    _name(panels[0], len(statuses), "agent")
    return made


def ticks(history: RunHistory) -> Figure | None:
    """How late the control loops were, median and 99th percentile so far; overruns, where there
    are any."""
    statuses = sorted(history.heard.statuses.items())
    if not statuses:
        return None
    skipped = [[s.tick.overruns for s in found] for _, found in statuses]
    labels = ["late [ms, wall clock]", *(["ticks skipped"] if _any(skipped) else [])]
    made, panels = _panels("Control loop, so far (thin: median, thick: 99th percentile)", labels)
    for k, (agent, found) in enumerate(statuses):
        times, style = [s.time_s for s in found], line_style(k)
        p50, p99 = ([getattr(s.tick, f"late_p{p}_ms") for s in found] for p in (50, 99))
        panels[0].plot(times, p50, linewidth=0.6, **style)
        panels[0].plot(times, p99, linewidth=1.4, label=str(agent), **style)
        for axes in panels[1:]:
            axes.plot(times, skipped[k], linewidth=1.0, **style)
    _name(panels[0], len(statuses), "agent")
    return made


def speeds(history: RunHistory) -> Figure | None:
    """Commanded against achieved velocity, a panel per agent."""
    agents = sorted(history.heard.states)
    if not agents:
        return None
    shown = agents[:_SHOWN]
    rows = -(-len(shown) // 3)
    title = "Setpoint (dashed) against achieved velocity"
    if len(shown) < len(agents):
        title += f"; the first {_SHOWN} agents"
    made, panels = grid(title, rows, min(3, len(shown)), 9.0, 0.9 + 1.9 * rows, share_y=True)
    for axes, agent in zip(panels, shown, strict=False):
        states = history.heard.states[agent]
        times = [s.time_s for s in states]
        for axis in range(2):
            colour = line_style(axis)["color"]
            flown = [s.velocity_ned_mps[axis] for s in states]
            setpoints = [s.setpoint_mps[axis] for s in states]
            axes.plot(times, flown, linewidth=1.0, color=colour)
            axes.plot(times, setpoints, "--", linewidth=0.8, color=colour)
        axes.set_title(f"agent {agent}", fontsize=8, loc="left")
    for axis, name in enumerate(("north", "east")):
        panels[0].plot([], [], color=line_style(axis)["color"], label=name)
    made.legend(loc="outside upper right", ncols=2, frameon=False, fontsize=9)
    made.supxlabel("mission time [s]", fontsize=10)
    made.supylabel("velocity [m/s]", fontsize=10)
    for axes in panels[len(shown) :]:
        axes.set_visible(False)
    return made


FIGURES: Final[tuple[tuple[str, Callable[[RunHistory], Figure | None]], ...]] = (
    ("trajectories", tracks),
    ("min-distance", nearest),
    ("sigma", sigma),
    ("error", error),
    ("target", target),
    ("heights", heights),
    ("links", links),
    ("mesh", mesh),
    ("ticks", ticks),
    ("velocity", speeds),
)
"""Name and function of every figure, in the order of the report."""


def overlay(histories: Sequence[RunHistory]) -> Figure:
    """Smallest distance and formation error of several runs in one figure, time counted from the
    first form step."""
    count = len(histories)
    height = 4.4 + 0.2 * count  # a line of the legend each
    made, (near, away) = grid("Smallest distance and formation error", 2, 1, 7.0, height)
    known, broader = False, min(1.4, 7.0 / count)
    for k, history in enumerate(histories):
        times = history.flight.time_s - history.first_form_s()
        largest = -least(-np.linalg.norm(history.deviations(), axis=-1))
        known |= bool((largest > 0).any())
        # equal runs lie over each other: each one beneath is broader
        style = {"linewidth": 1.2 + broader * (count - 1 - k), **line_style(k)}
        name = printable(history.name).replace("$", r"\$")  # else matplotlib reads a formula
        near.plot(times, least(history.nearest()), label=name, **style)
        away.plot(times, largest, **style)
    near.set_ylabel("smallest distance [m]")
    near.set_ylim(bottom=0)
    if known:  # an axis without a positive number has no logarithm
        log_ticks(away)
    away.set_ylabel("largest $|e - \\bar{e}|$ [m]")
    away.set_xlabel("mission time since the first form step [s]")
    made.legend(loc="outside lower center", frameon=False, fontsize=9)
    return made


def _lines(
    history: RunHistory,
    values: Floats,
    names: Sequence[object],
    what: str,
    title: str,
    limits: Sequence[tuple[str, float]] = (),
) -> Figure | None:
    """A line for each column of `values` (T, names) over mission time; None without a number."""
    if not np.isfinite(values).any():
        return None
    made, axes = figure(title)
    for k, name in enumerate(names):
        style = {"linewidth": _width(len(names)), **line_style(k)}
        axes.plot(history.flight.time_s, values[:, k], label=str(name), **style)
    axes.set_xlabel("mission time [s]")
    _name(axes, len(names), what)
    bounds(axes, limits)
    return made


def _panels(title: str, labels: Collection[str]) -> tuple[Figure, list[Axes]]:
    """One above the other over mission time, each with its label."""
    made, panels = grid(title, len(labels), 1, 5.2, 1.1 + 1.55 * len(labels))
    for axes, label in zip(panels, labels, strict=True):
        axes.set_ylabel(label)
    panels[-1].set_xlabel("mission time [s]")
    return made, panels


def _any(lines: Iterable[Sequence[float]]) -> bool:
    """A line has another value than 0."""
    return any(any(line) for line in lines)


def _width(count: int) -> float:
    """Of so many lines."""
    return 1.0 if count <= _NAMED else 0.3


def _name(axes: Axes, count: int, what: str) -> None:
    if count <= _NAMED:
        legend(axes, count, what)
