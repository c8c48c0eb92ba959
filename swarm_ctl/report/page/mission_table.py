"""What a checked mission would fly, for a screen: agents, steps, distances, limits, warnings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from swarm_ctl.core.kernel.constraints import margins_of
from swarm_ctl.core.kernel.response import stop_distance
from swarm_ctl.core.law import graph
from swarm_ctl.core.law.formation import closest_pair
from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.core.model.fleet import Fleet, SigningPolicy, VehicleKind
from swarm_ctl.core.model.plan import AgentPlan, Plan, PlannedStep, Point
from swarm_ctl.core.model.route import flight_s
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.text import agents_named, ranges
from swarm_ctl.core.model.timeouts import LANDING_AT_MOST_S
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.swarm.hearing import mesh_words
from swarm_ctl.core.swarm.radio import radio_words
from swarm_ctl.mission.compile.forecast import StepForecast
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.mission.sections.simulation_section import SimulationSection
from swarm_ctl.mission.steps.table import kind_of, place_of

_AGENTS: Final = 12
"""Of more agents, a table that is not `full` shows so many."""
_NEAR: Final = 4
"""More neighbours than this are named by ranges."""
_LINKS: Final = 20
"""More links than this are counted, not listed."""
_PREPARED_S: Final = 5.0
"""Simulated vehicles take so long to get ready for take-off, at no speed-up."""


def mission_parts(
    loaded: LoadedMission, forecasts: Sequence[StepForecast], *, full: bool = False
) -> Iterator[RenderableType]:
    """Tables and lines of a mission, top to bottom; long lists are folded unless `full`."""
    plan, simulation = loaded.plan, loaded.file.simulation
    count = len(plan.agents)
    started = Counter(e.started_as for e in loaded.fleet.agents if e.started_as is not None)
    kinds = ", ".join(f"{number} {kind}" for kind, number in sorted(started.items()))
    agents = f"{count} agents, {kinds or '0 simulated'}"
    late = (*_late_steps(loaded, forecasts), *_late_faults(simulation, plan, forecasts))
    warnings = (*loaded.warnings, *late)
    many = f", with {len(warnings)} warning{'s' * (len(warnings) > 1)}" if warnings else ""
    heading = f"{plan.name} can be flown{many}: {agents}, plan {plan.fingerprint()}"
    yield Text(heading, style="bold yellow" if warnings else "bold")
    yield _agents(loaded, count if full or count <= _AGENTS else _AGENTS - 2)
    if count > _AGENTS and not full:
        yield f"{count - _AGENTS + 2} more agents; --full shows them"
    yield _steps(plan, forecasts)
    yield from _facts(plan, full, routed=bool(loaded.fleet.routers))
    signed = loaded.fleet.signing is SigningPolicy.REQUIRED
    for behind in loaded.fleet.radios().values():
        yield f"radio    {radio_words(behind, signed=signed)}"
    yield from pilots(loaded.fleet)
    yield from _simulation(simulation)
    for warning in warnings:
        yield Text.assemble(("warning  ", "yellow"), warning)


def _table(*headings: str) -> Table:
    return Table(*headings, box=None, pad_edge=False, header_style="dim", padding=(0, 2, 0, 0))


def _agents(loaded: LoadedMission, shown: int) -> Table:
    plan = loaded.plan
    forms = [(at, form) for at in plan.all_steps() if (form := at.step.new_shape)]
    headings = (f"{form.shape} N, E{', up' * bool(form.ups_m)} m" for _, form in forms)
    table = _table("agent", "start N, E m", "neighbours", *headings, "vehicle")
    rows = zip(plan.agents, loaded.fleet.agents, strict=True)
    for k, (agent, entry) in enumerate(rows):
        if k < shown:
            table.add_row(
                str(agent.id),
                _metres(agent.start, plan.unit_m),
                _neighbours(agent, len(plan.agents)),
                *(_slot(at, form, agent.id) for at, form in forms),
                f"{entry.autopilot} {entry.sysid} {entry.endpoint or ''}",
            )
    return table


def _neighbours(agent: AgentPlan, count: int) -> str:
    near = agent.neighbours
    if len(near) == count - 1 > 1:
        return "all"
    return (", ".join(map(str, near)) if len(near) <= _NEAR else ranges(near)) or "none"


def _slot(at: PlannedStep, form: FormStep, agent: int) -> str:
    """North, east, and where slots have heights the one above the take-off point; '' of an agent of
    another group."""
    if agent not in at.group.ids:
        return ""
    place = at.group.ids.index(agent)
    found = _metres(form.slots[place], at.plan.unit_m)
    return f"{found}, {at.after.heights_m[place]:.1f}" if form.ups_m else found


def _metres(point: Point, unit_m: float) -> str:
    return f"{point[0] * unit_m:.1f}, {point[1] * unit_m:.1f}"


def _steps(plan: Plan, forecasts: Sequence[StepForecast]) -> Table:
    groups = ["group"] * (len(plan.groups) > 1)
    table = _table("step", *groups, "what", "expected", "time-out", "then")
    for at, expected in zip(plan.all_steps(), forecasts, strict=True):
        if at.waits_on:
            continue
        timeout = f"{at.step.timeout_s:.0f} s"
        what = kind_of(at.step).words(at.step, plan)
        group = [at.group.name] * len(groups)
        then = at.step.on_timeout.value
        table.add_row(str(at.number), *group, what, _expected(expected), timeout, then)
    whole = f"{_total_s(plan, forecasts):.0f} s"
    table.add_row("", *[""] * len(groups), "whole flight", whole, "", "")
    return table


def _total_s(plan: Plan, forecasts: Sequence[StepForecast]) -> float:
    times = zip(plan.all_steps(), forecasts, strict=True)
    return flight_s(plan, [_seconds(at, expected) for at, expected in times])


def _seconds(at: PlannedStep, expected: StepForecast) -> float:
    return at.step.timeout_s if expected.expected_s is None else expected.expected_s


def _expected(expected: StepForecast) -> str:
    time = "not in time" if expected.expected_s is None else f"{expected.expected_s:.0f} s"
    if expected.form is None or expected.form.smallest_pair is None:
        return time
    i, j = expected.form.smallest_pair
    return f"{time}, closest {expected.form.smallest_m:.1f} m ({i}-{j})"


def _facts(plan: Plan, full: bool, *, routed: bool) -> Iterator[str]:
    law, unit, limits, policies = plan.law, plan.unit_m, plan.limits, plan.policies
    yield f"radii    r {law.r * unit:g} m, r_out {law.r_out * unit:g} m, r_in {law.r_in * unit:g} m"
    yield from _graph(plan, full)
    yield f"mesh     {mesh_words(len(plan.agents), routed=routed)}"
    if plan.wake is not None:
        yield (
            f"layers   {plan.layer_m:g} m or more between vehicles above each other;"
            f" {plan.slot_layer_m:g} m between slots, for what estimates err and vehicles climb"
        )
    yield from _closest(plan)
    braking_m = stop_distance(limits.speed_mps, plan.response)
    stop_m = limits.speed_mps * plan.response.dead_time_s + braking_m
    yield (
        f"limits   {limits.speed_mps:g} m/s (stops within {stop_m:.1f} m),"
        f" {limits.climb_mps:g} up, {limits.descent_mps:g} down"
    )
    compensation = plan.compensation.value
    numbers = "".join(f" {each.name} {each.value:g}," for each in law.parameters)
    own = f"own law {law.own.partition('@')[0]},{numbers} " if law.own else ""
    yield f"law      {own}kappa {plan.kappa:g}, h {law.h:g}, {compensation}, tick {plan.tick_s:g} s"
    yield f"safety   {_safety(plan)}"
    if plan.fence is not None:
        inside = " ".join(f"({north:g}, {east:g})" for north, east in plan.fence.polygon_m)
        yield f"fence    up to {plan.fence.height_m:g} m, inside {inside} m: {policies.fence.value}"
    for zone in plan.zones:
        yield f"zone     {_zone(zone)}"
    yield (
        f"limits   battery under {policies.battery_reserve_percent:g} %:"
        f" {policies.battery_low.value}; over {policies.max_speed_mps:g} m/s or"
        f" {policies.max_tilt_deg:g} degrees: {policies.too_fast.value};"
        f" wind over {policies.wind_limit_mps:g} m/s: {policies.wind.value}"
    )
    yield (
        f"estimate {policies.position_accuracy_m:g} m or better to take off;"
        f" over {policies.position_accuracy_flight_m:g} m, or faulty: {policies.estimate.value}"
    )
    yield (
        f"lost     agent after {policies.agent_lost_after_s:g} s: {policies.agent_lost.value};"
        f" station after {policies.station_lost_after_s:g} s: {policies.station_lost.value}"
    )
    yield (
        f"held     by a command to some agents: the others wait {policies.override_pause_s:g} s"
        f" at most, then: {policies.left_by_order.value}"
    )
    yield f"left     by a command to some agents, the others: {policies.left_by_order.value}"
    yield (
        f"landing  a vehicle that is not down and disarmed after {LANDING_AT_MOST_S:g} s is given"
        " up: its agent ends, failed"
    )


def pilots(fleet: Fleet) -> Iterator[str]:
    """What real autopilots leave to pilots and ground stations while their agents fly them."""
    for autopilot, kind in AUTOPILOT_KINDS.items():
        ids = [
            agent.id
            for agent in fleet.agents
            if agent.autopilot == autopilot and agent.started_as is not VehicleKind.SIMULATED
        ]
        if ids:
            yield f"pilots   {agents_named(ids)}: {kind.pilots}"


def _graph(plan: Plan, full: bool) -> Iterator[str]:
    neighbours = {agent.id: agent.neighbours for agent in plan.agents}
    edges, count = graph.edges(neighbours), len(neighbours)
    if not edges:
        return
    if len(edges) == count * (count - 1) // 2 and not full:
        named = "all with all"
    elif len(edges) > _LINKS and not full:
        named = f"{len(edges)} links; --full lists them"
    else:
        named = " ".join(f"{i}-{j}" for i, j in edges)
    time_s = 1 / (plan.kappa * plan.law.h * graph.consensus_rate(neighbours))
    connectivity = graph.algebraic_connectivity(neighbours)
    yield (
        f"graph    {named} (algebraic connectivity {connectivity:.3f},"
        f" slowest time constant {time_s:.1f} s)"
    )


def _closest(plan: Plan) -> Iterator[str]:
    ids = tuple(agent.id for agent in plan.agents)
    places = [("starts", ids, tuple(agent.start for agent in plan.agents))]
    forms = ((at.group.ids, at.step.new_shape) for at in plan.all_steps())
    places += [(form.shape, of, form.slots) for of, form in forms if form is not None]
    for name, of, points in places:
        if found := closest_pair(points):
            apart, (i, j) = found
            pair = f"{of[i]}-{of[j]}"
            yield f"closest  {name} {apart * plan.unit_m:.2f} m ({pair})"


def _zone(zone: Zone) -> str:
    places = " ".join(f"({north:g}, {east:g})" for north, east in zone.corners_m)
    shape = f"circle of {zone.radius_m:g} m at {places}" if zone.radius_m else f"inside {places}"
    heights = "" if zone.floor_m is None else f", from {zone.floor_m:g} m"
    heights += "" if zone.ceiling_m is None else f", up to {zone.ceiling_m:g} m"
    return f"{zone.name}: {shape} m{heights}; {zone.clearance_m:g} m are kept clear"


def _safety(plan: Plan) -> str:
    parts = plan.safety
    if not parts.filter:
        return "no filter: only the law keeps the vehicles apart"
    margins = margins_of(plan.law, plan.response, plan.limits.speed_mps, plan.unit_m)
    named = (
        ("link guard", parts.guard),
        ("dead-lock release", parts.release),
        ("mean error feedback", parts.align),
    )
    others = [name for name, on in named if on]
    return ", ".join((f"filter (stop points {margins.keep_out:.1f} m apart or more)", *others))


def _simulation(simulation: SimulationSection) -> Iterator[str]:
    """Weather, and the faults in the order of their times."""
    if given := simulation.parameters.given():
        yield f"weather  {_settings(given)} (simulated vehicles)"
    for fault in sorted(simulation.faults, key=lambda fault: fault.at_s):
        agents = "all agents" if fault.agents is None else f"agent {ranges(fault.agents)}"
        lasting = "" if fault.for_s is None else f" for {fault.for_s:g} s"
        when = f"{fault.at_s:g} s after {simulation.since}{lasting}"
        pilot = [f"a pilot: {fault.pilot}"] if fault.pilot else []
        what = ", ".join([*pilot, *([_settings(fault.set.given())] if fault.set.given() else [])])
        yield f"fault    {when}, {agents}: {what}"


def _settings(given: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in given.items())


def _late_steps(loaded: LoadedMission, forecasts: Sequence[StepForecast]) -> Iterator[str]:
    for at, expected in zip(loaded.plan.all_steps(), forecasts, strict=True):
        if expected.expected_s is None:
            where = loaded.document.where(place_of(at)[:-1])
            name = f"step {at.number}, {at.name}"
            enough = f"; it takes about {expected.needed_s:.0f} s" if expected.needed_s else ""
            late = "is not expected to be done before its time-out"
            yield f"{where}: {name}: {late}, {at.step.timeout_s:.0f} s{enough}"


def _late_faults(
    simulation: SimulationSection, plan: Plan, forecasts: Sequence[StepForecast]
) -> Iterator[str]:
    end_s = _total_s(plan, forecasts) + (_PREPARED_S if simulation.since == "start" else 0.0)
    for fault in simulation.faults:
        if fault.at_s > end_s:
            yield (
                f"the fault {fault.at_s:g} s after {simulation.since} comes later than the"
                f" expected end, after {end_s:.0f} s"
            )
