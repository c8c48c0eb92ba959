"""The paper's claims on whole missions: in how many of the rows each is tested, and broken."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from rich.table import Table

from swarm_ctl.core.kernel.law import STATUSES
from swarm_ctl.study.parameter_space import Cell, Study
from swarm_ctl.study.rows import Row, read_rows
from swarm_ctl.study.rows_table import share

KAPPA: Final = 10.0
"""Iterations a second of study time: only a scale here."""
TABLE_I_H: Final = 0.005


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim of the paper: the rows that test it, those of them that break it, and what the rows
    of a cell measure of it."""

    text: str
    tested: Callable[[Row], bool]
    broken: Callable[[Row], bool]
    measured: Callable[[list[Row], Cell], str]


def holds(broken: int, of: int) -> str:
    """The word on a claim that `broken` of `of` missions break."""
    if not of:
        return "not tested"
    return "no" if broken else "not broken"


def pair_steps(row: Row) -> int:
    """How often an agent had another one within r_out."""
    return sum(row[f"sigma_{name}"] for name in STATUSES)


def _always(_: Row) -> bool:
    return True


def _met(row: Row) -> bool:
    return pair_steps(row) > 0


def _ended(row: Row) -> bool:
    """A mission that was cut off while its shape changed says nothing of an asymptotic claim."""
    return bool(row["converged"] or row["stuck"])


def _smallest(rows: list[Row], cell: Cell) -> str:
    if not any(_met(row) for row in rows):
        return "no pair within r_out"
    return f"smallest {min(row['smallest_units'] for row in rows):.3f}, r_in {cell.law.r_in:g}"


def _times(rows: list[Row], _: Cell) -> str:
    moving = f"; {sum(not _ended(row) for row in rows)} still changed at the end"
    times = [row["time_s"] * KAPPA for row in rows if row["converged"]]
    if not times:
        return f"none{moving}"
    return f"median {np.median(times):.0f}, p95 {np.percentile(times, 95):.0f} iterations{moving}"


def _longest(rows: list[Row], cell: Cell) -> str:
    return f"longest {max(row['longest_link_units'] for row in rows):.2f}, r {cell.law.r:g}"


def _links(rows: list[Row], _: Cell) -> str:
    broken, links = (sum(row[name] for row in rows) for name in ("links_broken", "links"))
    return f"{broken} of {links} links over r"


def _gaps(rows: list[Row], _: Cell) -> str:
    pairs = sum(pair_steps(row) for row in rows)
    if not pairs:
        return "no pair within r_out"
    return f"{share(sum(row['small_gap'] for row in rows), pairs)} of {pairs} pair-steps"


CLAIMS: Final = (
    Claim("no distance under r_in", _met, lambda row: bool(row["collided"]), _smallest),
    Claim("formation reached", _ended, lambda row: not row["converged"], _times),
    Claim(
        "connectivity kept: all links within r",
        _always,
        lambda row: row["links_broken"] > 0,
        _longest,
    ),
    Claim("connectivity kept: not parted", _always, lambda row: bool(row["parted"]), _links),
    Claim("D_ub - D_lb > 2 for every pair", _met, lambda row: row["small_gap"] > 0, _gaps),
)
"""Tested: distances and bounds where two agents came within r_out at all; formation where the
mission formed or its shape came to rest."""


def claims_table(studies: Mapping[str, Study], folder: Path) -> Table:
    """Each claim against each experiment."""
    title = "Claims of the paper: share of the missions that test each which break it, 95 %"
    names = ("experiment", "claim", "broken in", "of", "share", "measured", "holds")
    table = Table(*names, title=title)
    for name, study in studies.items():
        rows = list(read_rows(folder / f"{name}.csv"))
        for cell in study.cells():
            own = [row for row in rows if row["cell"] == cell.index]
            what = f"{name}, {cell.start} starts, {cell.slots} slots"
            for claim in CLAIMS:
                tested = [row for row in own if claim.tested(row)]
                broken, of = sum(claim.broken(row) for row in tested), len(tested)
                found = (str(broken), str(of), share(broken, of) if of else "-")
                table.add_row(
                    what, claim.text, *found, claim.measured(own, cell), holds(broken, of)
                )
                what = ""
    return table
