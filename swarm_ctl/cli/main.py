"""The `swarm-ctl` command: one module a subcommand, one place for errors."""

from __future__ import annotations

import os
import sys
from importlib import metadata
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from swarm_ctl.cli.agent import agent
from swarm_ctl.cli.keys import keys
from swarm_ctl.cli.measure import measure
from swarm_ctl.cli.paper import paper
from swarm_ctl.cli.replay import replay
from swarm_ctl.cli.report import compare, report
from swarm_ctl.cli.run import run
from swarm_ctl.cli.schema import schema
from swarm_ctl.cli.send import send
from swarm_ctl.cli.sim import sim
from swarm_ctl.cli.station import station
from swarm_ctl.cli.study import study
from swarm_ctl.cli.validate import validate
from swarm_ctl.errors import SwarmError

app = typer.Typer(
    name="swarm-ctl",
    help="Fly a formation of drones from one terminal.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback()
def top(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and exit.", is_eager=True)
    ] = False,
) -> None:
    """Fly a formation of drones from one terminal."""
    if version:
        sys.stdout.write(f"swarm-ctl {metadata.version('swarm-ctl')}\n")
        raise typer.Exit


for command in (
    run,
    validate,
    agent,
    station,
    sim,
    measure,
    report,
    replay,
    compare,
    study,
    paper,
    schema,
    keys,
):
    app.command()(command)
app.command(context_settings={"ignore_unknown_options": True})(
    send
)  # `move -20 35`: a number, not an option


def main() -> None:
    """Run the command line; our own errors become one message and their exit code, without a
    traceback."""
    try:
        app()
    except SwarmError as error:
        Console(stderr=True, highlight=False).print(
            Text(f"error: {error}", style="red"), soft_wrap=True
        )
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:
        os.dup2(
            os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno()
        )  # nothing more to say, and no traceback about it
        sys.exit(141)  # as a shell reports SIGPIPE


if __name__ == "__main__":
    main()
