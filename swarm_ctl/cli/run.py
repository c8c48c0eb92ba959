"""`swarm-ctl run`: fly a mission from one terminal."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from swarm_ctl.mission.loader import load


def run(
    mission: Annotated[Path, typer.Argument(help="The mission file, e.g. missions/hexagon.yaml.")],
    speedup: Annotated[
        float, typer.Option(min=0.1, max=100.0, help="Mission seconds per second of the wall clock.")
    ] = 1.0,
    headless: Annotated[bool, typer.Option("--headless", help="Plain log lines instead of the live view.")] = False,
    fleet: Annotated[Path | None, typer.Option(help="A fleet file to fly with instead of the mission's own.")] = None,
    runs: Annotated[Path, typer.Option(help="Where run folders are made.")] = Path("runs"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulator.")] = 1,
    record_hz: Annotated[
        str, typer.Option(help="The most that is recorded of each agent's topics, e.g. state=5,truth=2; else all.")
    ] = "",
    report: Annotated[bool, typer.Option(help="Make the report at the end.")] = True,
    tlog: Annotated[bool, typer.Option(help="Keep each vehicle's MAVLink frames.")] = True,
) -> None:
    """Fly a mission: starts a simulator (for vehicles without an endpoint), the agents and a ground station.

    Ctrl-C lands the swarm and waits for it; a second Ctrl-C stops everything at once.

    Exit codes: 0 completed, 1 mission failed, 2 bad input, 3 something did not start, 130 landed by Ctrl-C.

    Examples:

        swarm-ctl run missions/hexagon.yaml

        swarm-ctl run missions/hexagon.yaml --speedup 5 --headless
    """
    from swarm_ctl.recording.topics import rates
    from swarm_ctl.report.table import render_summary
    from swarm_ctl.runtime.fleet import Options, fly

    console = Console(highlight=False)
    loaded = load(mission, fleet=fleet)
    for warning in loaded.warnings:
        console.print(f"warning: {warning}", style="yellow", soft_wrap=True)
    with_view = not headless and console.is_terminal

    def say(text: str) -> None:
        with contextlib.suppress(OSError):  # whoever read our output is gone; the swarm flies on
            console.print(text, soft_wrap=True)

    options = Options(speedup, not with_view, runs, seed, rates(record_hz), tlog)
    result = fly(loaded, options, say)
    console.print(render_summary(result.summary))
    console.print(f"summary: {result.folder / 'summary.json'}", soft_wrap=True)
    if report:
        _report(result.folder)
    if result.summary.outcome != "completed":
        console.print(f"{result.summary.outcome}: {result.summary.reason}", style="bold red", soft_wrap=True)
    raise typer.Exit(130 if result.interrupts else {"completed": 0}.get(result.summary.outcome, 1))


def _report(folder: Path) -> None:
    """In a process of its own: whatever happens to the figures, the run's result stands."""
    subprocess.run([sys.executable, "-m", "swarm_ctl.cli.main", "report", str(folder)], check=False)
