"""The paper's claims against the rows of many missions: how many break each, and the smallest that
does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from rich.console import Console
from rich.table import Table

from swarm_ctl.core.law.formation_law import NARROW
from swarm_ctl.core.law.swarm_law import NearPairs
from swarm_ctl.core.model.arrays import Floats, Indices
from swarm_ctl.study.batch.batch import draw
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.executor import run_study
from swarm_ctl.study.parameter_space import Cell, Study, value
from swarm_ctl.study.rerun import Rerun, rerun
from swarm_ctl.study.rows import Row, read_rows
from swarm_ctl.study.rows_table import share

KAPPA: Final = 10.0
"""Iterations a second of study time: only a scale here."""
_GAINS: Final = tuple(span for h in (0.005, 0.02, 0.05, 0.1, 0.3) for span in value(h))


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim of the paper, the rows that break it, and what the rows of a cell measure of it."""

    text: str
    broken: Callable[[Row], bool]
    measured: Callable[[list[Row], Cell], str]


def _smallest(rows: list[Row], cell: Cell) -> str:
    return f"smallest {min(row['smallest'] for row in rows):.3f}, r_in {cell.law.r_in:g}"


def _times(rows: list[Row], _: Cell) -> str:
    times = [row["time_s"] * KAPPA for row in rows if row["converged"]]
    if not times:
        return "-"
    return f"median {np.median(times):.0f}, p95 {np.percentile(times, 95):.0f} iterations"


def _longest(rows: list[Row], cell: Cell) -> str:
    return f"longest {max(row['longest_link'] for row in rows):.2f}, r {cell.law.r:g}"


def _links(rows: list[Row], _: Cell) -> str:
    broken, links = (sum(row[name] for row in rows) for name in ("links_broken", "links"))
    return f"{broken} of {links} links over r"


def _gaps(rows: list[Row], _: Cell) -> str:
    pairs = sum(row[name] for row in rows for name in row if name.startswith("sigma_"))
    return f"{share(sum(row['small_gap'] for row in rows), pairs)} of pair-steps"


CLAIMS: Final = (
    Claim("no distance under r_in", lambda row: bool(row["collided"]), _smallest),
    Claim("formation reached", lambda row: not row["converged"], _times),
    Claim("connectivity kept: all links within r", lambda row: row["links_broken"] > 0, _longest),
    Claim("connectivity kept: not parted", lambda row: bool(row["parted"]), _links),
    Claim("D_ub - D_lb > 2 for every pair", lambda row: row["small_gap"] > 0, _gaps),
)


def claims_table(studies: Mapping[str, Study], folder: Path) -> Table:
    """Each claim against each experiment."""
    title = "Claims of the paper: share of missions that break each, 95 % confidence"
    table = Table(
        "experiment", "claim", "broken in", "of", "share", "measured", "holds", title=title
    )
    for name, study in studies.items():
        rows = list(read_rows(folder / f"{name}.csv"))
        for cell in study.cells():
            own = [row for row in rows if row["cell"] == cell.index]
            what = f"{name}, {cell.start} starts, {cell.slots} slots"
            for claim in CLAIMS:
                broken, of = sum(claim.broken(row) for row in own), len(own)
                found = (str(broken), str(of), share(broken, of), claim.measured(own, cell))
                table.add_row(what, claim.text, *found, "no" if broken else "not broken")
                what = ""
    return table


@dataclass(slots=True)
class _Samples:
    """Distance and sigma of every near pair; a `TickObserver`."""

    parts: list[Floats] = field(default_factory=list)

    def __call__(
        self, time_s: float, place: Indices, position: Floats, near: NearPairs | None
    ) -> None:
        del time_s, place, position
        if near is not None:
            tuned = near.numbers.status[0] <= NARROW
            self.parts.append(np.stack((near.distance, near.numbers.sigma[0]), axis=-1)[tuned])

    def points(self) -> Floats:
        """At most about 50,000 of them, (K, 2)."""
        points = np.concatenate(self.parts) if self.parts else np.zeros((0, 2))
        return points[:: max(1, len(points) // 50000)]


def sigma_table(studies: Mapping[str, Study], folder: Path) -> Table:
    """Is sigma small when the distance is small? Over all near pairs of 200 missions per
    experiment, with a figure."""
    from scipy.stats import spearmanr

    from swarm_ctl.study.mission_figures import sigma_against_distance

    title = "Claim: sigma is small when the distance is small (discrete form, 200 missions each)"
    medians_of = "median sigma, inner | middle | outer third"
    table = Table("experiment", "pair-steps", "rank correlation", medians_of, "holds", title=title)
    drawn, radii = [], []
    for name, study in studies.items():
        if not name.endswith("discrete"):
            continue
        cell = next(c for c in study.cells() if (c.slots, c.start) == ("random", "random"))
        samples = _Samples()
        fly(draw(cell, 0, min(200, study.missions)), samples)
        points, law = samples.points(), cell.law
        # which third of the way from r_in to r_out each pair is in
        third = np.clip((points[:, 0] - law.r_in) / (law.r_out - law.r_in) * 3, 0, 2.999)
        inside = [points[third.astype(int) == k, 1] for k in range(3)]
        medians = [float(np.median(sigma)) for sigma in inside if len(sigma)]
        texts = " | ".join(f"{np.median(sigma):.3g}" if len(sigma) else "-" for sigma in inside)
        rank = float(spearmanr(points[:, 0], points[:, 1]).statistic) if len(points) > 2 else np.nan
        rises = rank > 0.5 and medians == sorted(medians)
        label = f"n = {cell.n}, {cell.start} starts"
        table.add_row(label, str(len(points)), f"{rank:+.2f}", texts, "yes" if rises else "no")
        drawn.append((label, points))
        radii.append((law.r_in, law.r_out))
    sigma_against_distance(drawn, radii, folder, "sigma-against-distance")
    return table


def collisions_table(
    folder: Path, studies: Mapping[str, Study], processes: int | None, console: Console
) -> Table:
    """The first claim where it is hardest: starts just outside r_in, and gains above Table I's."""
    title = "No distance under r_in? Starts from 1.02 r_in apart, random slots, discrete form"
    table = Table("n", "h", "missions", "under r_in", "smallest / r_in", title=title)
    for name, agents in (("six", (2, 3, 4, 5, 6)), ("thirty-two", (32,))):
        base = studies[f"{name}-discrete"]
        apart = {"start_spacing": 1.02 * base.law.r_in, "limit_s": 3000 / KAPPA}
        study = _scattered(base, n=agents, h=_GAINS, **apart)
        path = folder / f"{name}-gains.csv"
        console.print(f"{name}, gains: {study.rows} missions of at most 3000 iterations")
        run_study(study, path, processes, console)
        rows = list(read_rows(path))
        for cell in study.cells():
            own = [row for row in rows if row["cell"] == cell.index]
            under = share(sum(row["collided"] for row in own), len(own))
            least = min(row["smallest"] for row in own) / cell.law.r_in
            table.add_row(str(cell.n), str(cell.h), str(len(own)), under, f"{least:.3f}")
    return table


def failing_cases_table(
    folder: Path, studies: Mapping[str, Study], processes: int | None, console: Console
) -> Table:
    """For each claim the fewest agents that break it, with a picture of one such mission.

    A claim that Table I's h does not break is looked for among the larger gains of
    `collisions_table`.
    """
    study, path = (
        _scattered(studies["six-discrete"], n=(2, 3, 4, 5, 6)),
        folder / "smallest-cases.csv",
    )
    console.print(f"smallest failing cases: {study.rows} missions of 2 to 6 agents")
    run_study(study, path, processes, console)
    title = (
        "Smallest failing case of each claim (hexagon's r, r_out, r_in; random starts and slots)"
    )
    table = Table("claim", "fewest agents", "h", "row", "numbers", "picture", title=title)
    for number, claim in enumerate(CLAIMS, start=1):
        for rows_at in (path, folder / "six-gains.csv"):
            broken = [row for row in read_rows(rows_at) if claim.broken(row)]
            if broken:
                worst = min(broken, key=lambda row: (row["n"], row["h"], row["steps"]))
                case = _case(rerun(rows_at, worst["row"]), folder, f"smallest-case-{number}")
                table.add_row(claim.text, *case)
                break
        else:
            table.add_row(claim.text, "none of 2 to 6", "", "", "", "")
    return table


def _scattered(study: Study, **settings: object) -> Study:
    """The study with random starts and slots, and these settings."""
    return study.model_copy(update={"start": ("random",), "slots": ("random",)} | settings)


def _case(flown: Rerun, folder: Path, name: str) -> tuple[str, ...]:
    from swarm_ctl.study.mission_figures import draw_mission

    row = flown.row
    draw_mission(flown, folder / f"{name}.png")
    starts = " ".join(f"({x:.2f},{y:.2f})" for x, y in flown.batch.starts[..., 0].T)
    gap = min((gap for *_, gap, _ in flown.trace.pairs), default=float("nan"))
    numbers = (
        f"smallest {row['smallest']:.2f}, longest link {row['longest_link']:.2f},"
        f" end error {row['error']:.2f}, least D_ub - D_lb {gap:.3g}; starts {starts}"
    )
    return str(row["n"]), str(row["h"]), str(row["row"]), numbers, f"{name}.png"
