"""A mission as a picture: starts, shapes, path, graph, fence. The one module that imports
matplotlib (extra `plot`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from swarm_ctl.core.agent.progress import step_name
from swarm_ctl.core.law import graph
from swarm_ctl.core.model.plan import FormStep, MoveStep, Plan
from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.forecast import Whereabouts


def plot(plan: Plan, file: Path) -> None:
    """Draw `plan` into `file` (.png, .svg, .pdf)."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(9, 9))
    try:
        _draw(plan, axes)
        figure.savefig(file, dpi=120, bbox_inches="tight")
    except (OSError, ValueError) as error:
        raise InputError(
            f"--plot {file}: {error}; allowed: a .png, .svg or .pdf that can be written"
        ) from None
    finally:
        pyplot.close(figure)


def _draw(plan: Plan, axes: Any) -> None:
    unit = plan.unit_m
    starts = {agent.id: (agent.start[0] * unit, agent.start[1] * unit) for agent in plan.agents}
    links = {agent.id: agent.neighbours for agent in plan.agents}
    for i, j in graph.edges(links):
        axes.plot(
            [starts[i][1], starts[j][1]],
            [starts[i][0], starts[j][0]],
            color="0.8",
            lw=0.8,
            zorder=1,
        )
    axes.scatter(
        [p[1] for p in starts.values()],
        [p[0] for p in starts.values()],
        c="k",
        label="starts",
        zorder=3,
    )
    for agent, (north, east) in starts.items():
        axes.annotate(str(agent), (east, north), textcoords="offset points", xytext=(5, 5))
    _draw_steps(plan, axes)
    if plan.fence is not None and plan.fence.polygon_m:
        corners = [*plan.fence.polygon_m, plan.fence.polygon_m[0]]
        axes.plot([c[1] for c in corners], [c[0] for c in corners], "r--", lw=1, label="geofence")
    axes.set(title=plan.name, xlabel="east of the origin [m]", ylabel="north of the origin [m]")
    axes.set_aspect("equal")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")


def _draw_steps(plan: Plan, axes: Any) -> None:
    """Shapes are drawn where the centre is planned to be: the law alone keeps it only roughly."""
    where = Whereabouts.at_start(plan)
    for number, step in enumerate(plan.steps, start=1):
        before, where = where, where.after(step)
        if isinstance(step, MoveStep):
            way = [before.centre_m, *step.waypoints_m]
            axes.plot(
                [p[1] for p in way],
                [p[0] for p in way],
                "-",
                lw=1.5,
                label=f"{number} {step_name(plan, number)}",
            )
        elif isinstance(step, FormStep) or where.places_m().tolist() != before.places_m().tolist():
            places = where.places_m()
            axes.scatter(
                places[:, 1],
                places[:, 0],
                marker="x",
                label=f"{number} {step_name(plan, number)}",
                zorder=2,
            )
