"""The same missions flown by several laws, without the safety filter and with it: the league."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from rich.console import Console
from rich.table import Table

from swarm_ctl.errors import InputError
from swarm_ctl.study.executor import run_study
from swarm_ctl.study.parameter_space import LEVELS, SafetyLevel, Study
from swarm_ctl.study.rows import Row, read_rows
from swarm_ctl.study.rows_table import exact_interval, middle, quantile, share

KINDS: Final = (".png", ".svg")
_BARE: Final[SafetyLevel] = "off"


@dataclass(frozen=True, slots=True)
class Standing:
    """A law's missions, in one way to keep apart."""

    law: str
    safety: SafetyLevel
    rows: list[Row]

    @property
    def filtered(self) -> bool:
        """The safety filter stood between."""
        return self.safety != _BARE

    def count(self, name: str) -> int:
        """Missions in which the column is not zero."""
        return sum(row[name] > 0 for row in self.rows)

    @property
    def times(self) -> list[float]:
        """Of the missions that formed [s]."""
        return [row["time_s"] for row in self.rows if row["converged"]]

    @property
    def distances(self) -> list[float]:
        """The smallest of each mission [units]."""
        return [row["smallest_units"] for row in self.rows]


def laws_of(text: str) -> list[str]:
    """`a,b,c`; InputError where it names one twice, or less than two."""
    names = text.split(",")
    if len(set(names)) < len(names) or len(names) < 2 or not all(names):
        raise InputError(f"--law {text}: allowed: different names, as in paper,orca")
    return names


def studies_of(study: Study, names: Sequence[str]) -> list[tuple[str, Study]]:
    """Each law, without the filter and with it; the same missions are drawn for all."""
    if len(study.safety) > 1:
        raise InputError("--safety: with several laws, allowed: one level; off is flown beside it")
    (level,) = study.safety
    if level == _BARE:
        level = LEVELS[-2]  # what agents fly
    shared = {name: getattr(study.law, name) for name in ("r", "r_out", "r_in")}
    fields = study.model_dump(exclude={"law", "safety"})
    offsets = {name: getattr(study.law, name) for name in ("delta_l", "delta_a")}
    return [
        (name, Study(**fields, safety=(safety,), law={"own": name, **shared, **offsets}))
        for name in names
        for safety in (_BARE, level)
    ]


def fly_league(
    study: Study,
    names: Sequence[str],
    out: Path,
    processes: int | None,
    console: Console,
    cluster: str | None = None,
) -> list[Standing]:
    """Fly what is missing. The rows of each law are beside `out`, by law and safety."""
    found = list[Standing]()
    for name, each in studies_of(study, names):
        (safety,) = each.safety
        path = out.with_name(f"{out.stem}-{name}-{safety}{out.suffix}")
        console.print(f"{name}, {'no filter' if safety == _BARE else safety}: {path}")
        run_study(each, path, processes, console, cluster)
        found.append(Standing(name, safety, list(read_rows(path))))
    return found


def ranked(places: Sequence[Standing]) -> list[str]:
    """The laws' names, the best first: by the filtered missions, fewest under r_in, then most that
    formed, then the quickest."""
    kept = {place.law: place for place in places if place.filtered}

    def badness(name: str) -> tuple[float, float, float]:
        at = kept[name]
        times = at.times
        quick = float(np.median(times)) if times else np.inf
        return at.count("collided"), -at.count("converged"), quick

    return sorted(kept, key=badness)


def table(places: Sequence[Standing]) -> Table:
    """The league: shares and medians with their 95 % intervals."""
    most = len(places[0].rows)
    found = Table(
        *("law", "filter", "under r_in", "formed", "time to form, median [s]", "95 % [s]"),
        *("smallest distance, median [units]", "least"),
        title=f"{most} missions each, the same for all; 95 % confidence intervals",
    )
    for name in ranked(places):
        for place in places:
            if place.law != name:
                continue
            count = len(place.rows)
            found.add_row(
                name if not place.filtered else "",
                "yes" if place.filtered else "no",
                share(place.count("collided"), count),
                share(place.count("converged"), count),
                quantile(place.times, 50),
                quantile(place.times, 95),
                quantile(place.distances, 50, 2),
                f"{min(place.distances):.3f}",
                end_section=place.filtered,
            )
    return found


def draw_league(places: Sequence[Standing], r_in: float, path: Path) -> None:
    """A row for each law and a panel for each figure; an open dot without the filter, a full one
    with it, and lines for the 95 % intervals. Imports matplotlib."""
    from swarm_ctl.report.page.drawing import grid, write
    from swarm_ctl.station.picture.colours import COLOURS

    names = ranked(places)
    heads = ("under $r_\\mathrm{in}$ [%]", "formed [%]", "time to form [s]", "smallest [units]")
    count = len(places[0].rows)
    made, panels = grid(
        f"{count} missions each, 95 % intervals;  ○ without the filter   ● with it",
        *(1, len(heads), 10.0, 1.2 + 0.42 * len(names)),
        share_x=False,
        share_y=True,
    )
    for place in places:
        k = names.index(place.law)
        y, face = k + (0.14 if place.filtered else -0.14), COLOURS[k % len(COLOURS)]
        for axes, (low, at, high) in zip(panels, _figures(place), strict=True):
            if np.isnan(at):
                continue
            axes.plot([low, high], [y, y], color=face, linewidth=1.6)
            fill = face if place.filtered else "white"
            axes.plot([at], [y], "o", markersize=5.5, color=face, markerfacecolor=fill)
    for axes, head in zip(panels, heads, strict=True):
        axes.set_xlabel(head)
        axes.set_xlim(left=0.0)
    for axes in panels[:2]:
        axes.set_xlim(-3.0, 103.0)
    panels[3].axvline(r_in, color="#B00020", linewidth=1.0, linestyle=(0, (4, 3)))
    panels[0].set_yticks(range(len(names)), names)
    panels[0].set_ylim(len(names) - 0.5, -0.5)
    write(made, path)


def _figures(place: Standing) -> list[tuple[float, float, float]]:
    """(low, value, high) of each panel; NaN where there is none."""
    found = list[tuple[float, float, float]]()
    for name in ("collided", "converged"):
        hits, count = place.count(name), len(place.rows)
        low, high = exact_interval(hits, count)
        found.append((100 * low, 100 * hits / count, 100 * high))
    return [*found, middle(place.times), middle(place.distances)]
