"""Section VI of the paper again: its figures, and its claims over many seeds.

What the paper leaves open is chosen here and told in `CHOICES`. Time is counted in iterations of
(9); continuous time is the same law integrated in steps of a small part of an iteration.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from swarm_ctl.core.law.formation_law import NARROW
from swarm_ctl.core.law.swarm_law import NearPairs
from swarm_ctl.core.model.arrays import Floats
from swarm_ctl.core.model.plan import LawParameters
from swarm_ctl.study.batch.batch import Batch, draw, unit_shape
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.executor import carry_out
from swarm_ctl.study.parameter_space import Cell, Study, value
from swarm_ctl.study.rerun import Flown, Trace, fly_again
from swarm_ctl.study.rows import Row, read_rows
from swarm_ctl.study.rows_table import share

SIX: Final = LawParameters(r=4.5, r_out=1.5, r_in=0.5)
THIRTY_TWO: Final = LawParameters(r=10.5, r_out=0.5, r_in=0.1)
_KAPPA: Final = 10.0
"""Iterations a second of study time: only a scale here."""
LIMIT: Final = 20000
"""Iterations after which a mission counts as not formed."""
FORMS: Final = {"discrete": 1.0, "continuous": 0.2}
"""Iterations a step: 1 is (9) itself."""
_GAINS: Final = tuple(span for h in (0.005, 0.02, 0.05, 0.1, 0.3) for span in value(h))
CHOICES: Final = (
    "hexagon: regular, side 2 units, first slot in the direction of x, slots given to agents in plain order (figures)",
    "32 agents: starts drawn in a square of 20 x 20 units, none closer than 2 r_in, connected; seed 1 for the figures",
    "32 agents: the planar formation is a grid of 6 columns, 2 units apart, slots given out at random",
    "seeds: the shape is turned at random; slots at random or by least total squared distance; starts as named",
    f"formed: largest |e_i - mean e| under 0.1 unit for 10 iterations, within {LIMIT} iterations",
    f"continuous time: Euler steps of {FORMS['continuous']:g} iteration",
    "connectivity kept: every link of the start graph stays within r (Property 1)",
    "not parted, the weaker form: the links that are within r at a moment still hang together",
)


def studies(seeds: int, seed: int, limit: int = LIMIT) -> dict[str, Study]:
    """The studies behind the table of claims."""
    found = {}
    for form, part in FORMS.items():
        common = {
            "seed": seed,
            "missions": seeds,
            "vehicle": ("ideal",),
            "compensation": ("none",),
            "safety": ("off",),
            "slots": ("random", "nearest"),
            "h": value(0.005),
            "kappa": value(_KAPPA),
            "tick_s": part / _KAPPA,
            "settle_s": 10 / _KAPPA,
            "limit_s": limit / _KAPPA,
        }
        found[f"six-{form}"] = Study.model_validate(
            common | {"law": SIX, "start": ("table2", "random")}
        )
        found[f"thirty-two-{form}"] = Study.model_validate(
            common | {"law": THIRTY_TWO, "n": (32,), "shape": ("grid",), "area": value(20.0)}
        )
    return found


def reproduce(
    folder: Path,
    seeds: int,
    seed: int,
    processes: int | None,
    console: Console,
    *,
    limit: int = LIMIT,
    cases: int = 500,
) -> None:
    """Everything: figures, rows, claims, failing cases (out of `cases` missions per n); tells what
    it makes.

    Missions end after `limit` iterations at the latest.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for choice in CHOICES:
        console.print(f"choice: {choice}", soft_wrap=True)
    for form, part in FORMS.items():
        _figures(folder / form, part, limit, console)
    found = studies(seeds, seed, limit)
    for name, study in found.items():
        console.print(f"{name}: {study.rows} missions")
        carry_out(study, folder / f"{name}.csv", processes, console)
    made = [claims(found, folder), sigma_claim(found, folder)]
    few = studies(cases, seed, limit)
    made += [
        collisions_by_gain(folder, few, processes, console),
        failing_cases(folder, few, processes, console),
    ]
    with (folder / "claims.txt").open("w") as file:
        for target in (console, Console(file=file, width=160)):
            for table in made:
                target.print(table)
    console.print(f"figures, rows and claims: {folder}", soft_wrap=True)


def hexagon(part: float, limit: int = LIMIT) -> Batch:
    """Section VI-A: Table II, the regular hexagon in plain order."""
    study = studies(1, 1, limit)["six-discrete"]
    cell = _with_step(study.cells()[0], part)
    batch = draw(cell, 0, 1)
    slots = (unit_shape("ring", 6) * 2.0).T[..., None]
    return replace(batch, slots=np.ascontiguousarray(slots))


def thirty_two(part: float, limit: int = LIMIT) -> Batch:
    """Section VI-B: random starts, a grid."""
    cell = studies(1, 1, limit)["thirty-two-discrete"].cells()[0]
    return draw(_with_step(cell, part), 0, 1)


def _with_step(cell: Cell, part: float) -> Cell:
    return cell.model_copy(update={"tick_s": part / _KAPPA, "settle_s": 500 / _KAPPA})


def _figures(folder: Path, part: float, limit: int, console: Console) -> None:
    from swarm_ctl.study.mission_figures import statuses_seen

    folder.mkdir(exist_ok=True)
    for batch, first in ((hexagon(part, limit), 7), (thirty_two(part, limit), 13)):
        trace = Trace()
        outcome = fly(batch, trace)
        for number, (title, draw_it) in enumerate(_pictures(batch, trace, first), start=first):
            draw_it(folder, f"fig{number:02d}", f"Fig. {number}: {title}")
        console.print(
            f"{folder.name}, n = {batch.cell.n}: smallest distance {outcome.smallest[0]:.3f}"
            f" (r_in {batch.cell.law.r_in:g}), "
            + (
                f"formed after {outcome.time_s[0] * _KAPPA:.0f} iterations"
                if outcome.converged[0]
                else "NOT formed"
            )
            + f", {outcome.links_broken[0]} of {outcome.links[0]} links broken, statuses {statuses_seen(trace)}",
            soft_wrap=True,
        )


def _pictures(
    batch: Batch, trace: Trace, first: int
) -> Sequence[tuple[str, Callable[[Path, str, str], None]]]:
    """(title, how to draw it) of the figures from number `first` on."""
    from swarm_ctl.study import mission_figures

    iterations = np.array(trace.time_s) * _KAPPA
    # the paper shows agents 2, 3 and 4 of the six, and does not say whom of the 32
    shown = (
        (1, 2, 3) if first == 7 and {1, 2, 3} & {i for _, i, *_ in trace.pairs} else _busiest(trace)
    )
    start = (
        "start, links within $r$, circles of $r_\\mathrm{out}$",
        partial(mission_figures.start_picture, batch),
    )
    return [start] * (first == 7) + [
        (
            f"trajectories and formation, n = {batch.cell.n}",
            partial(mission_figures.track_picture, batch, trace),
        ),
        (
            "minimum inter-agent distances",
            partial(mission_figures.distance_picture, batch, trace, iterations),
        ),
        (
            f"$\\sigma_{{ij}}$, $i$ = {', '.join(str(i + 1) for i in shown)}",
            partial(mission_figures.sigma_picture, trace, 1 / _KAPPA, shown),
        ),
        ("convergence in x", partial(mission_figures.error_picture, batch, trace, iterations, 0)),
        ("convergence in y", partial(mission_figures.error_picture, batch, trace, iterations, 1)),
    ]


def _busiest(trace: Trace) -> tuple[int, ...]:
    """The three agents with most pair-ticks."""
    counts = np.bincount([i for _, i, *_ in trace.pairs] or [0])
    return tuple(sorted(int(i) for i in np.argsort(-counts, kind="stable")[:3]))


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim of the paper and the rows that break it."""

    text: str
    broken: Callable[[Row], bool]


CLAIMS: Final = (
    Claim("no distance under r_in", lambda row: bool(row["collided"])),
    Claim("formation reached", lambda row: not row["converged"]),
    Claim("connectivity kept: all links within r", lambda row: row["links_broken"] > 0),
    Claim("connectivity kept: not parted", lambda row: bool(row["parted"])),
    Claim("D_ub - D_lb > 2 for every pair", lambda row: row["small_gap"] > 0),
)


def claims(found: dict[str, Study], folder: Path) -> Table:
    """Each claim against each experiment."""
    table = Table(
        title="Claims of the paper: share of missions that break each, 95 % confidence",
        show_lines=False,
    )
    for name in ("experiment", "claim", "broken in", "of", "share", "measured", "holds"):
        table.add_column(name)
    for name, study in found.items():
        rows = list(read_rows(folder / f"{name}.csv"))
        for cell in study.cells():
            own = [row for row in rows if row["cell"] == cell.index]
            what = f"{name}, {cell.start} starts, {cell.slots} slots"
            for claim in CLAIMS:
                broken = sum(claim.broken(row) for row in own)
                verdict = "no" if broken else "not broken"
                measured = _measured(claim, own, cell)
                table.add_row(
                    what,
                    claim.text,
                    str(broken),
                    str(len(own)),
                    share(broken, len(own)),
                    measured,
                    verdict,
                )
                what = ""
    return table


def _measured(claim: Claim, rows: list[Row], cell: Cell) -> str:
    match CLAIMS.index(claim):
        case 0:
            return f"smallest {min(row['smallest'] for row in rows):.3f}, r_in {cell.law.r_in:g}"
        case 1:
            times = [row["time_s"] * _KAPPA for row in rows if row["converged"]]
            return (
                f"median {np.median(times):.0f}, p95 {np.percentile(times, 95):.0f} iterations"
                if times
                else "-"
            )
        case 2:
            return f"longest {max(row['longest_link'] for row in rows):.2f}, r {cell.law.r:g}"
        case 3:
            return f"{sum(row['links_broken'] for row in rows)} of {sum(row['links'] for row in rows)} links over r"
        case _:
            return f"{share(*_gaps(rows))} of pair-steps"


def _gaps(rows: list[Row]) -> tuple[int, int]:
    pairs = sum(row[name] for row in rows for name in row if name.startswith("sigma_"))
    return sum(row["small_gap"] for row in rows), pairs


class _Samples:
    """Distance and sigma of every near pair; a `flight.Watch`."""

    def __init__(self) -> None:
        self.parts: list[Floats] = []

    def __call__(
        self, time_s: float, place: NDArray[np.intp], position: Floats, near: NearPairs | None
    ) -> None:
        del time_s, place, position
        if near is not None:
            tuned = near.numbers.status[0] <= NARROW
            self.parts.append(np.stack((near.distance, near.numbers.sigma[0]), axis=-1)[tuned])


def sigma_claim(found: dict[str, Study], folder: Path) -> Table:
    """Is sigma small when the distance is small? Over all near pairs of 200 missions per
    experiment."""
    from scipy.stats import spearmanr

    from swarm_ctl.study.mission_figures import sigma_against_distance

    table = Table(
        title="Claim: sigma is small when the distance is small (discrete form, 200 missions each)"
    )
    for name in (
        "experiment",
        "pair-steps",
        "rank correlation",
        "median sigma, inner | middle | outer third",
        "holds",
    ):
        table.add_column(name)
    mission_figures, radii = [], []
    for name, study in found.items():
        if not name.endswith("discrete"):
            continue
        cell = next(
            cell for cell in study.cells() if (cell.slots, cell.start) == ("random", "random")
        )
        samples = _Samples()
        fly(draw(cell, 0, min(200, study.missions)), samples)
        points = np.concatenate(samples.parts) if samples.parts else np.zeros((0, 2))
        points = points[:: max(1, len(points) // 50000)]
        law = cell.law
        third = np.clip((points[:, 0] - law.r_in) / (law.r_out - law.r_in) * 3, 0, 2.999).astype(
            int
        )
        medians = [
            np.median(points[third == k, 1]) if (third == k).any() else np.nan for k in range(3)
        ]
        rank = float(spearmanr(points[:, 0], points[:, 1]).statistic) if len(points) > 2 else np.nan
        seen = [m for m in medians if not np.isnan(m)]
        rises = rank > 0.5 and seen == sorted(seen)
        label = f"n = {cell.n}, {cell.start} starts"
        texts = " | ".join("-" if np.isnan(m) else f"{m:.3g}" for m in medians)
        table.add_row(label, str(len(points)), f"{rank:+.2f}", texts, "yes" if rises else "no")
        mission_figures.append((label, points))
        radii.append((law.r_in, law.r_out))
    sigma_against_distance(mission_figures, radii, folder, "sigma-against-distance")
    return table


def collisions_by_gain(
    folder: Path, found: dict[str, Study], processes: int | None, console: Console
) -> Table:
    """The first claim where it is hardest: starts just outside r_in, and gains above Table I's."""
    table = Table(
        title="No distance under r_in? Starts from 1.02 r_in apart, random slots, discrete form"
    )
    for name in ("n", "h", "missions", "under r_in", "smallest / r_in"):
        table.add_column(name)
    for name, agents in (("six", (2, 3, 4, 5, 6)), ("thirty-two", (32,))):
        base = found[f"{name}-discrete"]
        settings = {
            "n": agents,
            "h": _GAINS,
            "start": ("random",),
            "slots": ("random",),
            "limit_s": 3000 / _KAPPA,
        }
        study = base.model_copy(update=settings | {"start_spacing": 1.02 * base.law.r_in})
        path = folder / f"{name}-gains.csv"
        console.print(f"{name}, gains: {study.rows} missions of at most 3000 iterations")
        carry_out(study, path, processes, console)
        rows = list(read_rows(path))
        for cell in study.cells():
            own = [row for row in rows if row["cell"] == cell.index]
            hits = sum(row["collided"] for row in own)
            least = min(row["smallest"] for row in own) / cell.law.r_in
            table.add_row(
                str(cell.n), str(cell.h), str(len(own)), share(hits, len(own)), f"{least:.3f}"
            )
    return table


def failing_cases(
    folder: Path, found: dict[str, Study], processes: int | None, console: Console
) -> Table:
    """For each claim the fewest agents that break it, with a picture of one such mission.

    A claim that Table I's h does not break is looked for among the larger gains of
    `collisions_by_gain`.
    """
    study = found["six-discrete"].model_copy(
        update={"n": (2, 3, 4, 5, 6), "start": ("random",), "slots": ("random",)}
    )
    path = folder / "smallest-cases.csv"
    console.print(f"smallest failing cases: {study.rows} missions of 2 to 6 agents")
    carry_out(study, path, processes, console)
    table = Table(
        title="Smallest failing case of each claim (hexagon's r, r_out, r_in; random starts and slots)"
    )
    for name in ("claim", "fewest agents", "h", "row", "numbers", "picture"):
        table.add_column(name)
    for number, claim in enumerate(CLAIMS, start=1):
        for rows_at in (path, folder / "six-gains.csv"):
            worst = next(_by_size(list(read_rows(rows_at)), claim), None)
            if worst is not None:
                flown = fly_again(rows_at, worst["row"])
                table.add_row(claim.text, *_case(flown, folder, f"smallest-case-{number}"))
                break
        else:
            table.add_row(claim.text, "none of 2 to 6", "", "", "", "")
    return table


def _by_size(rows: list[Row], claim: Claim) -> Iterator[Row]:
    ordered = sorted(rows, key=lambda row: (row["n"], row["h"], row["steps"]))
    return (row for row in ordered if claim.broken(row))


def _case(flown: Flown, folder: Path, name: str) -> tuple[str, ...]:
    from swarm_ctl.study.mission_figures import draw_mission

    row = flown.row
    draw_mission(flown, folder / f"{name}.png")
    starts = " ".join(f"({x:.2f},{y:.2f})" for x, y in flown.batch.starts[..., 0].T)
    gap = min((gap for *_, gap, _ in flown.trace.pairs), default=float("nan"))
    numbers = (
        f"smallest {row['smallest']:.2f}, longest link {row['longest_link']:.2f}, end error {row['error']:.2f},"
        f" least D_ub - D_lb {gap:.3g}; starts {starts}"
    )
    return str(row["n"]), str(row["h"]), str(row["row"]), numbers, f"{name}.png"
