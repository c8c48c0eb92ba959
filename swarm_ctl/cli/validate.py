"""`swarm-ctl validate`: check a mission and show what would be flown."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from swarm_ctl.core.agent.progress import step_name
from swarm_ctl.core.agent.return_to_launch import return_height_m
from swarm_ctl.core.law import graph
from swarm_ctl.core.law.formation import closest_pair
from swarm_ctl.core.law.stop_point import stop_distance
from swarm_ctl.core.model.plan import (
    FormStep,
    MoveStep,
    Plan,
    Point,
    ReturnStep,
    RotateStep,
    ScaleStep,
    Step,
    TakeoffStep,
)
from swarm_ctl.core.safety.constraints import Margins
from swarm_ctl.mission.compile.forecast import StepForecast, forecast
from swarm_ctl.mission.compile.loader import LoadedMission, load
from swarm_ctl.mission.input.simulation_section import Simulation


def validate(
    mission: Annotated[Path, typer.Argument(help="The mission file.")],
    fleet: Annotated[
        Path | None, typer.Option(help="A fleet file to use instead of the mission's.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw it into this .png, .svg or .pdf (needs matplotlib).")
    ] = None,
) -> None:
    """Check a mission file and show what would be flown: agents, graph, slots, distances, times,
    warnings."""
    loaded = load(mission, fleet=fleet)
    console = Console(highlight=False)
    show(loaded, forecast(loaded.plan), console)
    if plot is not None:
        from swarm_ctl.report.page import mission_plot as picture

        picture.plot(loaded.plan, plot)
        console.print(f"picture  {plot}", soft_wrap=True)


def show(loaded: LoadedMission, forecasts: list[StepForecast], console: Console) -> None:
    """Print a checked mission."""
    plan = loaded.plan
    console.print(
        f"[bold]{plan.name}[/bold] can be flown: {len(plan.agents)} agents, plan {plan.hash():016x}"
    )
    console.print(_agents(loaded))
    console.print(_steps(plan, forecasts))
    for line in _facts(plan):
        console.print(line, soft_wrap=True)
    for line in _simulation(loaded.file.simulation):
        console.print(line, soft_wrap=True)
    late = (*_late(plan, forecasts), *_too_late_faults(loaded.file.simulation, plan, forecasts))
    for warning in (*loaded.warnings, *late):
        console.print(Text.assemble(("warning  ", "yellow"), warning), soft_wrap=True)


def _agents(loaded: LoadedMission) -> Table:
    plan = loaded.plan
    forms = [step for step in plan.steps if isinstance(step, FormStep)]
    table = Table(
        "agent",
        "start N, E m",
        "neighbours",
        *(f"{form.shape} N, E m" for form in forms),
        "vehicle",
    )
    for k, (agent, entry) in enumerate(zip(plan.agents, loaded.fleet.agents, strict=True)):
        vehicle = f"{entry.autopilot} {entry.sysid}, {entry.endpoint or 'simulated'}"
        slots = (_metres(form.slots[k], plan.unit_m) for form in forms)
        near = ", ".join(map(str, agent.neighbours)) or "none"
        table.add_row(str(agent.id), _metres(agent.start, plan.unit_m), near, *slots, vehicle)
    return table


def _steps(plan: Plan, forecasts: list[StepForecast]) -> Table:
    table = Table("step", "what", "expected", "time-out", "then")
    for number, (step, expected) in enumerate(zip(plan.steps, forecasts, strict=True), start=1):
        then = step.on_timeout.value
        table.add_row(
            str(number), _what(plan, step), _expected(expected), f"{step.timeout_s:.0f} s", then
        )
    table.add_row("", "whole flight", f"{_total_s(plan, forecasts):.0f} s", "", "")
    return table


def _total_s(plan: Plan, forecasts: list[StepForecast]) -> float:
    return sum(
        expected.expected_s or step.timeout_s
        for step, expected in zip(plan.steps, forecasts, strict=True)
    )


def _what(plan: Plan, step: Step) -> str:
    match step:
        case TakeoffStep():
            return f"takeoff to {step.height_m:g} m"
        case FormStep():
            return f"form {step.shape}, {step.tolerance_m:g} m"
        case MoveStep():
            way = ", ".join(f"({north:g}, {east:g})" for north, east in step.waypoints_m)
            return f"move to {way} m at {step.speed_mps:g} m/s"
        case RotateStep():
            return f"rotate to {math.degrees(step.angle_rad):g} degrees at {step.speed_mps:g} m/s"
        case ScaleStep():
            return f"scale to {step.factor:g} at {step.speed_mps:g} m/s"
        case ReturnStep():
            last = return_height_m(plan, plan.agents[-1].id)
            return f"return at {return_height_m(plan, plan.agents[0].id):g} to {last:g} m"
        case _:
            return step.kind


def _expected(expected: StepForecast) -> str:
    time = "not in time" if expected.expected_s is None else f"{expected.expected_s:.0f} s"
    if expected.form is None or expected.form.smallest_pair is None:
        return time
    i, j = expected.form.smallest_pair
    return f"{time}, closest {expected.form.smallest_m:.1f} m ({i}-{j})"


def _facts(plan: Plan) -> list[str]:
    starts = {agent.id: agent.start for agent in plan.agents}
    links = {agent.id: agent.neighbours for agent in plan.agents}
    law, unit, limits = plan.law, plan.unit_m, plan.limits
    lines = [
        f"radii    r {law.r * unit:g} m, r_out {law.r_out * unit:g} m, r_in {law.r_in * unit:g} m"
    ]
    if edges := graph.edges(links):
        lines.append("graph    " + " ".join(f"{i}-{j}" for i, j in edges))
        time_s = 1 / (plan.kappa * law.h * graph.consensus_rate(links))
        connectivity = graph.algebraic_connectivity(links)
        lines[-1] += (
            f" (algebraic connectivity {connectivity:.3f}, slowest time constant {time_s:.1f} s)"
        )
    lines += [f"closest  {line}" for line in _closest(plan, list(starts))]
    speed = np.array(limits.speed_mps)
    stop_m = limits.speed_mps * plan.response.dead_time_s + float(
        stop_distance(speed, plan.response)
    )
    lines.append(
        f"limits   {limits.speed_mps:g} m/s (stops within {stop_m:.1f} m),"
        f" {limits.climb_mps:g} up, {limits.descent_mps:g} down"
    )
    lines.append(
        f"law      kappa {plan.kappa:g}, h {law.h:g}, {plan.compensation.value}, tick {plan.tick_s:g} s"
    )
    lines.append(f"safety   {_safety(plan)}")
    if plan.fence is not None:
        box = " ".join(f"({north:g}, {east:g})" for north, east in plan.fence.polygon_m)
        lines.append(
            f"fence    up to {plan.fence.height_m:g} m, inside {box} m: {plan.policies.fence.value}"
        )
    safe = plan.policies
    lines.append(
        f"limits   battery under {safe.battery_reserve_percent:g} %: {safe.battery_low.value};"
        f" over {safe.max_speed_mps:g} m/s or {safe.max_tilt_deg:g} degrees: {safe.too_fast.value};"
        f" wind over {safe.wind_limit_mps:g} m/s: {safe.wind.value}"
    )
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


def _late(plan: Plan, forecasts: list[StepForecast]) -> list[str]:
    late = [k for k, expected in enumerate(forecasts, start=1) if expected.expected_s is None]
    return [
        f"step {k}, {step_name(plan, k)}, is not expected to be done before its time-out"
        for k in late
    ]


def _simulation(simulation: Simulation) -> list[str]:
    """Weather, and the faults in the order of their times."""
    given = simulation.parameters.given()
    lines = [f"weather  {_settings(given)} (simulated vehicles)"] if given else []
    for fault in sorted(simulation.faults, key=lambda fault: fault.at_s):
        who = "all agents" if fault.agents is None else "agent " + ", ".join(map(str, fault.agents))
        lasting = "" if fault.for_s is None else f" for {fault.for_s:g} s"
        lines.append(
            f"fault    {fault.at_s:g} s after {simulation.since}{lasting}, {who}: {_settings(fault.set.given())}"
        )
    return lines


def _settings(given: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in given.items())


def _too_late_faults(
    simulation: Simulation, plan: Plan, forecasts: list[StepForecast]
) -> list[str]:
    end_s = _total_s(plan, forecasts) + (_PREPARED_S if simulation.since == "start" else 0.0)
    return [
        f"the fault {fault.at_s:g} s after {simulation.since} comes later than the expected end, after {end_s:.0f} s"
        for fault in simulation.faults
        if fault.at_s > end_s
    ]


_PREPARED_S = 5.0
"""Before simulated vehicles take off, at no speed-up."""


def _metres(point: Point, unit_m: float) -> str:
    return f"{point[0] * unit_m:.1f}, {point[1] * unit_m:.1f}"


def _safety(plan: Plan) -> str:
    parts = plan.safety
    if not parts.filter:
        return "no filter: nothing but the law keeps the vehicles apart"
    margins = Margins.of(plan.law, plan.response, plan.limits.speed_mps, plan.unit_m)
    named = (
        ("guard of links", parts.guard),
        ("release from dead-locks", parts.release),
        ("pull to the average of all", parts.align),
    )
    others = [name for name, on in named if on]
    return ", ".join((f"filter (stop points {margins.keep_out:.1f} m apart or more)", *others))
