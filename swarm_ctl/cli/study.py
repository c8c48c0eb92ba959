"""`swarm-ctl study`: thousands of missions at once."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swarm_ctl.cli.console import PlainConsole
from swarm_ctl.cli.options import Processes, Seed
from swarm_ctl.errors import InputError

if TYPE_CHECKING:
    from swarm_ctl.study.parameter_space import Study


def _list(help_text: str) -> Any:
    return typer.Option(metavar="A,B,...", help=help_text)


def _range(help_text: str) -> Any:
    return typer.Option(metavar="X,LOW:HIGH,...", help=help_text)


def _units(help_text: str) -> Any:
    return typer.Option(metavar="UNITS", help=help_text)


def study(
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="The CSV file that rows are appended to.")
    ] = Path("study.csv"),
    missions: Annotated[int, typer.Option(min=1, help="Missions for each combination.")] = 1000,
    seed: Seed = 1,
    processes: Processes = None,
    n: Annotated[str, _list("Number of agents; 2:50 is every number from 2 to 50.")] = "6",
    shape: Annotated[str, _list("ring, line, grid, vee, wedge.")] = "ring",
    slots: Annotated[str, _list("How slots are assigned: given, random, nearest.")] = "nearest",
    start: Annotated[
        str, _list("Where agents start: random, ring, grid, table2, crossing, antipodal.")
    ] = "random",
    compensation: Annotated[
        str, _list("What the law is fed with: stop_point, none (the position).")
    ] = "stop_point",
    vehicle: Annotated[
        str, _list("ideal, lag (dead time and first-order lag), ardupilot, px4.")
    ] = "lag",
    safety: Annotated[
        str, _list("off, filter, guard, release, align, exchange; each includes those before it.")
    ] = "align",
    silent: Annotated[str, _range("Share of missions in which an agent dies.")] = "0",
    h: Annotated[str, _range("The law's consensus gain h.")] = "0.05",
    kappa: Annotated[str, _range("The law's iterations a second.")] = "20",
    lag: Annotated[str, _range("Lag of the vehicle `lag`, in seconds.")] = "0.5",
    dead_time: Annotated[str, _range("Dead time of the vehicle `lag`, in seconds.")] = "0.4",
    delay: Annotated[str, _range("Age of a peer's state when it arrives, in seconds.")] = "0",
    loss: Annotated[str, _range("Share of states that are lost.")] = "0",
    wind: Annotated[str, _range("Wind in m/s; only the vehicles ardupilot and px4 feel it.")] = "0",
    area: Annotated[
        str, _range("Side of the square of random starts, in units; 0: chosen by n.")
    ] = "0",
    spacing: Annotated[str, _range("Distance of adjacent slots, in units.")] = "2",
    start_spacing: Annotated[
        float, _units("Least distance of random starts; 0: twice --r-in.")
    ] = 0.0,
    r: Annotated[float, _units("Interaction range.")] = 4.5,
    r_out: Annotated[float, _units("Outer radius.")] = 1.5,
    r_in: Annotated[float, _units("Inner radius.")] = 0.5,
    limit: Annotated[
        float, typer.Option(metavar="SECONDS", help="End a mission that has not formed by then.")
    ] = 300.0,
    tick: Annotated[float, typer.Option(metavar="SECONDS", help="Length of a tick.")] = 0.05,
    by: Annotated[
        str, _list("Make the table's rows by these options only.  [default: all that vary]")
    ] = "",
    row: Annotated[
        int | None, typer.Option(min=0, help="Fly this row of --out again, alone.")
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="With --row: draw it, as .gif (animated) or .png."),
    ] = None,
    mission: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="With --row: write it as a mission for `run`."),
    ] = None,
) -> None:
    """Fly thousands of missions in one go, in numpy.

    Options with A,B,... are lists: every combination of their values is flown. Those with
    X,LOW:HIGH,... are lists too; from a range, each mission draws its own value. Lengths are the
    law's units. The study itself is written beside its rows, as JSON; a study that was interrupted
    continues where it ended.

    Examples:

    \b
        swarm-ctl study --n 4,6,9 --slots random,nearest --missions 2000
        swarm-ctl study --safety off,align --start crossing --slots given
        swarm-ctl study --delay 0:0.2 --loss 0:0.2 --out late.csv
        swarm-ctl study --out late.csv --row 4711 --picture 4711.gif
    """
    from swarm_ctl.study.executor import run_study
    from swarm_ctl.study.rows import read_rows
    from swarm_ctl.study.rows_table import table

    console = PlainConsole()
    if row is not None:
        _again(out, row, picture, mission, console)
        return
    varied = {
        "n": _whole(n),
        "shape": shape,
        "slots": slots,
        "start": start,
        "compensation": compensation,
        "vehicle": vehicle,
        "safety": safety,
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
    plan = _study(
        varied,
        seed=seed,
        missions=missions,
        limit_s=limit,
        tick_s=tick,
        start_spacing=start_spacing,
        law={"r": r, "r_out": r_out, "r_in": r_in},
    )
    run_study(plan, out, processes, console)
    wide = console if console.is_terminal else PlainConsole(width=200)
    wide.print(table(plan, read_rows(out), _by(by, plan)))
    console.say(f"rows: {out}")


def _study(varied: dict[str, str], **common: Any) -> Study:
    from pydantic import ValidationError

    from swarm_ctl.study.parameter_space import Study

    try:
        lists = {name: text.split(",") for name, text in varied.items()}
        return Study.model_validate(common | lists)
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
        varied = ", ".join(study.varied) or "nothing"
        raise InputError(f"--by {unknown[0]}: is not varied here; allowed: {varied}")
    return names


def _again(
    out: Path, row: int, picture: Path | None, mission: Path | None, console: PlainConsole
) -> None:
    from swarm_ctl.study.rerun import rerun, write_mission

    flown = rerun(out, row)
    console.print(flown.table())
    if picture is not None:
        from swarm_ctl.study.mission_figures import draw_mission

        draw_mission(flown, picture)
        console.say(f"picture: {picture}")
    if mission is not None:
        write_mission(flown, mission)
        console.say(f"mission: swarm-ctl run {mission}")
