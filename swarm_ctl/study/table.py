"""A study's rows as a table: shares with their confidence intervals, one line a cell."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import Any, Final

import numpy as np
from rich.table import Table

from swarm_ctl.study.rows import Row
from swarm_ctl.study.space import Study

_Z95: Final = 1.959963984540054


def wilson(hits: int, of: int) -> tuple[float, float]:
    """The 95 % confidence interval of a share (Wilson's score interval); (0, 1) for nothing."""
    if of == 0:
        return 0.0, 1.0
    share, zz = hits / of, _Z95**2
    centre = (share + zz / (2 * of)) / (1 + zz / of)
    half = _Z95 / (1 + zz / of) * math.sqrt(share * (1 - share) / of + zz / (4 * of * of))
    return (0.0 if hits == 0 else centre - half), (1.0 if hits == of else centre + half)


def share(hits: int, of: int) -> str:
    """`1.2 % (0.8 to 1.7)`."""
    low, high = wilson(hits, of)
    return f"{100 * hits / max(of, 1):.3g} % ({100 * low:.3g} to {100 * high:.3g})"


def table(study: Study, rows: Iterable[Row]) -> Table:
    """One line a cell: what was varied, and how its missions went."""
    found = Table(title=f"{study.rows} missions, seed {study.seed}; shares with 95 % confidence intervals")
    for name in (*(study.varied or ("n", "vehicle")), "missions"):
        found.add_column(name)
    for name in ("under r_in", "smallest", "formed", "median s", "p95 s", "a link broken", "parted", "overspeed"):
        found.add_column(name, justify="right")
    cells = study.cells()
    for index, group in groupby(rows, lambda row: row["cell"]):
        cell = cells[index]
        what = (str(getattr(cell, name)) for name in study.varied or ("n", "vehicle"))
        found.add_row(*what, *_line(list(group)))
    return found


def _line(rows: list[Row]) -> Iterator[str]:
    count = len(rows)
    yield str(count)
    yield share(_sum(rows, "collided"), count)
    yield f"{min(row['smallest'] for row in rows):.3f}"
    yield share(_sum(rows, "converged"), count)
    times = [row["time_s"] for row in rows if row["converged"]]
    yield from (f"{np.percentile(times, q):.1f}" if times else "-" for q in (50, 95))
    yield share(sum(row["links_broken"] > 0 for row in rows), count)
    yield share(_sum(rows, "parted"), count)
    yield share(sum(row["sigma_overspeed"] > 0 for row in rows), count)


def _sum(rows: list[Row], name: str) -> Any:
    return sum(row[name] for row in rows)
