"""`swarm-ctl report` and `swarm-ctl compare`: pages of figures from run folders."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from swarm_ctl.errors import InputError

_Run = Annotated[Path, typer.Argument(help="A run folder, e.g. runs/20260101-120000-hexagon.")]


def report(run: _Run) -> None:
    """Make the report of a run: an HTML page that needs nothing beside it, and PNG and SVG figures.

    A recording that was cut off by a kill is recovered first.
    """
    from swarm_ctl.report.page.html_page import make_report

    try:
        page = make_report(run)
    except OSError as error:
        raise InputError(f"{run}: the report can't be written: {error.strerror}") from error
    Console(highlight=False).print(f"report: {page}", soft_wrap=True)


def compare(
    runs: Annotated[list[Path], typer.Argument(help="Two or more run folders.")],
    out: Annotated[Path, typer.Option(help="The page to write.")] = Path("compare.html"),
) -> None:
    """Show several runs side by side: a table, one figure of all, and each figure of each run."""
    from swarm_ctl.report.page.html_page import comparison_table, make_comparison

    console = Console(highlight=False)
    page = make_comparison(runs, out)
    console.print(comparison_table(runs))
    console.print(f"page: {page}", soft_wrap=True)
