"""A mission as a picture: starts, shapes, path, graph, zones, fence."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from swarm_ctl.core.law import graph
from swarm_ctl.core.model.geometry import mean_of
from swarm_ctl.core.model.plan import EVERYONE, Plan, PlannedStep, Point
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.errors import InputError


def plot(plan: Plan, file: Path) -> None:
    """Draw `plan` into `file` (.png, .svg, .pdf)."""
    from swarm_ctl.report.page.drawing import figure, write

    made, axes = figure(plan.name, 7.5, 6.0)
    _draw(plan, axes)
    try:
        write(made, file)
    except ValueError as error:
        raise InputError(f"--plot {file}: {error}; allowed: a .png, .svg or .pdf") from None


def _draw(plan: Plan, axes: Any) -> None:
    start = PlannedFormation.at_start([agent.start for agent in plan.agents], plan.unit_m)
    starts = dict(zip((agent.id for agent in plan.agents), start.places_m(), strict=True))
    for i, j in graph.edges({agent.id: agent.neighbours for agent in plan.agents}):
        axes.plot(*_east_north([starts[i], starts[j]]), color="0.8", lw=0.8, zorder=1)
    axes.scatter(*_east_north(starts.values()), c="k", s=14, label="starts", zorder=3)
    for agent, (north, east) in starts.items():
        beside = {"textcoords": "offset points", "xytext": (3, 3), "fontsize": "small"}
        axes.annotate(str(agent), (east, north), **beside)
    _draw_steps(plan, axes)
    _draw_zones(plan, axes)
    if plan.fence is not None and plan.fence.polygon_m:
        corners = [*plan.fence.polygon_m, plan.fence.polygon_m[0]]
        axes.plot(*_east_north(corners), "r--", lw=1, label="geofence")
    axes.set(xlabel="east of the origin [m]", ylabel="north of the origin [m]")
    axes.set_aspect("equal")
    axes.legend(fontsize="small", loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)


def _draw_zones(plan: Plan, axes: Any) -> None:
    """Each with its name, and its heights where it has them."""
    for k, zone in enumerate(plan.zones):
        label = "zone" if k == 0 else None
        axes.fill(*_east_north(zone.outline_m), fc="r", ec="r", alpha=0.2, zorder=1, label=label)
        east, north = _east_north(zone.outline_m)
        low, high = zone.floor_m, zone.ceiling_m
        heights = "" if low is None else f" from {low:g} m"
        heights += "" if high is None else f" up to {high:g} m"
        middle, above = mean_of(zone.outline_m)[::-1], (0.5 * (min(east) + max(east)), max(north))
        axes.annotate(
            f"{zone.name}{heights}",
            above if zone.radius_m else middle,
            textcoords="offset points",
            xytext=(0, 2 if zone.radius_m else 0),
            ha="center",
            va="bottom" if zone.radius_m else "center",
            fontsize="small",
        )


def _draw_steps(plan: Plan, axes: Any) -> None:
    """Shapes are drawn where the centre is planned to be: the law alone keeps it only roughly. In a
    mission with groups each has a colour of its own, the whole swarm's is black."""
    from swarm_ctl.station.picture.colours import COLOURS

    names = dict.fromkeys(group.name for group in plan.groups if group.name != EVERYONE)
    colours = {EVERYONE: "k"} | dict(zip(names, itertools.cycle(COLOURS[:-1]), strict=False))
    for at in plan.all_steps():
        whose = f"{at.group.name}: " if names else ""
        own = COLOURS[(at.number - 1) % (len(COLOURS) - 1)]
        style = {"color": colours[at.group.name] if names else own}
        label = f"{whose}{at.number} {at.name}{'' if at.step.file is None else ' in file'}"
        if way_m := at.step.way_m:
            axes.plot(*_east_north([at.before.centre_m, *way_m]), lw=1.5, label=label, **style)
        elif at.step.new_shape is not None or at.step.spins:
            places = _east_north(at.after.places_m())
            axes.scatter(*places, marker="x", label=label, zorder=2, **style)
            if at.after.ups_m:
                _name_heights(at, axes)


def _name_heights(at: PlannedStep, axes: Any) -> None:
    """Of the slots of a step, beside each; those above each other in one line."""
    named: dict[Point, list[float]] = {}
    for north, east, height_m in sorted(
        (round(n, 1), round(e, 1), high)
        for (n, e), high in zip(at.after.places_m(), at.after.heights_m, strict=True)
    ):
        named.setdefault((east, north), []).append(height_m)
    for place, heights in named.items():
        words = f"{at.number}: {', '.join(f'{high:g}' for high in heights)} m high"
        below = (5, -4 - 9 * at.number)
        axes.annotate(words, place, textcoords="offset points", xytext=below, fontsize="x-small")


def _east_north(points_m: Iterable[Point]) -> tuple[list[float], list[float]]:
    """x and y of points (north, east)."""
    north, east = zip(*points_m, strict=True)
    return list(east), list(north)
