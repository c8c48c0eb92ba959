"""`swarm-ctl validate`: check a mission and show what would be flown."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from swarm_ctl.core import graph
from swarm_ctl.core.formation import closest_pair
from swarm_ctl.core.plan import FormStep, HoldStep, Plan, Point, TakeoffStep
from swarm_ctl.core.response import stop_distance
from swarm_ctl.mission.loader import LoadedMission, load
from swarm_ctl.mission.rehearsal import FormForecast, rehearse


def validate(
    mission: Annotated[Path, typer.Argument(help="The mission file.")],
    fleet: Annotated[Path | None, typer.Option(help="A fleet file to use instead of the mission's.")] = None,
) -> None:
    """Check a mission file and show what would be flown: agents, graph, slots, distances, times, warnings."""
    loaded = load(mission, fleet=fleet)
    console = Console(highlight=False)
    show(loaded, rehearse(loaded.plan), console)


def show(loaded: LoadedMission, forecasts: list[FormForecast], console: Console) -> None:
    """Print a checked mission."""
    plan = loaded.plan
    console.print(f"[bold]{plan.name}[/bold] can be flown: {len(plan.agents)} agents, plan {plan.hash():016x}")
    console.print(_agents(loaded))
    console.print(_steps(plan, forecasts))
    for line in _facts(plan):
        console.print(line, soft_wrap=True)
    for warning in (*loaded.warnings, *_late(forecasts)):
        console.print(Text.assemble(("warning  ", "yellow"), warning), soft_wrap=True)


def _agents(loaded: LoadedMission) -> Table:
    plan = loaded.plan
    forms = [step for step in plan.steps if isinstance(step, FormStep)]
    table = Table("agent", "start N, E m", "neighbours", *(f"{form.shape} N, E m" for form in forms), "vehicle")
    for k, (agent, entry) in enumerate(zip(plan.agents, loaded.fleet.agents, strict=True)):
        vehicle = f"{entry.autopilot} {entry.sysid}, {entry.endpoint or 'simulated'}"
        slots = (_metres(form.slots[k], plan.unit_m) for form in forms)
        near = ", ".join(map(str, agent.neighbours)) or "none"
        table.add_row(str(agent.id), _metres(agent.start, plan.unit_m), near, *slots, vehicle)
    return table


def _steps(plan: Plan, forecasts: list[FormForecast]) -> Table:
    table = Table("step", "what", "expected", "time-out")
    left = iter(forecasts)
    for number, step in enumerate(plan.steps, start=1):
        what: str = step.kind
        expected = ""
        if isinstance(step, TakeoffStep):
            what, expected = f"takeoff to {step.height_m:g} m", f"{step.height_m / plan.limits.climb_mps:.0f} s climb"
        elif isinstance(step, HoldStep):
            expected = f"{step.duration_s:g} s"
        elif isinstance(step, FormStep):
            forecast = next(left)
            what = f"form {step.shape}, {step.tolerance_m:g} m"
            expected = _expected(forecast)
        table.add_row(str(number), what, expected, f"{step.timeout_s:g} s")
    return table


def _expected(forecast: FormForecast) -> str:
    time = "not in time" if forecast.formed_s is None else f"{forecast.formed_s:.0f} s"
    if forecast.smallest_pair is None:
        return time
    i, j = forecast.smallest_pair
    return f"{time}, closest {forecast.smallest_m:.1f} m ({i}-{j})"


def _facts(plan: Plan) -> list[str]:
    starts = {agent.id: agent.start for agent in plan.agents}
    links = {agent.id: agent.neighbours for agent in plan.agents}
    law, unit, limits = plan.law, plan.unit_m, plan.limits
    lines = [f"radii    r {law.r * unit:g} m, r_out {law.r_out * unit:g} m, r_in {law.r_in * unit:g} m"]
    if edges := graph.edges(links):
        lines.append("graph    " + " ".join(f"{i}-{j}" for i, j in edges))
        time_s = 1 / (plan.kappa * law.h * graph.consensus_rate(links))
        connectivity = graph.algebraic_connectivity(links)
        lines[-1] += f" (algebraic connectivity {connectivity:.3f}, slowest time constant {time_s:.1f} s)"
    lines += [f"closest  {line}" for line in _closest(plan, list(starts))]
    speed = np.array(limits.speed_mps)
    stop_m = limits.speed_mps * plan.response.dead_time_s + float(stop_distance(speed, plan.response))
    lines.append(
        f"limits   {limits.speed_mps:g} m/s (stops within {stop_m:.1f} m),"
        f" {limits.climb_mps:g} up, {limits.descent_mps:g} down"
    )
    lines.append(f"law      kappa {plan.kappa:g}, h {law.h:g}, {plan.compensation.value}, tick {plan.tick_s:g} s")
    lost = plan.policies
    lines.append(
        f"lost     agent after {lost.agent_lost_after_s:g} s: {lost.agent_lost.value};"
        f" station after {lost.station_lost_after_s:g} s: {lost.station_lost.value}"
    )
    return lines


def _closest(plan: Plan, ids: list[int]) -> list[str]:
    rows = [("starts", tuple(agent.start for agent in plan.agents))]
    rows += [(step.shape, step.slots) for step in plan.steps if isinstance(step, FormStep)]
    lines = []
    for name, points in rows:
        if found := closest_pair(points):
            apart, (i, j) = found
            lines.append(f"{name} {apart * plan.unit_m:.2f} m ({ids[i]}-{ids[j]})")
    return lines


def _late(forecasts: list[FormForecast]) -> list[str]:
    return [f"{f.shape} is not expected to stand before its time-out" for f in forecasts if f.formed_s is None]


def _metres(point: Point, unit_m: float) -> str:
    return f"{point[0] * unit_m:.1f}, {point[1] * unit_m:.1f}"
