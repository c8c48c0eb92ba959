"""Failure curves of a study: what fails over one quantity. Imports matplotlib: import it late."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from matplotlib.axes import Axes

from swarm_ctl.errors import InputError
from swarm_ctl.report.page.drawing import R_IN, bounds, grid, legend, line_style, write
from swarm_ctl.study.parameter_space import Range, Study
from swarm_ctl.study.rows import Row
from swarm_ctl.study.rows_table import exact_interval

_KINDS: Final = (".svg", ".png")
_LABELS: Final = {
    "n": "number of agents",
    "loss": "share of states lost",
    "h": "consensus gain h",
    "silent_agents": "agents that die",
}

Groups = Mapping[str, Mapping[float, list[Row]]]
"""By line, by value on the x axis."""


def axis(study: Study, by: tuple[str, ...], path: Path) -> str:
    """The last list of numbers in `by`, over which curves are drawn.

    Raises:
        InputError: nothing of `by` is a list of numbers, or the file is neither .svg nor .png.
    """
    if path.suffix not in _KINDS:
        raise InputError(f"--curves {path}: allowed: {', '.join(_KINDS)}")
    over = next((name for name in reversed(by) if _is_axis(getattr(study, name))), None)
    if over is None:
        raise InputError("--curves: no list of numbers is varied here; allowed: --delay 0,0.1,0.2")
    return over


def draw_curves(study: Study, rows: Iterable[Row], by: tuple[str, ...], path: Path) -> None:
    """Three panels over the `axis` of `by`, a line for each combination of the others: missions
    with a pair under `r_in` [%], missions that did not form [%], both with 95 % intervals, and the
    smallest distance [units]. InputError as for `axis`."""
    over = axis(study, by, path)
    others = [name for name in by if name != over]
    groups = _grouped(study, rows, over, others)
    made, panels = grid(
        f"{study.rows} missions; 95 % intervals", 3, 1, 5.6, 6.0 if len(groups) < 16 else 7.0
    )
    for axes, (label, values) in zip(panels, _PANELS.items(), strict=True):
        for k, (_, line) in enumerate(groups.items()):
            values(axes, line, **line_style(k))
        axes.set_ylabel(label)
        axes.margins(y=0.1)
        axes.set_ylim(bottom=0)
    bounds(panels[-1], [(R_IN, study.law.r_in)])
    panels[-1].set_xlabel(_LABELS.get(over, _named(over)))
    if others:
        for drawn, name in zip(panels[1].get_lines(), groups, strict=True):
            drawn.set_label(name)
        legend(panels[1], len(groups), ", ".join(map(_named, others)))
    write(made, path)


def _grouped(study: Study, rows: Iterable[Row], over: str, others: list[str]) -> Groups:
    cells = study.cells()
    groups: dict[str, dict[float, list[Row]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        cell = cells[row["cell"]]
        line = ", ".join(str(getattr(cell, name)) for name in others)
        groups[line][_number(getattr(cell, over))].append(row)
    return groups


def _shares(axes: Axes, line: Mapping[float, list[Row]], failed: str, **style: Any) -> None:
    places = sorted(line)
    hits = [sum(_is(row, failed) for row in line[x]) for x in places]
    ends = [exact_interval(hit, len(line[x])) for hit, x in zip(hits, places, strict=True)]
    shares = [100 * hit / len(line[x]) for hit, x in zip(hits, places, strict=True)]
    axes.plot(places, shares, marker="o", markersize=3, **style)
    low, high = ([100 * end[k] for end in ends] for k in (0, 1))
    # lines, not bands: those of several curves would hide each other
    axes.vlines(places, low, high, linewidth=0.9, alpha=0.5, color=style["color"])


def _is(row: Row, failed: str) -> bool:
    return not row["converged"] if failed == "unformed" else row["collided"] > 0


def _under(axes: Axes, line: Mapping[float, list[Row]], **style: Any) -> None:
    _shares(axes, line, "collided", **style)


def _unformed(axes: Axes, line: Mapping[float, list[Row]], **style: Any) -> None:
    _shares(axes, line, "unformed", **style)


def _smallest(axes: Axes, line: Mapping[float, list[Row]], **style: Any) -> None:
    places = sorted(line)
    distances = [min(row["smallest_units"] for row in line[x]) for x in places]
    axes.plot(places, distances, marker="o", markersize=3, **style)


_PANELS: Final[Mapping[str, Callable[..., None]]] = {
    f"under ${R_IN}$ [%]": _under,
    "not formed [%]": _unformed,
    "smallest [units]": _smallest,
}


def _number(entry: Any) -> float:
    """Of an entry that is one number; NaN of a word, and of a range that missions draw from."""
    if isinstance(entry, Range):
        return entry.low if entry.low == entry.high else math.nan
    return float(entry) if isinstance(entry, int | float) else math.nan


def _is_axis(values: tuple[Any, ...]) -> bool:
    return len(values) > 1 and not any(math.isnan(_number(value)) for value in values)


def _named(name: str) -> str:
    """`dead_time_s` as `dead time [s]`."""
    for end, unit in (("_mps2", "m/s²"), ("_mps", "m/s"), ("_s", "s"), ("_m", "m")):
        if name.endswith(end):
            return f"{name.removesuffix(end).replace('_', ' ')} [{unit}]"
    return name.replace("_", " ")
