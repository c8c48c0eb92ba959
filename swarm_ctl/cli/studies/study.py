"""`swarm-ctl study`: thousands of missions at once."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias

import typer

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import Processes, option
from swarm_ctl.cli.shared.writable import require_writable
from swarm_ctl.errors import InputError
from swarm_ctl.installed import require

if TYPE_CHECKING:
    from swarm_ctl.study.parameter_space import Study


def _one(metavar: str, text: str, default: float | str) -> Any:
    """An option of the study, which a file may give as well."""
    return option(metavar, f"{text}  [default: {default}]")


def _list(text: str, default: float | str) -> Any:
    return _one("A,B,...", text, default)


def _ranges(text: str, default: float | str) -> Any:
    return _one("X,LOW:HIGH,...", text, default)


Given: TypeAlias = str | None
LEAGUE_H: Final = 0.2
_MODEL = "the middle of --{} (so one value is a perfect model); of a firmware its typical one"


def study(
    file: Annotated[
        Path | None,
        typer.Argument(metavar="STUDY", help="A study file; options come before what it says."),
    ] = None,
    out: Annotated[
        Path | None,
        option(
            "FILE",
            "Where the rows go: a .csv file, or a .parquet folder.  [default: study.csv, or the"
            " study file's name]",
        ),
    ] = None,
    missions: Annotated[Given, _one("NUMBER", "Missions for each combination.", 1000)] = None,
    seed: Annotated[Given, _one("NUMBER", "Seed of all random numbers.", 1)] = None,
    processes: Processes = None,
    cluster: Annotated[
        str | None,
        option("SCHEDULER", "Fly on a Dask cluster: local, a scheduler's address, or its file."),
    ] = None,
    n: Annotated[Given, _list("Number of agents; 2:50 is every number from 2 to 50.", 6)] = None,
    shape: Annotated[Given, _list("ring, line, grid, vee, wedge.", "ring")] = None,
    slots: Annotated[
        Given, _list("How slots are assigned: given, random, nearest.", "nearest")
    ] = None,
    start: Annotated[
        Given,
        _list("Where agents start: random, ring, grid, table2, crossing, antipodal.", "random"),
    ] = None,
    compensation: Annotated[
        Given, _list("What the law is fed with: stop_point, none (the position).", "stop_point")
    ] = None,
    vehicle: Annotated[
        Given, _list("ideal, lag (dead time and first-order lag), ardupilot, px4.", "lag")
    ] = None,
    safety: Annotated[
        Given,
        _list("off, filter, guard, release, align, exchange; each includes those before.", "align"),
    ] = None,
    silent: Annotated[Given, _ranges("Share of missions in which agents die.", 0)] = None,
    silent_agents: Annotated[
        Given, _ranges("How many die in these; under 1: which share of the agents.", 1)
    ] = None,
    h: Annotated[Given, _ranges("The law's consensus gain h.", 0.05)] = None,
    kappa: Annotated[Given, _ranges("The law's iterations a second.", 20)] = None,
    speed: Annotated[Given, _list("Speed limit of the agents, in m/s.", 5)] = None,
    lag: Annotated[Given, _ranges("True lag of the vehicles `lag`, in seconds.", 0.5)] = None,
    dead_time: Annotated[
        Given, _ranges("True dead time of the vehicles `lag`, in seconds.", 0.4)
    ] = None,
    acceleration: Annotated[
        Given, _ranges("True acceleration limit of the vehicles `lag`, in m/s2.", 2.8)
    ] = None,
    late: Annotated[
        Given,
        _ranges("So much later all vehicles answer, unknown to agents, in seconds; or earlier.", 0),
    ] = None,
    lag_error: Annotated[
        Given, _ranges("So much longer the true lag is, unknown to agents; or shorter.", 0)
    ] = None,
    spread: Annotated[
        Given,
        _list(
            "mission, agent: what draws lag, dead time, acceleration, delay, lateness.", "mission"
        ),
    ] = None,
    model_lag: Annotated[Given, _list("Lag that the agents believe.", _MODEL.format("lag"))] = None,
    model_dead_time: Annotated[
        Given, _list("Dead time that they believe.", _MODEL.format("dead-time"))
    ] = None,
    model_acceleration: Annotated[
        Given, _list("Acceleration limit that they believe.", _MODEL.format("acceleration"))
    ] = None,
    delay: Annotated[Given, _ranges("Age of a state when it arrives, in seconds.", 0)] = None,
    jitter: Annotated[
        Given, _ranges("Each state is later by up to this, in seconds; some overtake.", 0)
    ] = None,
    loss: Annotated[Given, _ranges("Share of states that are lost.", 0)] = None,
    burst: Annotated[
        Given, _ranges("Mean length of a burst of losses, in seconds; 0: single losses.", 0)
    ] = None,
    wind: Annotated[
        Given, _ranges("Wind in m/s; only the vehicles ardupilot and px4 feel it.", 0)
    ] = None,
    area: Annotated[
        Given, _ranges("Side of the square of random starts, in units; 0: chosen by n.", 0)
    ] = None,
    spacing: Annotated[Given, _ranges("Distance of adjacent slots, in units.", 2)] = None,
    start_spacing: Annotated[
        Given, _one("UNITS", "Least distance of random starts; 0: twice --r-in.", 0)
    ] = None,
    wood: Annotated[
        Given,
        _list(
            "What is flown through in file: none, trunks, gate, trap (open to the start).", "none"
        ),
    ] = None,
    trunks: Annotated[Given, _ranges("How many trunks a wood has.", 28)] = None,
    trunk: Annotated[Given, _ranges("Mean radius of trunks, in units.", 0.35)] = None,
    gap: Annotated[
        Given, _ranges("Between trunks at least, and the width of a gate, in units.", 1)
    ] = None,
    wood_side: Annotated[Given, _one("UNITS", "Side of a wood.", 16)] = None,
    r: Annotated[Given, _one("UNITS", "Interaction range.", 4.5)] = None,
    r_out: Annotated[Given, _one("UNITS", "Outer radius.", 1.5)] = None,
    r_in: Annotated[Given, _one("UNITS", "Inner radius.", 0.5)] = None,
    delta_l: Annotated[Given, _one("NUMBER", "Offset of the paper's D.", 2)] = None,
    delta_a: Annotated[Given, _one("NUMBER", "Offset of sigma above its bound.", 0.1)] = None,
    law: Annotated[
        Given,
        _one(
            "NAME,...",
            "A law of `swarm-ctl law`. Of several, the league: the same missions by each, without"
            " and with the filter.",
            "paper",
        ),
    ] = None,
    parameters: Annotated[
        Given, _one("NAME=VALUE,...", "Numbers of the --law.", "the law's own")
    ] = None,
    unit_m: Annotated[Given, _one("METRES", "Length of a unit.", 5)] = None,
    limit: Annotated[Given, _one("SECONDS", "End a mission that has not formed then.", 300)] = None,
    tick: Annotated[Given, _one("SECONDS", "Length of a tick.", 0.05)] = None,
    by: Annotated[
        Given, option("A,B,...", "Make the table's rows by these only.  [default: all that vary]")
    ] = None,
    curves: Annotated[
        Path | None,
        option("FILE", "Draw what fails over the last list of numbers in --by: .svg or .png."),
    ] = None,
    row: Annotated[
        int | None, option("NUMBER", "Fly this row of --out again, alone.", min=0)
    ] = None,
    picture: Annotated[
        Path | None,
        option(
            "FILE",
            "With --row or --search: draw it, as .gif (animated) or .png. With several laws: the"
            " league.  [default of the league: beside the rows]",
        ),
    ] = None,
    mission: Annotated[
        Path | None, option("FILE", "With --row or --search: write it as a mission for `run`.")
    ] = None,
    search: Annotated[
        str | None,
        option(
            "GOAL",
            "Search for the worst mission over all lists and ranges: smallest (distance), silent"
            " (distance to a dead agent's vehicle), slowest, zone (distance to one), link (torn).",
        ),
    ] = None,
    budget: Annotated[
        int, option("MISSIONS", "Of --search; as many are drawn plainly beside it.", min=1)
    ] = 10_000,
) -> None:
    """Fly thousands of missions in one go, compiled.

    What is flown is said by a study file (`studies/` has some), by options, or both. Options with
    A,B,... are lists: every combination of their values is flown. Those with
    X,LOW:HIGH,... are lists too; from a range, each mission draws its own value. Lengths are the
    law's units. The study itself is written beside its rows, as JSON; a study that was interrupted
    continues where it ended.

    Examples:

    \b
        swarm-ctl study studies/mix.yaml
        swarm-ctl study studies/mix.yaml --seed 2 --missions 1000 --out mix2.csv
        swarm-ctl study --n 4,6,9 --slots random,nearest --missions 2000
        swarm-ctl study --safety off,align --start crossing --slots given
        swarm-ctl study --delay 0:0.2 --loss 0:0.2 --out late.csv
        swarm-ctl study --wood trunks,gate,trap --n 2:8 --missions 100
        swarm-ctl study --law paper,orca,vasarhelyi --missions 300
        swarm-ctl study --law orca --parameters apart=1.2,horizon=2 --safety off
        swarm-ctl study studies/envelope-delay.yaml --curves delay.svg
        swarm-ctl study --out late.csv --row 4711 --picture 4711.gif
        swarm-ctl study --n 2:50 --cluster local --out wide.parquet
        swarm-ctl study studies/search.yaml --search smallest --budget 20000
    """
    from swarm_ctl.study.executor import run_study
    from swarm_ctl.study.rows import read_rows
    from swarm_ctl.study.rows_table import tables
    from swarm_ctl.study.study_file import study_file

    console = PlainConsole()
    if row is not None and search is not None:
        raise InputError("--search: not with --row, which is one mission")
    name = file.stem if file else "study"
    out = out or Path(f"{name}-{search}.csv" if search else f"{name}.csv")
    for path, name in ((picture, "--picture"), (mission, "--mission"), (curves, "--curves")):
        if path is not None:
            require_writable(path, f"choose with {name}")
    if row is not None:
        _rerun(out, row, picture, mission, console)
        return
    in_law = {"r": r, "r_out": r_out, "r_in": r_in, "delta_l": delta_l, "delta_a": delta_a}
    given = {
        "seed": seed,
        "missions": missions,
        "limit_s": limit,
        "tick_s": tick,
        "unit_m": unit_m,
        "start_spacing": start_spacing,
        "n": n,
        "shape": shape,
        "slots": slots,
        "start": start,
        "compensation": compensation,
        "vehicle": vehicle,
        "safety": safety,
        "h": h,
        "kappa": kappa,
        "speed_mps": speed,
        "lag_s": lag,
        "dead_time_s": dead_time,
        "acceleration_mps2": acceleration,
        "late_s": late,
        "lag_error_s": lag_error,
        "spread": spread,
        "model_lag_s": model_lag,
        "model_dead_time_s": model_dead_time,
        "model_acceleration_mps2": model_acceleration,
        "delay_s": delay,
        "jitter_s": jitter,
        "loss": loss,
        "burst_s": burst,
        "wind_mps": wind,
        "area": area,
        "spacing": spacing,
        "silent": silent,
        "silent_agents": silent_agents,
        "wood": wood,
        "trunks": trunks,
        "trunk": trunk,
        "gap": gap,
        "wood_side": wood_side,
        "law": _those(in_law | {"own": law, "parameters": _numbers(parameters)}),
        "by": by,
    }
    leagues = law is not None and "," in law
    if leagues:
        if parameters is not None:
            raise InputError("--parameters: allowed: with one law")
        # as missions fly it; a study's own default is the gain that is safe without the filter
        given |= {"law": _those(in_law), "h": h or str(LEAGUE_H)}
    said = study_file(file, _those(given))
    plan = said.study
    require_writable(out, "choose with --out")
    if leagues:
        if search is not None:
            raise InputError("--search: allowed: with one law")
        _check_extras(out, processes, cluster)
        _league(plan, str(law), out, processes, cluster, picture, console)
        return
    if search is not None:
        _check_extras(out, processes, cluster)
        found = _search(plan, search, budget, out, processes, cluster, console)
        _rerun(out, found, picture, mission, console)
        return
    names = _varied(said.by, plan) if by else tuple(n for n in said.by if n in plan.varied)
    _check_extras(out, processes, cluster)
    if curves is not None:
        from swarm_ctl.study.curves import axis, draw_curves

        axis(plan, names or plan.varied, curves)
    run_study(plan, out, processes, console, cluster)
    for each in tables(plan, read_rows(out), names, width=console.width):
        console.print(each)
    console.say(f"rows: {out}")
    if curves is not None:
        draw_curves(plan, read_rows(out), names or plan.varied, curves)
        console.say(f"curves: {curves}")


def _those(given: Mapping[str, Any]) -> dict[str, Any]:
    """What was given."""
    return {name: value for name, value in given.items() if value not in (None, {})}


def _numbers(text: str | None) -> dict[str, float]:
    """`rate=1.5,width=2` by name."""
    found = dict[str, float]()
    for word in text.split(",") if text else ():
        name, _, number = word.partition("=")
        try:
            found[name] = float(number)
        except ValueError:
            raise InputError(f"--parameters {word}: allowed: NAME=VALUE, as in rate=1.5") from None
    return found


def _check_extras(out: Path, processes: int | None, cluster: str | None) -> None:
    if cluster is not None:
        require("cluster", "study --cluster")
        if processes is not None and cluster != "local":
            raise InputError(
                "--processes: this cluster has workers of its own; allowed: with --cluster local"
            )
    if out.suffix == ".parquet":
        require("cluster", "study --out FOLDER.parquet")


def _varied(names: tuple[str, ...], study: Study) -> tuple[str, ...]:
    unknown = [name for name in names if name not in study.varied]
    if unknown:
        varied = ", ".join(study.varied) or "nothing"
        raise InputError(f"--by {unknown[0]}: is not varied here; allowed: {varied}")
    return names


def _search(
    plan: Study,
    goal: str,
    budget: int,
    out: Path,
    processes: int | None,
    cluster: str | None,
    console: PlainConsole,
) -> int:
    """Its row at `out`, which becomes the study of the worst mission's region."""
    from swarm_ctl.study.executor import fly_studies, run_study
    from swarm_ctl.study.search import Goal, worst

    if goal not in [*Goal]:
        raise InputError(f"--search {goal}: allowed: {', '.join(Goal)}")
    if out.exists():
        raise InputError(f"{out}: is there already; choose another --out")
    fly = partial(fly_studies, processes=processes, cluster=cluster)
    found = worst(plan, Goal(goal), budget, fly, say=console.say)
    plain = worst(plan, Goal(goal), budget, fly, narrow=False)
    console.say(f"searched, {budget} missions: {Goal(goal).told(found.row)}")
    console.say(f"plain random sampling, {budget} missions: {Goal(goal).told(plain.row)}")
    deeper = max(found, plain, key=lambda find: find.badness)
    run_study(deeper.study, out, processes, console, cluster)
    row = int(deeper.row["row"])
    console.say(f"the worse one again: swarm-ctl study --out {out} --row {row}")
    return row


def _league(
    plan: Study,
    laws: str,
    out: Path,
    processes: int | None,
    cluster: str | None,
    picture: Path | None,
    console: PlainConsole,
) -> None:
    from swarm_ctl.study.league import KINDS, draw_league, fly_league, laws_of, table

    drawn = picture or out.with_name(f"{out.stem}-league.png")
    if drawn.suffix not in KINDS:
        raise InputError(f"--picture {drawn}: of a league, allowed: {', '.join(KINDS)}")
    require_writable(drawn, "choose with --picture")
    places = fly_league(plan, laws_of(laws), out, processes, console, cluster)
    wide = console if console.is_terminal else PlainConsole(width=160)
    wide.print(table(places))
    draw_league(places, plan.law.r_in, drawn)
    console.say(f"picture: {drawn}")


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
        lost = write_mission(flown, mission)
        console.say(f"mission: swarm-ctl run {mission}")
        if lost:
            console.say(f"the row flew with what a mission cannot carry: {'; '.join(lost)}")
