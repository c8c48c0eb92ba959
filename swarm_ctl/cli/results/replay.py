"""`swarm-ctl replay`: a recorded flight again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import Headless, Json, complete_runs, option, recorded_run


def replay(
    run: Annotated[
        Path | None,
        typer.Argument(
            metavar="RUN",
            help="A run folder or a recording.mcap.  [default: newest in runs/]",
            autocompletion=complete_runs,
        ),
    ] = None,
    speed: Annotated[
        float, option("FACTOR", "Mission seconds per second of the wall clock.", min=0.25, max=50.0)
    ] = 1.0,
    start: Annotated[
        str, option("TIME", "Where to begin: seconds, MIN:SEC or end.", "--from")
    ] = "start",
    headless: Headless = False,
    json: Json = False,
) -> None:
    """Play a recorded flight on the dashboard.

    Keys pause it, seek in it and change its speed; screens and alarms are those of the flight. A
    recording that was cut off by a kill, or is damaged, plays as far as it can be read; it is never
    written to: a whole copy for other tools is made beside it.

    Examples:

    \b
        swarm-ctl replay runs/20260101-120000-hexagon --speed 5
        swarm-ctl replay --from 1:20
        swarm-ctl replay --json --speed 50 | jq .verdict
    """
    from swarm_ctl.engine.station.replay import replay as play
    from swarm_ctl.engine.station.screens import shown

    console = PlainConsole(stderr=True)
    show = shown(headless=headless, json=json)
    play(recorded_run(run, console.say), show, speed, start)
