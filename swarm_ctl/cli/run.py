"""`swarm-ctl run`: fly a mission from one terminal."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from pathlib import Path
from typing import Annotated, TextIO

import typer
from rich.console import Console

from swarm_ctl.mission.compile.loader import load


def run(
    mission: Annotated[Path, typer.Argument(help="The mission file, e.g. missions/hexagon.yaml.")],
    speedup: Annotated[
        float,
        typer.Option(min=0.1, max=100.0, help="Mission seconds per second of the wall clock."),
    ] = 1.0,
    headless: Annotated[
        bool, typer.Option("--headless", help="Plain log lines instead of the dashboard.")
    ] = False,
    json: Annotated[
        bool, typer.Option("--json", help="One line of JSON a second on stdout, nothing else.")
    ] = False,
    metrics: Annotated[
        int | None,
        typer.Option(min=1, max=65535, help="Prometheus metrics on this port of 127.0.0.1."),
    ] = None,
    fleet: Annotated[
        Path | None, typer.Option(help="A fleet file to fly with instead of the mission's own.")
    ] = None,
    runs: Annotated[Path, typer.Option(help="Where run folders are made.")] = Path("runs"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulator.")] = 1,
    record_hz: Annotated[
        str,
        typer.Option(
            help="The most that is recorded of each agent's topics, e.g. state=5,truth=2; else all."
        ),
    ] = "",
    report: Annotated[bool, typer.Option(help="Make the report at the end.")] = True,
    tlog: Annotated[bool, typer.Option(help="Keep each vehicle's MAVLink frames.")] = True,
) -> None:
    """Fly a mission: starts a simulator (for vehicles without an endpoint), the agents and a ground
    station.

    Ctrl-C lands the swarm and waits for it; a second Ctrl-C stops everything at once.

    Exit codes: 0 completed, 1 mission failed, 2 bad input, 3 something did not start, 130 landed by
    Ctrl-C.

    Examples:

        swarm-ctl run missions/hexagon.yaml

        swarm-ctl run missions/hexagon.yaml --speedup 5 --headless

        swarm-ctl run missions/hexagon.yaml --json | jq .verdict
    """
    from swarm_ctl.recording.topics import rates
    from swarm_ctl.report.page.summary_table import render_summary
    from swarm_ctl.runtime.launch.supervisor import Options, fly
    from swarm_ctl.runtime.station.screens import Show, shown

    show = shown(headless=headless, json=json)
    console = Console(highlight=False, stderr=json)
    if show is Show.DASHBOARD and not console.is_terminal:
        show = Show.LOG
    loaded = load(mission, fleet=fleet)
    for warning in loaded.warnings:
        console.print(f"warning: {warning}", style="yellow", soft_wrap=True)

    def say(text: str) -> None:
        with contextlib.suppress(OSError):  # whoever read our output is gone; the swarm flies on
            console.print(text, soft_wrap=True)

    options = Options(speedup, show, runs, seed, rates(record_hz), tlog, metrics)
    result = fly(loaded, options, say)
    console.print(render_summary(result.summary))
    console.print(f"summary: {result.folder / 'summary.json'}", soft_wrap=True)
    if report:
        _report(result.folder, sys.stderr if json else sys.stdout)
    if result.summary.outcome != "completed":
        console.print(
            f"{result.summary.outcome}: {result.summary.reason}", style="bold red", soft_wrap=True
        )
    raise typer.Exit(130 if result.interrupts else {"completed": 0}.get(result.summary.outcome, 1))


def _report(folder: Path, to: TextIO) -> None:
    """In a process of its own: whatever happens to the figures, the run's result stands."""
    subprocess.run(
        [sys.executable, "-m", "swarm_ctl.cli.main", "report", str(folder)], check=False, stdout=to
    )
