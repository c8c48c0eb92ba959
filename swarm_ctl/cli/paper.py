"""`swarm-ctl paper`: the seed paper's experiments again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console


def paper(
    out: Annotated[Path, typer.Option(help="Folder for figures, rows and claims.")] = Path("paper"),
    seeds: Annotated[int, typer.Option(min=1, help="Missions for each experiment.")] = 1000,
    seed: Annotated[int, typer.Option(min=0)] = 1,
    processes: Annotated[int | None, typer.Option(min=1, help="All cores where not given.")] = None,
) -> None:
    """Reproduce section VI of Mondal et al. (2017): Figs. 7-17, and each claim over many seeds.

    In the discrete form (9) and in continuous time. Interrupted, it goes on where it was.
    """
    from swarm_ctl.study.paper import reproduce

    console = Console(highlight=False)
    reproduce(
        out,
        seeds,
        seed,
        processes,
        console if console.is_terminal else Console(highlight=False, width=160),
    )
