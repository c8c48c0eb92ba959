"""Section VI of the paper again: its figures, and its claims over many seeds.

`CHOICES` tells what the paper leaves open and is chosen here. Time is counted in iterations of (9);
continuous time is the same law integrated in steps of a small part of an iteration.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from rich.console import Console

from swarm_ctl.core.model.plan import LawParameters
from swarm_ctl.runfolder.files import write_whole
from swarm_ctl.study.batch.batch import Batch, draw, unit_shape
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.batch.flight import STUCK_MPS
from swarm_ctl.study.executor import run_study
from swarm_ctl.study.paper.cases import collisions_table, failing_cases_table
from swarm_ctl.study.paper.claims import KAPPA, TABLE_I_H, claims_table
from swarm_ctl.study.paper.pairs import pairs_table
from swarm_ctl.study.parameter_space import Cell, Study, value
from swarm_ctl.study.rerun import Trace

SIX: Final = LawParameters(r=4.5, r_out=1.5, r_in=0.5)
THIRTY_TWO: Final = LawParameters(r=10.5, r_out=0.5, r_in=0.1)
LIMIT: Final = 20000
"""Iterations after which a mission is cut off."""
AT_REST: Final = 1e-6
"""[units an iteration] Where all u_i are this close to their mean for 200 iterations, and the
formation does not stand, the shape has come to rest."""
FORMS: Final = {"discrete": 1.0, "continuous": 0.2}
"""Iterations a step: 1 is (9) itself."""
CHOICES: Final = (
    "hexagon: regular, side 2 units, first slot towards x, slots in plain order (figures)",
    "32 agents: starts in a square of 20 x 20 units, at least 2 r_in apart, connected; seed 1",
    "32 agents: the planar formation is a grid of 6 columns, 2 units apart, slots at random",
    "seeds: the shape is turned at random; slots at random, or by least total squared distance",
    f"h is Table I's {TABLE_I_H}; the paper states no limit, (7) allows 0 < h < 1",
    "formed: largest |e_i - mean e| under 0.1 unit for 10 iterations",
    f"not formed: the shape is at rest, all u_i within {AT_REST:g} units of their mean",
    f"a mission whose shape still changes after {LIMIT} iterations counts neither way",
    "distances: between iterations too, on the straight way from one to the next",
    f"continuous time: Euler steps of {FORMS['continuous']:g} iteration",
    "connectivity kept: every link of the start graph stays within r (Property 1)",
    "not parted, the weaker form: the links that are within r at a moment still hang together",
)


def studies_of(seeds: int, seed: int, limit: int = LIMIT) -> dict[str, Study]:
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
            "h": value(TABLE_I_H),
            "kappa": value(KAPPA),
            "tick_s": part / KAPPA,
            "settle_s": 10 / KAPPA,
            "limit_s": limit / KAPPA,
            # `stuck` is a limit in m/s: with a unit of 5 km it is AT_REST
            "unit_m": STUCK_MPS / (AT_REST * KAPPA),
        }
        six = {"law": SIX, "start": ("table2", "random")}
        many = {"law": THIRTY_TWO, "n": (32,), "shape": ("grid",), "area": value(20.0)}
        found[f"six-{form}"] = Study.model_validate(common | six)
        found[f"thirty-two-{form}"] = Study.model_validate(common | many)
    return found


def reproduce(
    folder: Path,
    seeds: int,
    seed: int,
    processes: int | None,
    console: Console,
    *,
    limit: int = LIMIT,
    cases: int | None = None,
) -> None:
    """Make everything: figures, rows, claims, and failing cases out of `cases` missions per n
    (500, or `seeds` where that is fewer).

    Missions end after `limit` iterations at the latest. The console tells what is made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for choice in CHOICES:
        console.print(f"choice: {choice}", soft_wrap=True)
    for form, part in FORMS.items():
        _figures(folder / form, part, limit, console)
    studies = studies_of(seeds, seed, limit)
    for name, study in studies.items():
        console.print(f"{name}: {study.rows} missions")
        run_study(study, folder / f"{name}.csv", processes, console)
    few = studies_of(min(500, seeds) if cases is None else cases, seed, limit)
    made = (
        claims_table(studies, folder),
        pairs_table(studies, folder),
        collisions_table(folder, few, processes, console),
        failing_cases_table(folder, few, processes, console),
    )
    text = io.StringIO()
    for target in (console, Console(file=text, width=160)):
        for table in made:
            target.print(table)
    write_whole(folder / "claims.txt", text.getvalue())
    console.print(f"figures, rows and claims: {folder}", soft_wrap=True)


def hexagon(part: float, limit: int = LIMIT) -> Batch:
    """Section VI-A: Table II, the regular hexagon in plain order."""
    cell = studies_of(1, 1, limit)["six-discrete"].cells()[0]
    slots = (unit_shape("ring", 6) * 2.0).T[..., None]
    return replace(draw(_with_step(cell, part), 0, 1), slots=np.ascontiguousarray(slots))


def thirty_two(part: float, limit: int = LIMIT) -> Batch:
    """Section VI-B: random starts, a grid."""
    cell = studies_of(1, 1, limit)["thirty-two-discrete"].cells()[0]
    return draw(_with_step(cell, part), 0, 1)


def _with_step(cell: Cell, part: float) -> Cell:
    return cell.model_copy(update={"tick_s": part / KAPPA, "settle_s": 500 / KAPPA})


def _figures(folder: Path, part: float, limit: int, console: Console) -> None:
    folder.mkdir(exist_ok=True)
    for batch, first in ((hexagon(part, limit), 7), (thirty_two(part, limit), 13)):
        trace, law = Trace(), batch.cell.law
        flown = fly(batch, trace)
        for number, (title, draw_it) in enumerate(_pictures(batch, trace, first), start=first):
            draw_it(folder, f"fig{number:02d}", f"Fig. {number}: {title}")
        formed = f"formed after {flown.time_s[0] * KAPPA:.0f} iterations"
        console.print(
            f"{folder.name}, n = {batch.cell.n}:"
            f" smallest distance {flown.smallest[0]:.3f} (r_in {law.r_in:g}),"
            f" {formed if flown.converged[0] else 'NOT formed'},"
            f" {flown.links_broken[0]} of {flown.links[0]} links broken,"
            f" statuses {trace.statuses()}",
            soft_wrap=True,
        )


def _pictures(
    batch: Batch, trace: Trace, first: int
) -> Sequence[tuple[str, Callable[[Path, str, str], None]]]:
    """(title, how to draw it) of the figures from number `first` on."""
    from swarm_ctl.study import mission_figures as figures

    iterations = np.array(trace.time_s) * KAPPA
    # the paper shows agents 2, 3 and 4 of the six, and does not say which of the 32
    seen = {i for _, i, *_ in trace.pairs}
    shown = (1, 2, 3) if first == 7 and {1, 2, 3} & seen else trace.busiest()
    names = ", ".join(str(i + 1) for i in shown)
    start = partial(figures.start_picture, batch)
    track = partial(figures.track_picture, batch, trace)
    distance = partial(figures.distance_picture, batch, trace, iterations)
    sigma = partial(figures.sigma_picture, trace, 1 / KAPPA, shown)
    error = partial(figures.error_picture, batch, trace, iterations)
    pictures = [
        ("start, links within $r$, circles of $r_\\mathrm{out}$", start),
        (f"trajectories and formation, n = {batch.cell.n}", track),
        ("minimum inter-agent distances", distance),
        (f"$\\sigma_{{ij}}$, $i$ = {names}", sigma),
        ("convergence in x", partial(error, 0)),
        ("convergence in y", partial(error, 1)),
    ]
    return pictures if first == 7 else pictures[1:]
