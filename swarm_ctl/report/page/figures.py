"""The figures of a run, each from its `History`; None where the run left nothing to draw. Imports
matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from swarm_ctl.core.law.planned_formation import planned_formations
from swarm_ctl.core.model.plan import FormStep
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
from swarm_ctl.report.page.flight_history import History

_SHOWN: Final = 12
"""Agents with a panel of their own, at most."""
_SIGMA_GAP_S: Final = 1.0
"""A pair that was not told for this long was not active: reports come at 5 Hz."""
_NAMED: Final = 32
"""Lines with a name in a legend, at most."""


def tracks(history: History) -> Figure | None:
    """From above, start hollow, end filled, the shape dotted."""
    flight = history.flight
    flown = flight.live.any(axis=1) & (flight.time_s <= history.run.landing_s())
    if not flown.any():
        return None
    made, axes = figure("Trajectories: start hollow, end of formation flight filled", 5.2, 4.6)
    points = flight.points_m[flown].transpose(0, 2, 1)
    trajectories(axes, points, [str(i) for i in history.agents], _shape(history), unit="m")
    return made


def _shape(history: History) -> list[tuple[int, int]]:
    """Pairs of agents that are next to each other in the last shape that was flown."""
    begun = [
        k for k in range(1, len(history.plan.steps) + 1) if np.isfinite(history.run.start_s(k))
    ]
    formation = planned_formations(history.plan)[max(begun, default=0)]
    return hull_order(np.array(formation.offsets).T) if formation.formed else []


def nearest(history: History) -> Figure | None:
    """Each agent's distance to its nearest."""
    values = history.nearest()
    if not np.isfinite(values).any():
        return None
    made, axes = figure("Distance to the nearest vehicle, while flying (truth)")
    _per_agent(axes, history, values)
    law, unit_m = history.plan.law, history.plan.unit_m
    bounds(axes, [(R_IN, law.r_in * unit_m), (R_OUT, law.r_out * unit_m)])
    axes.set_ylim(bottom=0)
    axes.set_ylabel("distance [m]")
    return made


def sigma(history: History) -> Figure | None:
    """sigma of every pair that came into the avoidance region."""
    pairs = sorted(history.heard.sigmas.items())
    if not pairs:
        return None
    made, axes = figure("$\\sigma$ of each active pair: $i$-$j$ as agent $i$ tunes it")
    for k, ((i, j), rows) in enumerate(pairs):
        numbers = np.array(rows)
        curve = broken(numbers[:, 0], numbers[:, 2], _SIGMA_GAP_S)
        axes.plot(
            *curve, marker=".", markersize=4, linewidth=0.8, label=f"{i}-{j}", **line_style(k)
        )
    log_ticks(axes)
    axes.set_xlabel("mission time [s]")
    axes.set_ylabel("$\\sigma$")
    _name(axes, len(pairs), "pair")
    return made


def error(axis: int) -> Callable[[History], Figure | None]:
    """e_i in one coordinate: 0 is x (north), 1 is y (east)."""

    def draw(history: History) -> Figure | None:
        values = history.errors()[..., axis]
        if not np.isfinite(values).any():
            return None
        name = f"$e_{'xy'[axis]}$"
        made, axes = figure(
            f"Formation error {name} ({('north', 'east')[axis]}): equal where the shape stands"
        )
        _per_agent(axes, history, values)
        axes.set_ylabel(f"{name} [m]")
        return made

    return draw


def links(history: History) -> Figure | None:
    """Length of each link of the start graph."""
    values = history.lengths()
    if not np.isfinite(values).any():
        return None
    made, axes = figure("Length of each link (truth)")
    for k, (i, j) in enumerate(history.links):
        axes.plot(
            history.flight.time_s, values[:, k], linewidth=1.0, label=f"{i}-{j}", **line_style(k)
        )
    bounds(axes, [("r", history.plan.law.r * history.plan.unit_m)])
    axes.set_xlabel("mission time [s]")
    axes.set_ylabel("length [m]")
    _name(axes, len(history.links), "link")
    return made


def mesh(history: History) -> Figure | None:
    """Age of the oldest news, and loss, as each agent sees its peers."""
    statuses = {
        i: [s for s in found if s.links] for i, found in sorted(history.heard.statuses.items())
    }
    if not any(statuses.values()):
        return None
    made, (age, loss) = grid("Links of the mesh, as each agent hears them", 2, 1, 5.2, 4.2)
    for k, (agent, found) in enumerate(statuses.items()):
        times = [s.time_s for s in found]
        ages = [max((link.age_s or 0.0 for link in s.links.values()), default=0.0) for s in found]
        heard = [sum(link.received for link in s.links.values()) for s in found]
        lost = [sum(link.lost for link in s.links.values()) for s in found]
        age.plot(times, ages, linewidth=1.0, label=str(agent), **line_style(k))
        shares = [100.0 * gone / max(gone + got, 1) for gone, got in zip(lost, heard, strict=True)]
        loss.plot(times, shares, linewidth=1.0, **line_style(k))
    age.set_ylabel("oldest news [s]")
    loss.set_ylabel("lost so far [%]")
    loss.set_xlabel("mission time [s]")
    age.set_ylim(bottom=0)
    loss.set_ylim(bottom=0)
    _name(age, len(statuses), "agent")
    return made


def ticks(history: History) -> Figure | None:
    """How late the control loops were: median and 99th percentile so far, and overruns."""
    statuses = sorted(history.heard.statuses.items())
    if not statuses:
        return None
    made, (late, over) = grid(
        "Control loop, so far (thin: median, thick: 99th percentile)", 2, 1, 5.2, 4.2
    )
    for k, (agent, found) in enumerate(statuses):
        times = [s.time_s for s in found]
        late.plot(times, [s.tick.late_p50_ms for s in found], linewidth=0.6, **line_style(k))
        late.plot(
            times,
            [s.tick.late_p99_ms for s in found],
            linewidth=1.4,
            label=str(agent),
            **line_style(k),
        )
        over.plot(times, [s.tick.overruns for s in found], linewidth=1.0, **line_style(k))
    late.set_ylabel("late [ms, wall clock]")
    over.set_ylabel("ticks skipped")
    over.set_xlabel("mission time [s]")
    _name(late, len(statuses), "agent")
    return made


def speeds(history: History) -> Figure | None:
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
            axes.plot(
                times, [s.velocity_ned_mps[axis] for s in states], linewidth=1.0, color=colour
            )
            axes.plot(
                times, [s.setpoint_mps[axis] for s in states], "--", linewidth=0.8, color=colour
            )
        axes.set_title(f"agent {agent}", fontsize=8, loc="left")
    for axis, name in enumerate(("north", "east")):
        panels[0].plot([], [], color=line_style(axis)["color"], label=name)
    made.legend(loc="outside upper right", ncols=2, frameon=False, fontsize=9)
    made.supxlabel("mission time [s]", fontsize=10)
    made.supylabel("velocity [m/s]", fontsize=10)
    for axes in panels[len(shown) :]:
        axes.set_visible(False)
    return made


FIGURES: Final[tuple[tuple[str, Callable[[History], Figure | None]], ...]] = (
    ("trajectories", tracks),
    ("min-distance", nearest),
    ("sigma", sigma),
    ("error-x", error(0)),
    ("error-y", error(1)),
    ("links", links),
    ("mesh", mesh),
    ("ticks", ticks),
    ("velocity", speeds),
)
"""Name and function of every figure, in the order of the report."""


def overlay(histories: Sequence[History]) -> Figure:
    """Smallest distance and formation error of several runs in one figure, time counted from the
    first form step."""
    made, (near, away) = grid("Smallest distance and formation error", 2, 1, 7.0, 4.8)
    for k, history in enumerate(histories):
        start_s = _first_form(history)
        times = history.flight.time_s - start_s
        errors = history.errors()
        deviation = np.linalg.norm(errors - _mean(errors), axis=-1)
        near.plot(
            times, _least(history.nearest()), linewidth=1.2, label=history.name, **line_style(k)
        )
        away.plot(times, -_least(-deviation), linewidth=1.2, **line_style(k))
    near.set_ylabel("smallest distance [m]")
    near.set_ylim(bottom=0)
    log_ticks(away)
    away.set_ylabel("largest $|e - \\bar{e}|$ [m]")
    away.set_xlabel("mission time since the first form step [s]")
    made.legend(loc="outside lower center", frameon=False, fontsize=9)
    return made


def _first_form(history: History) -> float:
    starts = [
        history.run.start_s(k)
        for k, s in enumerate(history.plan.steps, 1)
        if isinstance(s, FormStep)
    ]
    found = min(starts, default=np.inf)
    return found if np.isfinite(found) else 0.0


def _mean(values: Floats) -> Floats:
    there = np.isfinite(values)
    count = np.maximum(there.sum(axis=1, keepdims=True), 1)
    return np.asarray(np.where(there, values, 0.0).sum(axis=1, keepdims=True) / count)


def _least(values: Floats) -> Floats:
    """The least number of each row (T, n); nan where there is none."""
    least = np.where(np.isnan(values), np.inf, values).min(axis=1, initial=np.inf)
    return np.where(np.isfinite(least), least, np.nan)


def _per_agent(axes: Axes, history: History, values: Floats) -> None:
    for k, agent in enumerate(history.agents):
        axes.plot(
            history.flight.time_s, values[:, k], linewidth=1.0, label=str(agent), **line_style(k)
        )
    axes.set_xlabel("mission time [s]")
    _name(axes, len(history.agents), "agent")


def _name(axes: Axes, count: int, what: str) -> None:
    if count <= _NAMED:
        legend(axes, count, what)
