"""How far `tune` may go: missions at the limits of `core/swarm/gain_update.py`, and beyond them.

    python -m tests.bench.bench_gains [--missions 50] [--processes 2]

Without the filter: n = 4, 6, 9, kappa = 5, 10, 20, rings and grids, random starts and slots;
vehicles with 0.45 s of dead time and 0.55 s of lag, known to the agents; states 0.1 s late, 10 %
lost. With it: n = 2 to 50, random starts and crossings; vehicles up to 0.15 s off their model,
states up to 0.2 s late, up to 20 % lost. Shares with exact 95 % intervals.
"""

from __future__ import annotations

import argparse
import multiprocessing
from itertools import chain
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from swarm_ctl.core.swarm.gain_update import (
    DELTA_A_AT_MOST,
    DELTA_L_AT_MOST,
    H_AT_MOST,
    H_SAFE_AT_MOST,
    PLAIN_RATE_AT_MOST,
)
from swarm_ctl.study.batch.batch import blocks, draw
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.parameter_space import Cell, Study
from swarm_ctl.study.rows_table import share

LIMIT_S: Final = 120.0
BARE: Final[dict[str, Any]] = {
    "safety": ("off",),
    "n": (4, 6, 9),
    "shape": ("ring", "grid"),
    "slots": ("random",),
    "kappa": ("5", "10", "20"),
    "dead_time_s": ("0.45",),
    "lag_s": ("0.55",),
    "delay_s": ("0.1",),
    "loss": ("0.1",),
}
FILTERED: Final[dict[str, Any]] = {
    "n": (2, 4, 8, 16, 32, 50),
    "start": ("random", "crossing"),
    "slots": ("given",),
    "shape": ("grid",),
    "start_spacing": 1.5,
    "dead_time_s": ("0.2:0.5",),
    "lag_s": ("0.3:0.6",),
    "delay_s": ("0:0.2",),
    "loss": ("0:0.2",),
}
PLAIN: Final = BARE | {"compensation": ("none",), "kappa": ("10",)}
LAW: Final = {"delta_a": DELTA_A_AT_MOST, "delta_l": DELTA_L_AT_MOST}
ROWS: Final[dict[str, tuple[dict[str, Any], dict[str, float], float]]] = {
    "no filter, at the limits": (BARE, LAW, H_AT_MOST),
    "delta_a 1": (BARE, LAW | {"delta_a": 1.0}, H_AT_MOST),
    "delta_a 5": (BARE, LAW | {"delta_a": 5.0}, H_AT_MOST),
    "delta_l 2.5": (BARE, LAW | {"delta_l": 2.5}, H_AT_MOST),
    "h 0.06": (BARE, LAW, 0.06),
    "h 0.2": (BARE, LAW, 0.2),
    "filter, at the limits": (FILTERED, LAW, H_SAFE_AT_MOST),
    "on positions, at the limits": (PLAIN, LAW, PLAIN_RATE_AT_MOST / 10),
    "four times as much": (PLAIN, LAW, 4 * PLAIN_RATE_AT_MOST / 10),
}


def smallest(block: tuple[Cell, int, int]) -> list[float]:
    """The smallest distance of each mission [units]."""
    return [float(distance) for distance in fly(draw(*block)).smallest]


def main() -> None:
    """One line for each set of gains."""
    arguments = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    arguments.add_argument("--missions", type=int, default=50, help="of each combination")
    arguments.add_argument("--processes", type=int, default=2)
    asked = arguments.parse_args()
    table = Table("gains", "missions", "under r_in", "smallest [units]")
    with multiprocessing.get_context("spawn").Pool(asked.processes) as pool:
        for what, (common, law, h) in ROWS.items():
            given = {"law": law, "h": (str(h),), "missions": asked.missions, "limit_s": LIMIT_S}
            study = Study.model_validate(common | given)
            found = list(chain(*pool.imap(smallest, blocks(study))))
            under = sum(distance < study.law.r_in for distance in found)
            table.add_row(
                what, str(len(found)), f"{under}: {share(under, len(found))}", f"{min(found):.3f}"
            )
    Console(highlight=False, width=120).print(table)


if __name__ == "__main__":
    main()
