"""`swarm-ctl missions`: the ready missions, listed or copied; `validate`: what it flies; `plan`:
one as data for the drones' computers; `schema`: for editors and other tools."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import (
    FleetFile,
    MissionFile,
    VehicleKinds,
    option,
    require_writable,
    switch,
)
from swarm_ctl.errors import InputError
from swarm_ctl.files import replacing
from swarm_ctl.mission import ready

if TYPE_CHECKING:
    from swarm_ctl.mission.compile.forecast import StepForecast
    from swarm_ctl.mission.compile.loader import LoadedMission

missions = typer.Typer(name="missions", rich_markup_mode=None)


@missions.callback(invoke_without_command=True)
def listed(context: typer.Context) -> None:
    """List the ready missions, or copy one.

    Example:

    \b
        swarm-ctl missions
        swarm-ctl run hexagon
        swarm-ctl missions copy hexagon
    """
    if context.invoked_subcommand is not None:
        return
    found = ready.ready_missions()
    width = max(map(len, found), default=0)
    for name, path in found.items():
        sys.stdout.write(f"{name:{width}}  {ready.shows(path)}\n")


@missions.command()
def copy(
    name: Annotated[str, typer.Argument(metavar="NAME", help="A ready mission, e.g. hexagon.")],
    to: Annotated[
        Path | None, typer.Argument(metavar="FILE", help="Where to.  [default: NAME.yaml]")
    ] = None,
) -> None:
    """Copy a ready mission into a file of your own, to change it.

    Example:

    \b
        swarm-ctl missions copy hexagon
        swarm-ctl missions copy crossing mine.yaml
    """
    source = ready.ready_mission(name)
    target = to or Path(source.name)
    if target.is_dir():
        target = target / source.name
    if target.exists():
        raise InputError(f"{target}: is there already; allowed: a new file")
    with replacing(target) as file:
        file.write(source.read_bytes())
    PlainConsole(stderr=True).say(f"{target}: fly it with swarm-ctl run {target}")


def plan(
    mission: MissionFile,
    fleet: FleetFile = None,
    out: Annotated[Path, option("FILE", "The plan file to write.")] = Path("plan.json"),
) -> None:
    """Write a mission as a plan file for the drones' computers.

    The plan file holds all that `swarm-ctl agent` needs: the checked mission with its slots dealt,
    a hash, and the fleet's endpoints. An agent that flies it needs only the core of swarm-ctl.

    Examples:

    \b
        swarm-ctl plan missions/square.yaml --fleet outdoors.yaml
        swarm-ctl plan missions/hexagon.yaml --out hexagon.json
    """
    from swarm_ctl.mission.compile.forecast import forecast, refuse_too_close
    from swarm_ctl.mission.compile.loader import load
    from swarm_ctl.mission.compile.plan_file import named_by_hash, plan_to_json
    from swarm_ctl.mission.fleet.fleet_file import file_of
    from swarm_ctl.runfolder.files import write_whole

    console = PlainConsole()
    loaded = load(mission, fleet=fleet)
    console.warn(loaded.warnings)
    refuse_too_close(loaded, forecast(loaded.plan))
    require_writable(out, "choose with --out")
    for read in (mission, fleet or file_of(mission)):
        if read is not None and out.exists() and read.exists() and out.samefile(read):
            raise InputError(f"--out {out}: the plan is made from this file; choose another one")
    write_whole(out, plan_to_json(loaded.plan, loaded.fleet))
    plan, name = loaded.plan, named_by_hash(loaded.plan, loaded.fleet)
    which = f"plan {plan.fingerprint()}, with its fleet {name}"
    start = f"swarm-ctl agent {shlex.quote(str(out))} --id ID"
    console.say(f"plan: {out}, {len(plan.agents)} agents, {which}; {start}")


def schema() -> None:
    """Print the JSON Schema of mission files.

    Example:

    \b
        swarm-ctl schema > mission.schema.json
    """
    from swarm_ctl.mission.mission_file import json_schema

    typer.echo(json.dumps(json_schema(), indent=2))


def validate(
    mission: MissionFile,
    fleet: FleetFile = None,
    vehicles: VehicleKinds = None,
    full: Annotated[
        bool, switch("--full", "All agents and links, however many there are.")
    ] = False,
    plot: Annotated[Path | None, option("FILE", "Draw it into a .png, .svg or .pdf.")] = None,
) -> None:
    """Check a mission file and show what would be flown.

    Shows agents, slots, steps with their expected times, graph, smallest distances, limits and
    warnings. A mission with mistakes is refused with all of them, and one in
    which the forecast has a pair under r_in.

    Examples:

    \b
        swarm-ctl validate missions/hexagon.yaml
        swarm-ctl validate missions/thirtytwo.yaml --full --plot thirtytwo.png
    """
    from swarm_ctl.mission.compile.forecast import forecast, refuse_too_close
    from swarm_ctl.mission.compile.loader import load

    console = PlainConsole()
    loaded = load(mission, fleet=fleet, vehicles=vehicles)
    kinds = {agent.autopilot for agent in loaded.fleet.agents}
    forecasts = forecast(loaded.plan, kinds)
    refuse_too_close(loaded, forecasts)
    show(console, loaded, forecasts, full=full)
    if plot is not None:
        from swarm_ctl.report.page.mission_plot import plot as draw

        require_writable(plot, "choose with --plot")
        draw(loaded.plan, plot)
        console.say(f"picture  {plot}")


def show(
    console: PlainConsole, loaded: LoadedMission, forecasts: Sequence[StepForecast], *, full: bool
) -> None:
    """Print a checked mission."""
    from swarm_ctl.report.page.mission_table import mission_parts

    for part in mission_parts(loaded, forecasts, full=full):
        console.print(part, soft_wrap=not isinstance(part, Table))
