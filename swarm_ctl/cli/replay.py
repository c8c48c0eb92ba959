"""`swarm-ctl replay`: a recorded flight again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarm_ctl.cli.station import newest_run


def replay(
    run: Annotated[
        Path | None,
        typer.Argument(help="A run folder or a recording.mcap; default: the newest in runs/."),
    ] = None,
    speed: Annotated[
        float,
        typer.Option(min=0.25, max=50.0, help="Mission seconds per second of the wall clock."),
    ] = 1.0,
    start: Annotated[
        str, typer.Option("--from", help="Where to begin: seconds, MIN:SEC or end.")
    ] = "start",
    headless: Annotated[
        bool, typer.Option("--headless", help="Plain log lines instead of the dashboard.")
    ] = False,
    json: Annotated[
        bool, typer.Option("--json", help="One line of JSON a second on stdout.")
    ] = False,
) -> None:
    """Look at a recorded flight on the dashboard: pause, seek, speed. The same screens and alarms
    as in flight.

    A recording that was cut off by a kill is recovered first, and plays up to its last second.

    Examples:

        swarm-ctl replay runs/20260101-120000-hexagon --speed 5

        swarm-ctl replay --from 1:20

        swarm-ctl replay --json --speed 50 | jq .verdict
    """
    from swarm_ctl.runtime.station.replay import replay as play
    from swarm_ctl.runtime.station.screens import shown

    show = shown(headless=headless, json=json)
    folder = run if run is not None else newest_run(Path("runs"))
    raise typer.Exit(play(folder, show, speed, start))
