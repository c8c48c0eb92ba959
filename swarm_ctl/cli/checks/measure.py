"""`swarm-ctl measure`: how a vehicle answers a velocity setpoint, by a step flight, into the fleet
file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from swarm_ctl.cli.flight.sim import Persona
from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import (
    AgentIdentity,
    OpenMesh,
    Speedup,
    endpoint_option,
    option,
    require_writable,
    switch,
)
from swarm_ctl.core.model.fleet import Fleet, FleetAgent, VehicleKind
from swarm_ctl.errors import InputError
from swarm_ctl.installed import require

if TYPE_CHECKING:  # the agent and numpy, which no other command waits for
    from swarm_ctl.core.identification.fit import Fit, Leg
    from swarm_ctl.core.identification.step_flight import StepFlight, Steps
    from swarm_ctl.core.model.plan import Response

_SPEED: Final = "Of the largest step.  [default: 5, or the mission's limit if that is less]"
_VEHICLES: Final = (
    "Start ArduCopter or PX4 itself (SITL), a vehicle of no fleet; no file is written. It is looked"
    " for as by run: $SWARM_CTL_ARDUCOPTER or $SWARM_CTL_PX4, or the PATH."
)
_BOX: Final = (
    "It lands when it is farther north, south, east or west than this."
    "  [default: what the steps need]"
)


def measure(
    mission: Annotated[
        Path | None,
        typer.Argument(
            metavar="MISSION", help="A mission: its fleet, geofence, speed limit and tick."
        ),
    ] = None,
    agent_id: Annotated[
        str, option("IDS", "The vehicles, one after another: 3, 1,2 or 1-4; or all.", "--id")
    ] = "",
    fleet: Annotated[
        Path | None, option("FILE", "The fleet file to read from and to write into.")
    ] = None,
    endpoint: Annotated[
        str | None,
        endpoint_option("A vehicle of no fleet, e.g. udpout:127.0.0.1:14601; no file is written."),
    ] = None,
    sysid: Annotated[
        int | None,
        option("NUMBER", "With --endpoint: its MAVLink system id.  [default: 1]", min=1, max=250),
    ] = None,
    autopilot: Annotated[
        Persona | None, typer.Option(help="With --endpoint: its firmware.  [default: ardupilot]")
    ] = None,
    vehicles: Annotated[VehicleKind | None, option("KIND", _VEHICLES)] = None,
    speed: Annotated[float | None, option("M/S", _SPEED, min=0.5)] = None,
    height: Annotated[
        float, option("METRES", "Above the take-off point.", min=2.0, max=100.0)
    ] = 10.0,
    box: Annotated[float | None, option("METRES", _BOX)] = None,
    dry_run: Annotated[bool, switch("--dry-run", "Fly and show, but write no file.")] = False,
    identity: AgentIdentity = None,
    open_mesh: OpenMesh = False,
    speedup: Speedup = 1.0,
) -> None:
    """Measure how a vehicle answers velocity setpoints.

    IT TAKES OFF, flies velocity steps out and back, north and east, and lands where it started: two
    and a half minutes a vehicle. Its dead time, lag and acceleration limit are written into the
    fleet file. Faster steps show the acceleration limit better, but need a larger box (4.5 s of
    flight). A vehicle without an endpoint is started for the flight, as `run` starts it.

    It refuses a vehicle that is armed or not healthy. It lands the vehicle at Ctrl-C (a second
    Ctrl-C leaves it to its own failsafe), when it leaves its box, loses its link or meets another
    aircraft, and for every reason that lands it in a mission. A pilot who changes the mode has it
    at once.

    Exit codes: 0 all measured, 1 a vehicle was not measured, or does not answer like the model and
    got no entry, 2 bad input, 3 an endpoint or the simulator did not open, 130 ended by Ctrl-C.

    Examples:

    \b
        swarm-ctl measure --fleet outdoors.yaml --id 3
        swarm-ctl measure missions/square.yaml --fleet outdoors.yaml --id all
        swarm-ctl measure --endpoint udpout:127.0.0.1:14601 --autopilot px4
        swarm-ctl measure --vehicles arducopter
    """
    from swarm_ctl.core.identification.step_flight import StepFlight
    from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
    from swarm_ctl.engine.clock import Clock
    from swarm_ctl.engine.interrupts import Interrupts
    from swarm_ctl.engine.launch.measure import Task, fly, task_of, write_response
    from swarm_ctl.engine.ticker import Ticker
    from swarm_ctl.mission.fleet.exposure import exposed_links, refuse_exposed

    console = PlainConsole()
    if endpoint is None:
        kinds = {"--autopilot": autopilot} | ({} if vehicles else {"--sysid": sysid})
        for name, given in kinds.items():
            if given is not None:
                known = "--vehicles names" if vehicles else "the fleet says"
                raise InputError(f"{name}: {known} what a vehicle is; allowed: with --endpoint")
    sysid, firmware = sysid or 1, (autopilot or Persona.ARDUPILOT).value
    if vehicles is not None:
        if endpoint or fleet or mission or agent_id:
            raise InputError("--vehicles starts a vehicle of no fleet; allowed: that alone")
        kind = vehicles.autopilot or firmware
        task = Task(
            (
                FleetAgent(
                    id=sysid,
                    sysid=sysid,
                    autopilot=kind,
                    endpoint=None,
                    mesh=None,
                    response=AUTOPILOT_KINDS[kind].response,
                    vehicle=vehicles,
                ),
            )
        )
    elif endpoint is None:
        require("ground", "measure without --endpoint")
        task = task_of(mission, fleet, identity, dry_run=dry_run)
    elif fleet or mission or agent_id:
        raise InputError(
            "--endpoint is a vehicle of no fleet; allowed: that, or a mission or --fleet with --id"
        )
    else:
        response = AUTOPILOT_KINDS[firmware].response
        task = Task((FleetAgent(sysid, sysid, firmware, endpoint, None, response),))
    if task.file and not dry_run:
        require_writable(task.file, "or fly with --dry-run")
    chosen = task.chosen(agent_id)
    if not open_mesh:
        exposed = exposed_links(Fleet(tuple(chosen), signing=task.keys.rule))
        refuse_exposed(exposed, str(fleet or "FILE"), task.keys.trust)
    steps = task.steps(speed, height, box)
    ticker = Ticker(Clock.starting_now(speedup), task.tick_s)

    def told(text: str) -> None:
        console.say(f"  {text}", style="dim")

    failed = False
    with Interrupts() as ctrl_c:
        for vehicle in chosen:
            console.say(_headline(vehicle, steps))
            flight = StepFlight(steps, vehicle.response, task.tick_s, task.fence, task.origin)
            down = fly(vehicle, flight, ticker, told, ctrl_c, task.keys)
            if ctrl_c.count:
                how = f"{ctrl_c.first}: {'landed' if down else 'left to its own failsafe'}"
                console.say(f"  {how}", style="bold red")
                break
            measured = _result(console, vehicle, flight)
            failed |= measured is None
            if measured and task.file and not dry_run:
                write_response(task.file, vehicle.id, measured)
                console.say(f"  written into {task.file}")
            if not down:
                console.say(
                    "the vehicle is not disarmed: the next one does not take off", style="bold red"
                )
                break
    raise typer.Exit(130 if ctrl_c.count else int(failed))


def _headline(vehicle: FleetAgent, steps: Steps) -> str:
    return (
        f"agent {vehicle.id}: {vehicle.autopilot}, sysid {vehicle.sysid},"
        f" {vehicle.endpoint or vehicle.vehicle}; steps of {steps.speed_mps:g} m/s for"
        f" {steps.duration_s:.0f} s, {steps.height_m:g} m high, within {steps.box_m:g} m"
    )


def _result(console: PlainConsole, vehicle: FleetAgent, flight: StepFlight) -> Response | None:
    """Show what was found; None where it can't be flown with."""
    from swarm_ctl.core.identification.fit import fit
    from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS

    ended = flight.ended
    why = "stopped" if ended is None else "" if ended.outcome == "completed" else ended.reason
    why = why or flight.missing
    if why:
        console.say(f"  not measured: {why}", style="bold red")
        return None
    found = fit(flight.legs, AUTOPILOT_KINDS[vehicle.autopilot].response)
    for line in described(found, flight.legs):
        console.say(f"  {line}")
    console.warn(found.warnings)
    if found.usable:
        return found.rounded
    console.say("  not usable: it does not answer like dead time and lag", style="bold red")
    return None


def described(found: Fit, legs: Sequence[Leg]) -> list[str]:
    """The figures in words."""
    r = found.rounded
    typical = "" if found.limited else " (the typical one: the steps do not tell)"
    dead_s, lag_s, limit = r.dead_time_s, r.lag_s, f"{r.acceleration_mps2:g}"
    times = f"dead_time_s: {dead_s:g}, lag_s: {lag_s:g}"
    known = f"dead time {dead_s:.2f} s, lag {lag_s:.2f} s, together known to {r.doubt_s:.2f} s"
    lines = [
        f"response: {{{times}, acceleration_mps2: {limit}, doubt_s: {r.doubt_s:g}}}",
        f"{known}; acceleration limit {limit} m/s2{typical}",
        f"residual {found.residual_mps:.2f} m/s, {found.share:.0%} of the step",
        f"stop point off by {found.stop_rms_m:.2f} m (rms), {found.stop_most_m:.2f} m at most",
    ]
    for kind in dict.fromkeys(leg.kind for leg in legs):
        alone = [
            (leg.way, part)
            for leg, part in zip(legs, found.spread, strict=True)
            if leg.kind == kind
        ]
        ways = " / ".join(way for way, _ in alone)
        dead = " / ".join(f"{part.dead_time_s:.2f}" for _, part in alone)
        lag = " / ".join(f"{part.lag_s:.2f}" for _, part in alone)
        lines.append(f"  {kind} alone ({ways}): {dead} s, {lag} s")
    return lines
