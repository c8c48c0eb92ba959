"""`swarm-ctl study`: thousands of missions at once; `paper`: the seed paper's experiments again."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias

import typer
from typer.main import get_command

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import (
    Processes,
    Seed,
    alone_at,
    alone_in,
    option,
    require_writable,
)
from swarm_ctl.errors import InputError
from swarm_ctl.installed import require

if TYPE_CHECKING:
    from swarm_ctl.study.parameter_space import Study


def _one(metavar: str, text: str, default: float | str) -> Any:
    """An option of the study's law, which a file may give as well."""
    return option(metavar, f"{text}  [default: {default}]")


Given: TypeAlias = str | None
LEAGUE_H: Final = 0.2
BUDGET: Final = 10_000
_HAND_MADE: Final = ("law", "about", "by")
"""Fields of a study's file that are no list, range or number."""
_UNIT: Final = re.compile(r"(?<!unit)_(s|mps|mps2)$")
_OUT: Final = (".csv", ".parquet")
_PICTURES: Final = (".gif", ".png")
_WITH: Final = {
    "--picture": ("--row", "--search", "several laws"),
    "--mission": ("--row", "--search"),
    "--budget": ("--search",),
}
"""What an option needs one of."""
_NOT_WITH: Final = {
    "--by": ("--row", "--search", "several laws"),
    "--curves": ("--row", "--search", "several laws"),
    "--cluster": ("--row",),
}
_GIVEN: Final = "swarm_ctl.study"


def options_of_study() -> list[Any]:
    """One for each field of a study's file, with its help, as typer makes them."""
    from swarm_ctl.study.parameter_space import RANGES, StudyFile

    kinds = dict[str, Any]()
    for name, field in StudyFile.model_fields.items():
        if name in _HAND_MADE:
            continue
        listed = isinstance(field.default, tuple)
        metavar = "X,LOW:HIGH,..." if name in RANGES else "A,B,..." if listed else "NUMBER"
        values = field.default if listed else (field.default,)
        default = "" if None in values else f"  [default: {','.join(map(str, values))}]"
        text = " ".join(str(field.description).replace("`", "").split())
        flag = f"--{_UNIT.sub('', name).replace('_', '-')}"
        asked = option(metavar, text + default, flag, callback=_keep, expose_value=False)
        kinds[name] = Annotated[str | None, asked]

    def fields() -> None:
        """Stands for a command that has them."""

    keyword = inspect.Parameter.KEYWORD_ONLY
    fields.__annotations__ = kinds
    fields.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [inspect.Parameter(n, keyword, default=None, annotation=k) for n, k in kinds.items()]
    )
    app = typer.Typer(add_completion=False)
    app.command()(fields)
    return list(get_command(app).params)


def _keep(context: typer.Context, parameter: typer.CallbackParam, given: str | None) -> None:
    if given is not None:
        context.meta.setdefault(_GIVEN, {})[parameter.name] = given


def study(
    context: typer.Context,
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
    processes: Processes = None,
    cluster: Annotated[
        str | None,
        option("SCHEDULER", "Fly on a Dask cluster: local, a scheduler's address, or its file."),
    ] = None,
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
    by: Annotated[
        Given, option("A,B,...", "Make the table's rows by these only.  [default: all that vary]")
    ] = None,
    curves: Annotated[
        Path | None,
        option("FILE", "Draw what fails over the last list of numbers in --by: .svg or .png."),
    ] = None,
    row: Annotated[
        int | None,
        option("NUMBER", "Fly this row alone: of the study that is said, or of --out's.", min=0),
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
        Path | None,
        option("FILE", "With --row or --search: write it for `run`, with its deaths and losses."),
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
        int | None,
        option(
            "MISSIONS", "Of --search; as many are drawn plainly beside it.  [default: 10000]", min=1
        ),
    ] = None,
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
    from swarm_ctl.study.parameter_space import study_file
    from swarm_ctl.study.rows import read_rows
    from swarm_ctl.study.rows_table import tables

    console = PlainConsole()
    leagues = law is not None and "," in law
    if row is not None and (search is not None or leagues):
        what = "several laws" if leagues else "--search"
        raise InputError(f"{what}: not with --row, which is one mission")
    _check_together(
        [n for n, there in (("--row", row is not None), ("--search", search is not None)) if there]
        + ["several laws"] * leagues,
        {
            "--picture": picture,
            "--mission": mission,
            "--budget": budget,
            "--by": by,
            "--curves": curves,
            "--cluster": cluster,
        },
    )
    name = file.stem if file else "study"
    out = out or Path(f"{name}-{search}.csv" if search else f"{name}.csv")
    if out.is_dir() and out.suffix != ".parquet":
        raise InputError(f"--out {out}: is a folder; allowed: a .csv file, or a .parquet folder")
    for path, name in ((picture, "--picture"), (mission, "--mission"), (curves, "--curves")):
        if path is not None:
            require_writable(path, f"choose with {name}")
    in_law = {"r": r, "r_out": r_out, "r_in": r_in, "delta_l": delta_l, "delta_a": delta_a}
    given = {
        **context.meta.get(_GIVEN, {}),
        "law": _those(in_law | {"own": law, "parameters": _numbers(parameters)}),
        "by": by,
    }
    if leagues:
        if parameters is not None:
            raise InputError("--parameters: allowed: with one law")
        # as missions fly it; a study's own default is the gain that is safe without the filter
        given = {"h": str(LEAGUE_H)} | given | {"law": _those(in_law)}
    if row is not None and file is None and not _those(given):
        _rerun(out, row, None, picture, mission, console)
        return
    said = study_file(file, _those(given))
    plan = said.study
    if row is not None:
        _rerun(out, row, plan, picture, mission, console)
        return
    if out.suffix not in _OUT:
        raise InputError(f"--out {out}: allowed: a {_OUT[0]} file, or a {_OUT[1]} folder")
    require_writable(out, "choose with --out")
    if leagues:
        if search is not None:
            raise InputError("--search: allowed: with one law")
        _check_extras(out, processes, cluster)
        _league(plan, str(law), out, processes, cluster, picture, console)
        return
    if search is not None:
        _check_extras(out, processes, cluster)
        found = _search(plan, search, budget or BUDGET, out, processes, cluster, console)
        _rerun(out, found, None, picture, mission, console)
        return
    names = _varied(said.by, plan) if by else tuple(n for n in said.by if n in plan.varied)
    _check_extras(out, processes, cluster)
    if curves is not None:
        from swarm_ctl.study.curves import axis, draw_curves

        axis(plan, names or plan.varied, curves)
    with alone_at(out):
        run_study(plan, out, processes, console, cluster)
    for each in tables(plan, read_rows(out), names, width=console.width):
        console.print(each)
    console.say(f"rows: {out}")
    if curves is not None:
        curves.parent.mkdir(parents=True, exist_ok=True)
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


def _check_together(ways: Sequence[str], given: Mapping[str, Any]) -> None:
    """InputError for an option that this way of flying would leave unread."""
    for option_name in (name for name, value in given.items() if value is not None):
        needs = _WITH.get(option_name)
        if needs is not None and not set(needs) & set(ways):
            raise InputError(f"{option_name}: allowed: with {' or '.join(needs)}")
        for way in _NOT_WITH.get(option_name, ()):
            if way in ways:
                raise InputError(f"{option_name}: not with {way}")
    picture: Path | None = given["--picture"]
    if picture is not None and "several laws" not in ways and picture.suffix not in _PICTURES:
        raise InputError(f"--picture {picture}: allowed: {', '.join(_PICTURES)}")


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
    Goal(goal).require_in(plan)
    if out.exists():
        raise InputError(f"{out}: is there already; choose another --out")
    fly = partial(fly_studies, processes=processes, cluster=cluster)
    with alone_at(out):
        found = worst(plan, Goal(goal), budget, fly, say=console.say)
        plain = worst(plan, Goal(goal), budget, fly, narrow=False)
        console.say(f"searched, {budget} missions: {Goal(goal).told(found.row)}")
        console.say(f"plain random sampling, {budget} missions: {Goal(goal).told(plain.row)}")
        deeper = max(found, plain, key=lambda find: find.badness)
        run_study(deeper.study, out, processes, console, cluster)
    row = int(deeper.row["row"])
    console.say(f"the worse one again: swarm-ctl study --out {quote(str(out))} --row {row}")
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
    with alone_at(out):
        places = fly_league(plan, laws_of(laws), out, processes, console, cluster)
    wide = console if console.is_terminal else PlainConsole(width=160)
    wide.print(table(places))
    drawn.parent.mkdir(parents=True, exist_ok=True)
    draw_league(places, plan.law.r_in, drawn)
    console.say(f"picture: {drawn}")


def _rerun(
    out: Path,
    row: int,
    plan: Study | None,
    picture: Path | None,
    mission: Path | None,
    console: PlainConsole,
) -> None:
    from swarm_ctl.study.rerun import rerun, write_mission

    flown = rerun(out, row, plan)
    console.print(flown.table())
    for path in filter(None, (picture, mission)):
        path.parent.mkdir(parents=True, exist_ok=True)
    if picture is not None:
        from swarm_ctl.study.mission_figures import draw_mission

        draw_mission(flown, picture)
        console.say(f"picture: {picture}")
    if mission is not None:
        lost = write_mission(flown, mission, _form_begins_s)
        console.say(f"mission: swarm-ctl run {quote(str(mission))}")
        if lost:
            console.say(f"the row flew with what a file cannot carry: {'; '.join(lost)}")


def _form_begins_s(mission: Path) -> float:
    """When all are up and the second step begins, on the virtual clock."""
    from swarm_ctl.mission.compile.loader import load
    from swarm_ctl.virtual.virtual_swarm import VirtualSwarm

    swarm = VirtualSwarm(load(mission))
    while any(member.alive for member in swarm.members.values()):
        if swarm.in_step(2):
            return swarm.now
        swarm.tick()
    raise InputError(f"{mission}: its take-off ends the flight, so the row's deaths have no time")


def paper(
    out: Annotated[Path, option("FOLDER", "Where figures, rows and claims are written.")] = Path(
        "paper"
    ),
    seeds: Annotated[int, option("NUMBER", "Missions for each experiment.", min=1)] = 1000,
    seed: Seed = 1,
    processes: Processes = None,
) -> None:
    """Reproduce the paper's experiments and test its claims.

    Section VI of Mondal et al. (2017): Figs. 7-17, in the discrete form (9) and in continuous time,
    and each claim over many seeds. A run that was interrupted continues where it ended.

    Examples:

    \b
        swarm-ctl paper
        swarm-ctl paper --seeds 50 --out quick
    """
    from swarm_ctl.study.paper.reproduce import reproduce

    require_writable(out, "choose with --out")
    console = PlainConsole()
    wide = console if console.is_terminal else PlainConsole(width=160)
    with alone_in(out):
        reproduce(out, seeds, seed, processes, wide)
