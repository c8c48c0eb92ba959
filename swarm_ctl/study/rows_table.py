"""A study's rows as tables: shares with their confidence intervals, a column a cell."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import Final

import numpy as np
from rich.table import Table

from swarm_ctl.study.parameter_space import Study
from swarm_ctl.study.rows import Row

_Z95: Final = 1.959963984540054
_REST: Final = 0.05
_SOON: Final = 1.3


def exact_interval(hits: int, of: int) -> tuple[float, float]:
    """The 95 % confidence interval of a share, exact (Clopper and Pearson); (0, 1) for nothing."""
    return 1 - _most(of - hits, of), _most(hits, of)


def _most(hits: int, of: int) -> float:
    """The share with which so few hits or fewer have a probability of 2.5 %."""
    if hits == of:
        return 1.0
    low, high = 0.0, 1.0
    while (middle := (low + high) / 2) not in (low, high):
        low, high = (middle, high) if _tail(hits, of, middle) > _REST / 2 else (low, middle)
    return high


def _tail(hits: int, of: int, p: float) -> float:
    """The probability of so few hits or fewer; the shorter sum, of `hits` or of what is above."""
    if 2 * hits > of:
        return 1 - _tail(of - hits - 1, of, 1 - p)
    one, other, all_ways = math.log(p), math.log1p(-p), math.lgamma(of + 1)
    return math.fsum(
        math.exp(
            all_ways - math.lgamma(k + 1) - math.lgamma(of - k + 1) + k * one + (of - k) * other
        )
        for k in range(hits + 1)
    )


def share(hits: int, of: int) -> str:
    """`1.2 % (0.8 to 1.7)`."""
    low, high = exact_interval(hits, of)
    return f"{100 * hits / max(of, 1):.3g} % ({100 * low:.3g} to {100 * high:.3g})"


def quantile(values: Sequence[float], percent: float, digits: int = 1) -> str:
    """`12.3 (11.9 to 13.0)`: a percentile, and its 95 % interval by the ranks that it may have, by
    the normal approximation of the binomial; an end beyond all values is said to be `-`."""
    if not values:
        return "-"
    ordered = sorted(values)
    ends = (
        f"{ordered[k]:.{digits}f}" if 0 <= k < len(ordered) else "-"
        for k in _ranks(len(ordered), percent / 100)
    )
    return f"{np.percentile(ordered, percent):.{digits}f} ({' to '.join(ends)})"


def middle(values: Sequence[float]) -> tuple[float, float, float]:
    """The median between the ends of its 95 % interval, as in `quantile`, each within the values;
    NaN of none."""
    if not values:
        return math.nan, math.nan, math.nan
    ordered, most = sorted(values), len(values) - 1
    low, high = (ordered[min(max(k, 0), most)] for k in _ranks(len(ordered), 0.5))
    return low, float(np.median(ordered)), high


def _ranks(count: int, p: float) -> tuple[int, int]:
    half = _Z95 * math.sqrt(count * p * (1 - p))
    return math.floor(count * p - half) - 1, math.ceil(count * p + half)


def tables(
    study: Study, rows: Iterable[Row], by: tuple[str, ...] = (), *, width: int = 100
) -> list[Table]:
    """A line for each figure and a column for each combination of the lists `by` (of what was
    varied, where not given), the last varying fastest; as many tables of at most `width`
    characters as that takes."""
    names = by or study.varied or ("n", "vehicle")
    cells, groups = study.cells(), defaultdict[tuple[str, ...], list[Row]](list)
    for row in rows:
        groups[tuple(str(getattr(cells[row["cell"]], name)) for name in names)].append(row)
    places = [list(map(str, getattr(study, name))) for name in names]
    keys = sorted(groups, key=lambda key: [p.index(v) for p, v in zip(places, key, strict=True)])
    silent, woods = study.with_silent, study.with_woods
    left_out = {*(() if silent else _SILENT), *(() if woods else _WOODS)}
    lines = [line for line in _LINES if line[0] not in left_out]
    columns = [
        [*key, str(len(groups[key])), *(tell(groups[key]) for _, tell in lines)] for key in keys
    ]
    heads = [*names, "missions", *(name for name, _ in lines)]
    room, first = [width - max(map(len, heads)) - 4], 0
    found: list[Table] = []
    for k, column in enumerate(columns):  # as many columns side by side as have room
        room[-1] -= max(map(len, column)) + 3
        if room[-1] < 0 and k > first:
            found.append(_side_by_side(heads, columns[first:k], len(names)))
            first = k
            room.append(width - max(map(len, heads)) - 4 - max(map(len, column)) - 3)
    found.append(_side_by_side(heads, columns[first:], len(names)))
    found[0].title = f"{study.rows} missions, seed {study.seed}; 95 % confidence intervals"
    return found


def _side_by_side(heads: list[str], columns: list[list[str]], named: int) -> Table:
    found = Table(show_header=False)
    for _ in range(1 + len(columns)):
        found.add_column(justify="left" if not found.columns else "right", no_wrap=True)
    for k, cells in enumerate(zip(heads, *columns, strict=True)):
        found.add_row(*cells, end_section=k == named - 1)
    return found


def _share_of(rows: list[Row], name: str) -> str:
    """Of the rows in which the column is not zero."""
    return share(sum(row[name] > 0 for row in rows), len(rows))


def _alive(rows: list[Row]) -> list[Row]:
    """The missions in which no agent died."""
    return [row for row in rows if row["smallest_silent_units"] == math.inf]


def _with_silent(rows: list[Row]) -> list[Row]:
    return [row for row in rows if row["smallest_silent_units"] < math.inf]


def _hit(rows: list[Row]) -> str:
    found = _with_silent(rows)
    return share(sum(row["hit"] for row in found), len(found)) if found else "-"


def _time(rows: list[Row], q: int) -> str:
    return quantile([row["time_s"] for row in _alive(rows) if row["converged"]], q)


def _soon(rows: list[Row]) -> str:
    found = _alive(rows)
    return share(sum(r["converged"] and r["over_shortest"] <= _SOON for r in found), len(found))


_LINES: Final[tuple[tuple[str, Callable[[list[Row]], str]], ...]] = (
    ("under r_in", lambda rows: _share_of(rows, "collided")),
    ("smallest distance [units]", lambda rows: f"{min(row['smallest_units'] for row in rows):.3f}"),
    ("silent agent hit", _hit),
    ("formed", lambda rows: _share_of(_alive(rows), "converged")),
    ("formed, some silent", lambda rows: _share_of(_with_silent(rows), "converged")),
    ("stuck", lambda rows: _share_of(_alive(rows), "stuck")),
    ("time to form, median [s]", lambda rows: _time(rows, 50)),
    ("time to form, 95 % [s]", lambda rows: _time(rows, 95)),
    ("link broken", lambda rows: _share_of(rows, "links_broken")),
    ("link that fits broken", lambda rows: _share_of(rows, "kept_broken")),
    ("swarm fell apart", lambda rows: _share_of(rows, "parted")),
    ("overspeed", lambda rows: _share_of(rows, "sigma_overspeed")),
    ("zone entered", lambda rows: _share_of(rows, "entered")),
    (
        "smallest distance to a zone [units]",
        lambda rows: f"{min(row['smallest_zone_units'] for row in rows):.3f}",
    ),
    ("within 1.3 of the shortest time", lambda rows: _soon(rows)),
    (
        "time over the shortest, median",
        lambda rows: quantile([r["over_shortest"] for r in _alive(rows) if r["converged"]], 50, 2),
    ),
    (
        "ticks changed by the filter",
        lambda rows: f"{100 * sum(r['touched_share'] for r in rows) / len(rows):.3g} %",
    ),
)
"""Times and what formed: of missions in which no agent died. A link fits whose slots are within
0.9 r."""
_WOODS: Final = (
    *("zone entered", "smallest distance to a zone [units]"),
    *("within 1.3 of the shortest time", "time over the shortest, median"),
)
_SILENT: Final = ("silent agent hit", "formed, some silent")
