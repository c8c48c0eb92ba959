"""`swarm-ctl paper`: the seed paper's experiments again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import Processes, Seed, option
from swarm_ctl.cli.shared.writable import require_writable


def paper(
    out: Annotated[Path, option("FOLDER", "Where figures, rows and claims are written.")] = Path(
        "paper"
    ),
    seeds: Annotated[int, option("NUMBER", "Missions for each experiment.", min=1)] = 1000,
    seed: Seed = 1,
    processes: Processes = None,
) -> None:
    """Reproduce the paper's experiments and test its claims.

    Section VI of Mondal et al. (2017): Figs. 7-17, in the discrete form (9) and in continuous time,
    and each claim over many seeds. A run that was interrupted continues where it ended.

    Examples:

    \b
        swarm-ctl paper
        swarm-ctl paper --seeds 50 --out quick
    """
    from swarm_ctl.study.paper.reproduce import reproduce

    require_writable(out, "choose with --out")
    console = PlainConsole()
    wide = console if console.is_terminal else PlainConsole(width=160)
    reproduce(out, seeds, seed, processes, wide)
