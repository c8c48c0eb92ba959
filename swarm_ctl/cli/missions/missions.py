"""`swarm-ctl missions`: the ready missions, listed or copied."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from swarm_ctl.cli.shared.console import PlainConsole
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
