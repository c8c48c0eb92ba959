"""`swarm-ctl study`: thousands of missions at once."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from swarm_ctl.errors import InputError

if TYPE_CHECKING:
    from swarm_ctl.study.parameter_space import Study

_LIST = "One or more, with commas between."
_RANGE = "Values with commas between, each a number or LOW:HIGH to draw from."


def study(
    out: Annotated[Path, typer.Option(help="The CSV file of rows; goes on where it ends.")] = Path(
        "study.csv"
    ),
    missions: Annotated[
        int, typer.Option(min=1, help="Missions for each combination of the lists.")
    ] = 1000,
    seed: Annotated[int, typer.Option(min=0)] = 1,
    processes: Annotated[int | None, typer.Option(min=1, help="All cores where not given.")] = None,
    n: Annotated[
        str, typer.Option(help=f"Agents. {_LIST} 2:50 is every number from 2 to 50.")
    ] = "6",
    shape: Annotated[str, typer.Option(help=f"ring, line, grid, vee, wedge. {_LIST}")] = "ring",
    slots: Annotated[str, typer.Option(help=f"given, random, nearest. {_LIST}")] = "nearest",
    start: Annotated[
        str, typer.Option(help=f"random, ring, grid, table2, crossing, antipodal. {_LIST}")
    ] = "random",
    compensation: Annotated[str, typer.Option(help=f"stop_point, none. {_LIST}")] = "stop_point",
    vehicle: Annotated[str, typer.Option(help=f"ideal, lag, ardupilot, px4. {_LIST}")] = "lag",
    safety: Annotated[
        str, typer.Option(help=f"off, filter, guard, release, align, exchange. {_LIST}")
    ] = "align",
    silent: Annotated[
        str, typer.Option(help=f"Share of missions in which an agent dies. {_RANGE}")
    ] = "0",
    h: Annotated[str, typer.Option(help=f"Consensus gain. {_RANGE}")] = "0.05",
    kappa: Annotated[str, typer.Option(help=f"Iterations a second. {_RANGE}")] = "20",
    lag: Annotated[str, typer.Option(help=f"Of the vehicle lag [s]. {_RANGE}")] = "0.5",
    dead_time: Annotated[str, typer.Option(help=f"Of the vehicle lag [s]. {_RANGE}")] = "0.4",
    delay: Annotated[str, typer.Option(help=f"Age of news [s]. {_RANGE}")] = "0",
    loss: Annotated[str, typer.Option(help=f"Share of lost news. {_RANGE}")] = "0",
    wind: Annotated[
        str, typer.Option(help=f"[m/s], only ardupilot and px4 feel it. {_RANGE}")
    ] = "0",
    area: Annotated[
        str, typer.Option(help=f"Side of the starts' square [units]; 0: by n. {_RANGE}")
    ] = "0",
    spacing: Annotated[str, typer.Option(help=f"Between slots [units]. {_RANGE}")] = "2",
    start_spacing: Annotated[
        float, typer.Option(help="Least distance of random starts [units]; 0: 2 r_in.")
    ] = 0.0,
    r: Annotated[float, typer.Option(help="Interaction range [units].")] = 4.5,
    r_out: Annotated[float, typer.Option(help="Outer radius [units].")] = 1.5,
    r_in: Annotated[float, typer.Option(help="Inner radius [units].")] = 0.5,
    limit: Annotated[
        float, typer.Option(help="Missions that have not formed after so many seconds end.")
    ] = 300.0,
    tick: Annotated[float, typer.Option(help="[s]")] = 0.05,
    by: Annotated[
        str,
        typer.Option(help="Lists that the table tells apart; all that are varied if not given."),
    ] = "",
    row: Annotated[
        int | None, typer.Option(min=0, help="Fly this row of --out again, alone.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="With --row: its animation (.gif) or picture.")
    ] = None,
    mission: Annotated[
        Path | None, typer.Option(help="With --row: write it as a mission file for `run`.")
    ] = None,
) -> None:
    """Fly thousands of missions in numpy: every combination of the lists, each range drawn from per
    mission.

    Lengths are units. Rows are appended to a CSV file with the study beside it as JSON; an
    interrupted study goes on.

    Examples:

        swarm-ctl study --n 4,6,9 --slots random,nearest --missions 2000

        swarm-ctl study --safety off,align --start crossing --slots given --n 8,24 --silent 0.2

        swarm-ctl study --delay 0:0.2 --loss 0:0.2 --lag 0.4:0.6 --missions 10000 --out late.csv

        swarm-ctl study --out late.csv --row 4711 --picture 4711.gif --mission 4711.yaml
    """
    from swarm_ctl.study.executor import run_study
    from swarm_ctl.study.rows import read_rows
    from swarm_ctl.study.rows_table import table

    console = Console(highlight=False)
    if row is not None:
        _again(out, row, picture, mission, console)
        return
    lists = {
        "n": _whole(n),
        "shape": shape,
        "slots": slots,
        "start": start,
        "compensation": compensation,
        "vehicle": vehicle,
        "safety": safety,
    }
    ranges = {
        "h": h,
        "kappa": kappa,
        "lag_s": lag,
        "dead_time_s": dead_time,
        "delay_s": delay,
        "loss": loss,
        "wind_mps": wind,
        "area": area,
        "spacing": spacing,
        "silent": silent,
    }
    common = {
        "seed": seed,
        "missions": missions,
        "limit_s": limit,
        "tick_s": tick,
        "start_spacing": start_spacing,
    }
    plan = _study(lists, ranges, common | {"law": {"r": r, "r_out": r_out, "r_in": r_in}})
    run_study(plan, out, processes, console)
    wide = console if console.is_terminal else Console(highlight=False, width=200)
    wide.print(table(plan, read_rows(out), _by(by, plan)))
    console.print(f"rows: {out}", soft_wrap=True)


def _study(lists: dict[str, str], ranges: dict[str, str], common: dict[str, Any]) -> Study:
    from pydantic import ValidationError

    from swarm_ctl.study.parameter_space import Study

    spans = {
        name: [_range(name, text) for text in words.split(",")] for name, words in ranges.items()
    }
    try:
        return Study.model_validate(
            common | {name: text.split(",") for name, text in lists.items()} | spans
        )
    except ValidationError as error:
        found = error.errors(include_url=False)[0]
        where = found["loc"][0] if found["loc"] else "study"
        raise InputError(f"{where}: {found['msg'].removeprefix('Value error, ')}") from None


def _whole(text: str) -> str:
    """2:4,9 as 2,3,4,9."""
    try:
        spans = [[int(end) for end in part.split(":")] for part in text.split(",")]
    except ValueError:
        raise InputError(
            f"n: {text!r} is no list of numbers; allowed: 6 or 4,6,9 or 2:50"
        ) from None
    return ",".join(str(k) for span in spans for k in range(span[0], span[-1] + 1))


def _by(text: str, study: Study) -> tuple[str, ...]:
    names = tuple(text.split(",")) if text else ()
    unknown = [name for name in names if name not in study.varied]
    if unknown:
        raise InputError(
            f"--by {unknown[0]}: is not varied here; allowed: {', '.join(study.varied) or 'nothing'}"
        )
    return names


def _range(name: str, text: str) -> dict[str, float]:
    low, _, high = text.partition(":")
    try:
        return {"low": float(low), "high": float(high or low)}
    except ValueError:
        raise InputError(f"{name}: {text!r} is no number and no LOW:HIGH") from None


def _again(
    out: Path, row: int, picture: Path | None, mission: Path | None, console: Console
) -> None:
    from swarm_ctl.study.rerun import rerun, write_mission

    flown = rerun(out, row)
    console.print(flown.table())
    if picture is not None:
        from swarm_ctl.study.mission_figures import draw_mission

        draw_mission(flown, picture)
        console.print(f"picture: {picture}", soft_wrap=True)
    if mission is not None:
        write_mission(flown, mission)
        console.print(f"mission: swarm-ctl run {mission}", soft_wrap=True)
