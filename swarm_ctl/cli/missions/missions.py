"""`swarm-ctl missions`: the ready missions, listed or copied; `plan`: one as data for the drones'
computers; `schema`: the JSON Schema of mission files, for editors and other tools."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import FleetFile, MissionFile, option
from swarm_ctl.cli.shared.writable import require_writable
from swarm_ctl.errors import InputError
from swarm_ctl.files import replacing
from swarm_ctl.mission import ready

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
    from swarm_ctl.mission.compile.loader import load
    from swarm_ctl.mission.compile.plan_file import named_by_hash, plan_to_json
    from swarm_ctl.runfolder.files import write_whole

    console = PlainConsole()
    loaded = load(mission, fleet=fleet)
    console.warn(loaded.warnings)
    require_writable(out, "choose with --out")
    write_whole(out, plan_to_json(loaded.plan, loaded.fleet))
    agents, name = len(loaded.plan.agents), named_by_hash(loaded.plan, loaded.fleet)
    console.say(f"plan: {out}, {agents} agents, {name}; swarm-ctl agent {out} --id ID")


def schema() -> None:
    """Print the JSON Schema of mission files.

    Example:

    \b
        swarm-ctl schema > mission.schema.json
    """
    from swarm_ctl.mission.mission_file import json_schema

    typer.echo(json.dumps(json_schema(), indent=2))
