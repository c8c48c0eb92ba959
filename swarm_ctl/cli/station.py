"""`swarm-ctl station`: one more ground station on a swarm that flies already."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarm_ctl.errors import InputError


def station(
    run: Annotated[Path | None, typer.Argument(help="The run folder; default: the newest in runs/.")] = None,
    headless: Annotated[bool, typer.Option("--headless", help="Plain log lines instead of the live view.")] = False,
) -> None:
    """Watch a run of this machine from another terminal. Ctrl-C leaves it; the swarm flies on.

    Example:

        swarm-ctl station runs/20260101-120000-hexagon
    """
    from swarm_ctl.runtime.station_process import run_station

    folder = run if run is not None else newest_run(Path("runs"))
    raise typer.Exit(run_station(folder, None, lambda _: None, headless=headless))


def newest_run(runs: Path) -> Path:
    """The newest run folder in `runs`."""
    folders = [path.parent for path in runs.glob("*/run.json")]
    if not folders:
        raise InputError(f"no run in {runs}/; name a run folder")
    return max(folders)
