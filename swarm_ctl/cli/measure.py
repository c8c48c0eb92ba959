"""`swarm-ctl measure`: how a vehicle answers a velocity setpoint, by a step flight, into the fleet
file."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from swarm_ctl.cli.send import agents_of
from swarm_ctl.cli.sim import Persona
from swarm_ctl.core.identification.fit import Fit, Leg, fit
from swarm_ctl.core.identification.step_flight import StepFlight, Steps
from swarm_ctl.core.law.stop_point import TYPICAL
from swarm_ctl.core.model.plan import Fence, Geodetic, Limits, Response
from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile import fleet_file
from swarm_ctl.mission.compile.fleet import FleetAgent
from swarm_ctl.mission.compile.loader import load

_SPEED_MPS = Limits().speed_mps
_MOST_MPS = 20.0
_TICK_S = 0.05


def measure(
    mission: Annotated[
        Path | None,
        typer.Argument(
            help="A mission: its fleet, geofence, speed limit and tick.", show_default=False
        ),
    ] = None,
    agent_id: Annotated[
        str, typer.Option("--id", help="Whose vehicles, one after another: 3, 1,2 or 1-4; or all.")
    ] = "",
    fleet: Annotated[
        Path | None, typer.Option(help="The fleet file to read endpoints from and write into.")
    ] = None,
    endpoint: Annotated[
        str | None,
        typer.Option(
            help="A vehicle of no fleet, e.g. udpout:127.0.0.1:14601; nothing is written."
        ),
    ] = None,
    sysid: Annotated[int, typer.Option(min=1, max=250, help="Its MAVLink system id.")] = 1,
    autopilot: Annotated[Persona, typer.Option(help="Its firmware.")] = Persona.ARDUPILOT,
    speed: Annotated[
        float | None,
        typer.Option(
            min=0.5,
            help="Of the largest step [m/s]; default 5, or the mission's limit if that is less.",
        ),
    ] = None,
    height: Annotated[
        float, typer.Option(min=2.0, max=100.0, help="Above the take-off point [m].")
    ] = 10.0,
    box: Annotated[
        float | None,
        typer.Option(
            help="It lands when it gets so far north, south, east or west [m]; default: what the steps need."
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Fly and show, but write nothing.")
    ] = False,
    speedup: Annotated[
        float, typer.Option(min=0.1, max=100.0, help="For simulated vehicles at the same factor.")
    ] = 1.0,
) -> None:
    """Measure a vehicle's dead time, lag and acceleration limit and write them into the fleet file.

    IT TAKES OFF: up to --height, velocity steps out and back north and east, each from and to the
    start, and lands. About two and a half minutes a vehicle. The faster the steps, the better they
    tell the acceleration limit, and the larger the box (4.5 s of flight). It refuses a vehicle that
    is armed already or not healthy, and lands at Ctrl-C (twice: leaves it to its own failsafe),
    when it leaves its box or the link is lost, when another aircraft comes near, and in all that
    lands it in a mission; a pilot who changes the mode has it at once. A vehicle without an
    endpoint is simulated.

    Exit codes: 0 all measured, 1 one was not (or answers unlike the model: nothing written for it),
    2 bad input, 3 an endpoint or the simulator did not open, 130 landed by Ctrl-C.

    Examples:

        swarm-ctl measure --fleet outdoors.yaml --id 3

        swarm-ctl measure missions/square.yaml --fleet outdoors.yaml --id all --speed 3

        swarm-ctl measure --endpoint udpout:127.0.0.1:14601 --autopilot px4
    """
    from swarm_ctl.runtime.clock import Clock
    from swarm_ctl.runtime.launch.measure import Watch, fly
    from swarm_ctl.runtime.launch.supervisor import Interrupts

    console = Console(highlight=False)
    if endpoint and (fleet or mission or agent_id):
        raise InputError(
            "--endpoint is a vehicle of no fleet; allowed: that, or a mission or --fleet with --id"
        )
    single = FleetAgent(sysid, sysid, autopilot.value, endpoint, None, TYPICAL[autopilot.value])
    task = _Task((single,)) if endpoint else _of_fleet(mission, fleet, dry_run=dry_run)
    vehicles = _chosen(task.vehicles, agent_id)
    steps = _steps(speed, height, box, task.limit_mps)
    clock = Clock.starting_now(speedup)
    failed = False
    with Interrupts() as ctrl_c:
        watch = Watch(
            lambda text: console.print(f"  {text}", soft_wrap=True, style="dim"),
            lambda: "Ctrl-C" if ctrl_c.count else "",
            lambda: ctrl_c.count > 1,
        )
        for vehicle in vehicles:
            where = vehicle.endpoint or "simulated"
            console.print(
                f"agent {vehicle.id}: {vehicle.autopilot}, sysid {vehicle.sysid}, {where}; steps of "
                f"{steps.speed_mps:g} m/s for {steps.duration_s:.0f} s, {steps.height_m:g} m high, "
                f"within {steps.box_m:g} m",
                soft_wrap=True,
            )
            flight = StepFlight(steps, vehicle.response, task.tick_s, task.fence, task.origin)
            down = fly(vehicle, flight, task.tick_s, clock, watch)
            if ctrl_c.count:
                console.print(
                    "  landed by Ctrl-C" if down else "  left to its own failsafe", style="bold red"
                )
                break
            measured = _result(console, vehicle, flight)
            failed |= measured is None
            if measured is not None and task.file is not None and not dry_run:
                _write(task.file, vehicle.id, measured)
                console.print(f"  written into {task.file}", soft_wrap=True)
            if not down:
                console.print(
                    "the vehicle does not stand disarmed: the next one does not take off",
                    style="bold red",
                )
                break
    raise typer.Exit(130 if ctrl_c.count else int(failed))


@dataclass(frozen=True, slots=True)
class _Task:
    """What a mission or a fleet says: vehicles, where results go, and bounds."""

    vehicles: tuple[FleetAgent, ...]
    file: Path | None = None
    tick_s: float = _TICK_S
    limit_mps: float = _MOST_MPS
    fence: Fence | None = None
    origin: Geodetic | None = None


def _of_fleet(mission: Path | None, fleet: Path | None, *, dry_run: bool) -> _Task:
    if mission is None:
        if fleet is None:
            raise InputError("no vehicle; allowed: --fleet FILE, a mission, or --endpoint URL")
        file: Path | None = fleet
        task = _Task(fleet_file.read_fleet(fleet).agents, fleet)
    else:
        loaded = load(mission, fleet=fleet)
        plan, file = loaded.plan, fleet or fleet_file.file_of(mission)
        simulated = all(agent.endpoint is None for agent in loaded.fleet.agents)
        # a simulated vehicle stands anywhere: the mission's geofence is none of its business
        fence = None if simulated else plan.fence
        task = _Task(
            loaded.fleet.agents, file, plan.tick_s, plan.limits.speed_mps, fence, plan.origin
        )
    if file is None and not dry_run:
        raise InputError(
            f"{mission}: has no fleet to write into; allowed: --fleet FILE, a fleet section, --dry-run"
        )
    if (
        file is not None
        and not dry_run
        and not (os.access(file, os.W_OK) and os.access(file.resolve().parent, os.W_OK))
    ):
        raise InputError(
            f"{file}: can't be written; allowed: a file and folder that may be, or --dry-run"
        )
    return task


def _chosen(vehicles: Sequence[FleetAgent], named: str) -> list[FleetAgent]:
    if named == "all" or (not named and len(vehicles) == 1):
        return list(vehicles)
    known = {vehicle.id: vehicle for vehicle in vehicles}
    ids = agents_of(named, "--id")
    missing = [i for i in ids if i not in known]
    if not ids or missing:
        wrong = f"--id {missing[0]} is not in the fleet" if missing else "--id is missing"
        raise InputError(f"{wrong}; allowed: {', '.join(map(str, known))}, several of them, or all")
    return [known[i] for i in ids]


def _steps(speed: float | None, height: float, box: float | None, limit_mps: float) -> Steps:
    fastest = min(_SPEED_MPS, limit_mps) if speed is None else speed
    if fastest > limit_mps:
        raise InputError(f"--speed {fastest:g}: over the limit; allowed: up to {limit_mps:g} m/s")
    least = Steps(fastest, height).least_box_m
    if box is not None and box < least:
        raise InputError(
            f"--box {box:g}: steps of {fastest:g} m/s lead farther; allowed: {least:g} m and more"
        )
    return Steps(fastest, height, math.ceil(least) if box is None else box)


def _result(console: Console, vehicle: FleetAgent, flight: StepFlight) -> Response | None:
    """Show what was found; None where there is nothing to fly with."""
    ended = flight.ended
    why = (
        ""
        if ended is not None and ended.outcome == "completed"
        else ended.reason
        if ended is not None
        else "stopped"
    )
    why = why or flight.missing
    if why:
        console.print(f"  not measured: {why}", style="bold red", soft_wrap=True)
        return None
    found = fit(flight.legs, TYPICAL[vehicle.autopilot])
    for line in described(found, flight.legs):
        console.print(f"  {line}", soft_wrap=True)
    for text in found.warnings:
        console.print(f"  warning: {text}", style="yellow", soft_wrap=True)
    if not found.usable:
        console.print(
            "  not to be flown with: a vehicle that answers unlike dead time and lag",
            style="bold red",
        )
        return None
    return found.rounded


def described(found: Fit, legs: Sequence[Leg]) -> list[str]:
    """The figures in words."""
    r = found.rounded
    limit = f"{r.acceleration_mps2:g} m/s2" + (
        "" if found.limited else " (the typical one: the steps don't tell)"
    )
    kinds = dict.fromkeys(leg.kind for leg in legs)
    lines = [
        f"response: {{dead_time_s: {r.dead_time_s:g}, lag_s: {r.lag_s:g}, acceleration_mps2: {r.acceleration_mps2:g}}}",
        f"dead time {r.dead_time_s:.2f} s, lag {r.lag_s:.2f} s, acceleration limit {limit}",
        f"residual {found.residual_mps:.2f} m/s, {found.share:.0%} of the step",
        f"stop point off by {found.stop_rms_m:.2f} m (rms), {found.stop_most_m:.2f} m at most",
    ]
    for kind in kinds:
        alone = [part for leg, part in zip(legs, found.spread, strict=True) if leg.kind == kind]
        dead = " / ".join(f"{part.dead_time_s:.2f}" for part in alone)
        lag = " / ".join(f"{part.lag_s:.2f}" for part in alone)
        lines.append(
            f"  {kind} alone ({' / '.join(leg.way for leg in legs if leg.kind == kind)}): {dead} s, {lag} s"
        )
    return lines


def _write(path: Path, agent: int, found: Response) -> None:
    """The response into the file, in one move; it is read again, as it may have been edited
    meanwhile."""
    from swarm_ctl.report.folder.files import write_whole

    try:
        target = path.resolve()
        text = target.read_bytes().decode("utf-8")
        write_whole(target, fleet_file.with_response(text, agent, found))
    except (OSError, InputError) as error:
        reason = (error.strerror or str(error)) if isinstance(error, OSError) else str(error)
        raise InputError(
            f"{path}: the response of agent {agent} can't be written: {reason}"
        ) from None
