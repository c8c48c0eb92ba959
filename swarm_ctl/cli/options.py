"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarm_ctl.errors import InputError

MissionFile = Annotated[
    Path, typer.Argument(metavar="MISSION", help="The mission file, e.g. missions/hexagon.yaml.")
]
FleetFile = Annotated[
    Path | None, typer.Option(metavar="FILE", help="A fleet file instead of the mission's own.")
]
RunFolder = Annotated[
    Path | None, typer.Argument(metavar="RUN", help="The run folder.  [default: newest in runs/]")
]
Headless = Annotated[
    bool, typer.Option("--headless", help="Plain log lines instead of the dashboard.")
]
Json = Annotated[bool, typer.Option("--json", help="One line of JSON a second on stdout.")]
Metrics = Annotated[
    int | None,
    typer.Option(
        metavar="PORT", min=1, max=65535, help="Prometheus metrics on this port of 127.0.0.1."
    ),
]
Speedup = Annotated[
    float,
    typer.Option(
        metavar="FACTOR", min=0.1, max=100.0, help="Mission seconds per second of the wall clock."
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")]
Processes = Annotated[
    int | None, typer.Option(min=1, help="Processes to fly with.  [default: one per core]")
]


def run_folder(given: Path | None) -> Path:
    """The run folder that was given, else the newest in `runs`."""
    if given is not None:
        return given
    folders = [path.parent for path in Path("runs").glob("*/run.json")]
    if not folders:
        raise InputError("no run in runs/; name a run folder")
    return max(folders)
