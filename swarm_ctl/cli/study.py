"""`swarm-ctl study`: thousands of missions at once."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.extras import require
from swarm_ctl.cli.shared.options import Processes, Seed, option
from swarm_ctl.errors import InputError

if TYPE_CHECKING:
    from swarm_ctl.study.parameter_space import Study


_A, _X, _U = "A,B,...", "X,LOW:HIGH,...", "UNITS"


def study(
    out: Annotated[
        Path, option("FILE", "Where the rows go: a .csv file, or a .parquet folder.")
    ] = Path("study.csv"),
    missions: Annotated[int, option("NUMBER", "Missions for each combination.", min=1)] = 1000,
    seed: Seed = 1,
    processes: Processes = None,
    cluster: Annotated[
        str | None,
        option("SCHEDULER", "Fly on a Dask cluster: local, a scheduler's address, or its file."),
    ] = None,
    n: Annotated[str, option(_A, "Number of agents; 2:50 is every number from 2 to 50.")] = "6",
    shape: Annotated[str, option(_A, "ring, line, grid, vee, wedge.")] = "ring",
    slots: Annotated[
        str, option(_A, "How slots are assigned: given, random, nearest.")
    ] = "nearest",
    start: Annotated[
        str, option(_A, "Where agents start: random, ring, grid, table2, crossing, antipodal.")
    ] = "random",
    compensation: Annotated[
        str, option(_A, "What the law is fed with: stop_point, none (the position).")
    ] = "stop_point",
    vehicle: Annotated[
        str, option(_A, "ideal, lag (dead time and first-order lag), ardupilot, px4.")
    ] = "lag",
    safety: Annotated[
        str,
        option(_A, "off, filter, guard, release, align, exchange; each includes those before it."),
    ] = "align",
    silent: Annotated[str, option(_X, "Share of missions in which agents die.")] = "0",
    silent_agents: Annotated[
        str, option(_X, "How many die in these; under 1: which share of the agents.")
    ] = "1",
    h: Annotated[str, option(_X, "The law's consensus gain h.")] = "0.05",
    kappa: Annotated[str, option(_X, "The law's iterations a second.")] = "20",
    speed: Annotated[str, option(_A, "Speed limit of the agents, in m/s.")] = "5",
    lag: Annotated[str, option(_X, "True lag of the vehicles `lag`, in seconds.")] = "0.5",
    dead_time: Annotated[
        str, option(_X, "True dead time of the vehicles `lag`, in seconds.")
    ] = "0.4",
    acceleration: Annotated[
        str, option(_X, "True acceleration limit of the vehicles `lag`, in m/s2.")
    ] = "2.8",
    spread: Annotated[
        str,
        option(_A, "mission, agent: what draws its lag, dead time and acceleration from a range."),
    ] = "mission",
    model_lag: Annotated[
        str,
        option(
            _A,
            "Lag that the agents believe.  [default: the middle of --lag (one value: a perfect"
            " model); the autopilot's typical one]",
        ),
    ] = "",
    model_dead_time: Annotated[
        str, option(_A, "Dead time that they believe.  [default: likewise]")
    ] = "",
    model_acceleration: Annotated[
        str, option(_A, "Acceleration limit that they believe.  [default: likewise]")
    ] = "",
    delay: Annotated[str, option(_X, "Age of a peer's state when it arrives, in seconds.")] = "0",
    jitter: Annotated[
        str, option(_X, "Each state is later by up to this, in seconds; late ones may overtake.")
    ] = "0",
    loss: Annotated[str, option(_X, "Share of states that are lost.")] = "0",
    burst: Annotated[
        str, option(_X, "Mean length of a burst of losses, in seconds; 0: single losses.")
    ] = "0",
    wind: Annotated[
        str, option(_X, "Wind in m/s; only the vehicles ardupilot and px4 feel it.")
    ] = "0",
    area: Annotated[
        str, option(_X, "Side of the square of random starts, in units; 0: chosen by n.")
    ] = "0",
    spacing: Annotated[str, option(_X, "Distance of adjacent slots, in units.")] = "2",
    start_spacing: Annotated[
        float, option(_U, "Least distance of random starts; 0: twice --r-in.")
    ] = 0.0,
    r: Annotated[float, option(_U, "Interaction range.")] = 4.5,
    r_out: Annotated[float, option(_U, "Outer radius.")] = 1.5,
    r_in: Annotated[float, option(_U, "Inner radius.")] = 0.5,
    limit: Annotated[
        float, option("SECONDS", "End a mission that has not formed by then.")
    ] = 300.0,
    tick: Annotated[float, option("SECONDS", "Length of a tick.")] = 0.05,
    by: Annotated[
        str, option(_A, "Make the table's rows by these only.  [default: all that vary]")
    ] = "",
    row: Annotated[
        int | None, option("NUMBER", "Fly this row of --out again, alone.", min=0)
    ] = None,
    picture: Annotated[
        Path | None, option("FILE", "With --row: draw it, as .gif (animated) or .png.")
    ] = None,
    mission: Annotated[
        Path | None, option("FILE", "With --row: write it as a mission for `run`.")
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
        swarm-ctl study --n 2:50 --cluster local --out wide.parquet
    """
    from swarm_ctl.study.executor import run_study
    from swarm_ctl.study.rows import read_rows
    from swarm_ctl.study.rows_table import table

    console = PlainConsole()
    if row is not None:
        _rerun(out, row, picture, mission, console)
        return
    plan = _study(
        seed=seed,
        missions=missions,
        limit_s=limit,
        tick_s=tick,
        start_spacing=start_spacing,
        law={"r": r, "r_out": r_out, "r_in": r_in},
        n=n,
        shape=shape,
        slots=slots,
        start=start,
        compensation=compensation,
        vehicle=vehicle,
        safety=safety,
        h=h,
        kappa=kappa,
        speed_mps=speed,
        lag_s=lag,
        dead_time_s=dead_time,
        acceleration_mps2=acceleration,
        spread=spread,
        model_lag_s=model_lag,
        model_dead_time_s=model_dead_time,
        model_acceleration_mps2=model_acceleration,
        delay_s=delay,
        jitter_s=jitter,
        loss=loss,
        burst_s=burst,
        wind_mps=wind,
        area=area,
        spacing=spacing,
        silent=silent,
        silent_agents=silent_agents,
    )
    _check_extras(out, processes, cluster)
    run_study(plan, out, processes, console, cluster)
    wide = console if console.is_terminal else PlainConsole(width=200)
    wide.print(table(plan, read_rows(out), _by(by, plan)))
    console.say(f"rows: {out}")


def _check_extras(out: Path, processes: int | None, cluster: str | None) -> None:
    if cluster is not None:
        require("cluster", "study --cluster")
        if processes is not None and cluster != "local":
            raise InputError(
                "--processes: this cluster has workers of its own; allowed: with --cluster local"
            )
    if out.suffix == ".parquet":
        require("cluster", "study --out FOLDER.parquet")


def _study(**given: Any) -> Study:
    """The study of these fields; an empty text is the default."""
    from pydantic import ValidationError

    from swarm_ctl.study.parameter_space import Study

    try:
        return Study.model_validate({k: v for k, v in given.items() if v != ""})
    except ValidationError as error:
        found = error.errors(include_url=False)[0]
        where = found["loc"][0] if found["loc"] else "study"
        raise InputError(f"{where}: {found['msg'].removeprefix('Value error, ')}") from None


def _by(text: str, study: Study) -> tuple[str, ...]:
    names = tuple(text.split(",")) if text else ()
    unknown = [name for name in names if name not in study.varied]
    if unknown:
        varied = ", ".join(study.varied) or "nothing"
        raise InputError(f"--by {unknown[0]}: is not varied here; allowed: {varied}")
    return names


def _rerun(
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
