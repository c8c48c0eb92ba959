"""Where the paper's claims are hardest: close starts, larger gains, and the fewest agents that
break each."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.table import Table

from swarm_ctl.study.executor import run_study
from swarm_ctl.study.paper.claims import CLAIMS, KAPPA, TABLE_I_H
from swarm_ctl.study.parameter_space import Range, Study, value
from swarm_ctl.study.rerun import Rerun, rerun
from swarm_ctl.study.rows import Row, read_rows
from swarm_ctl.study.rows_table import share

_GAINS: Final = tuple(span for h in (TABLE_I_H, 0.02, 0.05, 0.1, 0.3) for span in value(h))
"""Table I has the only h that the paper uses, and the paper states no limit. Its (7) is a Jacobi
over-relaxation, which allows 0 < h < 1."""
_FEW: Final = (2, 3, 4, 5, 6)
_LIMIT: Final = 3000


def collisions_table(
    folder: Path, studies: Mapping[str, Study], processes: int | None, console: Console
) -> Table:
    """The first claim where it is hardest: starts just outside r_in, slots up to r apart, and gains
    above Table I's."""
    title = (
        "No distance under r_in? Starts from 1.02 r_in apart, random slots 1.05 r_out to r apart,"
        " discrete form"
    )
    table = Table("n", "h", "missions", "under r_in", "smallest / r_in", title=title)
    for name, agents in (("six", _FEW), ("thirty-two", (32,))):
        base = studies[f"{name}-discrete"]
        study = _scattered(
            base,
            n=agents,
            h=_GAINS,
            start_spacing=1.02 * base.law.r_in,
            spacing=(Range(low=1.05 * base.law.r_out, high=base.law.r),),
            limit_s=_LIMIT / KAPPA,
        )
        path = folder / f"{name}-gains.csv"
        console.print(f"{name}, gains: {study.rows} missions of at most {_LIMIT} iterations")
        run_study(study, path, processes, console)
        rows = list(read_rows(path))
        for cell in study.cells():
            own = [row for row in rows if row["cell"] == cell.index]
            under = share(sum(row["collided"] for row in own), len(own))
            least = min(row["smallest_units"] for row in own) / cell.law.r_in
            table.add_row(str(cell.n), str(cell.h), str(len(own)), under, f"{least:.3f}")
    return table


def failing_cases_table(
    folder: Path, studies: Mapping[str, Study], processes: int | None, console: Console
) -> Table:
    """For each claim the fewest agents that break it, with a picture of one such mission.

    First at Table I's h. A claim that this h does not break is looked for among the larger gains of
    `collisions_table`.
    """
    path = folder / "smallest-cases.csv"
    study = _scattered(studies["six-discrete"], n=_FEW)
    console.print(f"smallest failing cases: {study.rows} missions of 2 to 6 agents")
    run_study(study, path, processes, console)
    title = (
        "Smallest failing case of each claim (hexagon's r, r_out, r_in; random starts and slots)"
    )
    table = Table("claim", "h", "fewest agents", "row", "numbers", "picture", title=title)
    flown = [(at, row) for at in (path, folder / "six-gains.csv") for row in read_rows(at)]
    for number, claim in enumerate(CLAIMS, start=1):
        text, name = claim.text, f"smallest-case-{number}"
        as_printed = [found for found in flown if found[1]["h"] == TABLE_I_H]
        larger = [found for found in flown if found[1]["h"] > TABLE_I_H]
        for what, found in ((f"{TABLE_I_H}, Table I", as_printed), ("larger, under 1", larger)):
            tested = [(at, row) for at, row in found if claim.tested(row)]
            broken = [(at, row) for at, row in tested if claim.broken(row)]
            if broken:
                table.add_row(text, *_case(broken, folder, name))
                break
            table.add_row(text, what, f"none: {share(0, len(tested))} of {len(tested)} missions")
            text = ""
    return table


def _scattered(study: Study, **settings: object) -> Study:
    """The study with random starts and slots, and these settings."""
    return study.model_copy(update={"start": ("random",), "slots": ("random",)} | settings)


def _case(broken: list[tuple[Path, Row]], folder: Path, name: str) -> tuple[str, ...]:
    """The row with the fewest agents, then the least h, then the fewest iterations."""
    from swarm_ctl.study.mission_figures import draw_mission

    at, row = min(broken, key=lambda found: tuple(found[1][key] for key in ("n", "h", "steps")))
    flown = rerun(at, row["row"])
    draw_mission(flown, folder / f"{name}.png")
    where = f"{at.name}, {row['row']}"
    return f"{row['h']:g}", str(row["n"]), where, _numbers(flown), f"{name}.png"


def _numbers(flown: Rerun) -> str:
    row = flown.row
    starts = " ".join(f"({x:.2f},{y:.2f})" for x, y in flown.batch.starts[..., 0].T)
    gap = min((gap for *_, gap, _ in flown.trace.pairs), default=float("nan"))
    return (
        f"smallest {row['smallest_units']:.2f}, longest link {row['longest_link_units']:.2f},"
        f" end error {row['error_units']:.2f}, least D_ub - D_lb {gap:.3g}; starts {starts}"
    )
