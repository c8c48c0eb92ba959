"""`swarm-ctl report` and `swarm-ctl compare`: pages of figures from run folders; `replay`: a
recorded flight again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import (
    Headless,
    Json,
    RunFolder,
    complete_runs,
    option,
    recorded_run,
    require_writable,
    runs_in,
)
from swarm_ctl.errors import InputError, SwarmError
from swarm_ctl.rim import explained


def report(run: RunFolder = None) -> None:
    """Make the report of a run: a page of figures.

    Writes report.html, which needs no other file, and its figures as PNG and SVG into the run
    folder. A recording that was cut off by a kill, or is damaged, is read as far as it can be, and
    never written to: a whole copy for other tools is made beside it.

    Example:

    \b
        swarm-ctl report runs/20260101-120000-hexagon
    """
    from swarm_ctl.report.page.html_page import make_report

    run = run or next(iter(runs_in(Path("runs"))), None)
    if run is None:
        raise InputError("no run in runs/; name a run folder")
    if run.is_dir():
        require_writable(run, "the report is written into the run folder: copy it")
    PlainConsole().say(f"report: {_made(run, lambda: make_report(run))}")


def compare(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN", help="Two or more run folders.", autocompletion=complete_runs
        ),
    ],
    out: Annotated[Path, option("FILE", "The page to write.")] = Path("compare.html"),
) -> None:
    """Show several runs side by side on one page.

    The page has a table of the runs, one figure of all, and each figure of each run.

    Example:

    \b
        swarm-ctl compare runs/20260101-120000-square runs/20260102-120000-square
    """
    from swarm_ctl.report.page.html_page import comparison_table, make_comparison

    if out.suffix.lower() not in (".html", ".htm"):  # a run's own file, a picture
        raise InputError(f"--out {out}: is no page; allowed: a .html file")
    require_writable(out, "choose with --out")
    console = PlainConsole()
    page = _made(out, lambda: make_comparison(runs, out))
    console.print(comparison_table(runs))
    console.say(f"page: {page}")


def _made(where: Path, make: Callable[[], Path]) -> Path:
    """The page; what is wrong with it in a line, where a run has what can't be drawn."""
    try:
        return make()
    except (SwarmError, OSError):
        raise
    except Exception as error:
        raise SwarmError(f"{where}: the page can't be made: {explained(error)}") from error


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
