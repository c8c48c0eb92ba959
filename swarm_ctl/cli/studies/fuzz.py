"""`swarm-ctl fuzz`: fly scenarios that are drawn, and find what breaks an invariant."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Final

import typer

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import Processes, alone_in, option, require_writable
from swarm_ctl.errors import InputError
from swarm_ctl.mission.ready import named

if TYPE_CHECKING:
    from swarm_ctl.fuzz.campaign import Campaign

_SHRUNK: Final = 10
"""Of what was found so many kinds are made small; the table has all of them."""


def fuzz(
    mission: Annotated[
        Path | None,
        typer.Argument(
            metavar="MISSION",
            help="A mission to vary: weather, mesh and what happens are drawn around it."
            "  [default: missions are drawn, too]",
            callback=lambda given: given and named(given),
        ),
    ] = None,
    flights: Annotated[int, option("NUMBER", "How many flights.", min=1)] = 200,
    limit: Annotated[
        float | None, option("SECONDS", "End after so long; default: none.", "--time", min=1)
    ] = None,
    seed: Annotated[int, option("NUMBER", "Of all that is drawn.", min=0)] = 1,
    processes: Processes = None,
    lockstep: Annotated[
        int, option("NUMBER", "Fly one in so many by processes in lockstep, too; 0: none.", min=0)
    ] = 0,
    out: Annotated[
        Path, option("FOLDER", "Journal and finds; the same command goes on from there.")
    ] = Path("fuzz"),
    replay: Annotated[
        Path | None,
        option("FILE", "Fly this scenario alone, and leave a run folder for `replay`, `report`."),
    ] = None,
) -> None:
    """Fly scenarios that are drawn, and find what breaks an invariant.

    Draws missions, fleets, weather, a mesh that loses and delays, and what happens: orders, deaths,
    restarts, pilots, failing vehicles, lies. Flies them on the virtual clock, on all cores, and
    judges each by the simulator's truth. What was met less often is drawn more often. What breaks
    an invariant is made as small as it goes, and written as a scenario and a test of a few lines.

    The exit code is 0 where all held, 1 where something broke.

    Examples:

    \b
        swarm-ctl fuzz --flights 1000
        swarm-ctl fuzz missions/square.yaml --time 600 --seed 7 --out squares
        swarm-ctl fuzz --replay fuzz/found/apart-1-211.yaml
    """
    console = PlainConsole()
    if replay is not None:
        if mission is not None:
            raise InputError(f"{mission} with --replay {replay}: a scenario has its own mission")
        raise typer.Exit(_replay(replay, out, console))
    campaign = _campaign(mission, seed, out)
    campaign.lockstep = lockstep
    require_writable(out, "choose with --out")
    with alone_in(out):
        campaign.load()
        _fly(campaign, flights, processes, limit, console)
        console.print(campaign.coverage().table())
        raise typer.Exit(_say(campaign, console))


def _campaign(mission: Path | None, seed: int, out: Path) -> Campaign:
    from swarm_ctl.fuzz.campaign import Campaign
    from swarm_ctl.mission.compile.loader import load

    if mission is None:
        return Campaign(seed, out)
    loaded = load(mission)  # its mistakes first
    data = loaded.file.model_dump(mode="json", exclude_unset=True, by_alias=True)
    if isinstance(data.get("fleet"), str):
        data["fleet"] = str(mission.resolve().parent / data["fleet"])
    return Campaign(seed, out, data)


def _fly(
    campaign: Campaign,
    flights: int,
    processes: int | None,
    limit_s: float | None,
    console: PlainConsole,
) -> None:
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    from swarm_ctl.engine.clock import wall_s

    until_s = wall_s() + limit_s if limit_s is not None else float("inf")
    columns = (TextColumn("flights"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("flights", total=flights, completed=len(campaign.done))
        try:
            for flight in campaign.fly(flights, processes, until_s):
                progress.advance(task)
                for each in flight.broken:
                    said = each.text.strip().splitlines()[-1]
                    progress.print(f"flight {flight.number}: {each.invariant}: {said}")
        except (KeyboardInterrupt, SystemExit):  # the second is what the command makes of it
            progress.print(
                f"{campaign.folder}: {len(campaign.done)} flights; the same command goes on"
            )
            raise


def _say(campaign: Campaign, console: PlainConsole) -> int:
    """The finds, made small; the exit code."""
    from swarm_ctl.fuzz.campaign import write_found
    from swarm_ctl.fuzz.shrink import shrink
    from swarm_ctl.virtual.scenario import scenario_text

    done = campaign.done.values()
    flown_s, cpu_s = sum(f.flown_s for f in done), sum(f.cpu_s for f in done)
    pace = f", {flown_s / cpu_s:.0f} times real time on a core" if cpu_s else ""
    kinds = campaign.found()
    bad = sum(bool(flight.broken) for flight in done)
    console.say(
        f"{len(done)} flights, {flown_s / 3600:.1f} h of flight{pace}; {bad} broke something"
    )
    for (invariant, _), found in list(kinds.items())[:_SHRUNK]:
        first = found[0]
        console.say(f"{invariant}: {len(found)} flights, the first is {first.number}", style="red")
        what = next(each for each in first.broken if each.invariant is invariant)
        scenario, _ = campaign.scenario(first.number)
        small = shrink(scenario, what, lambda words: console.say(f"  smaller: {words}"))
        if small is None:
            console.say("  flown again now, it does not break that; for all again: another --out")
            continue
        name = f"{invariant.name.lower()}-{campaign.seed}-{first.number}"
        path, test = write_found(campaign.folder, name, what.text, scenario_text(small))
        console.say(f"  {path}, and a test: {test}")
        console.say(f"  again: swarm-ctl fuzz --replay {quote(str(path))}")
    if len(kinds) > _SHRUNK:
        console.say(f"and {len(kinds) - _SHRUNK} kinds more, in {campaign.folder}")
    return 1 if kinds else 0


def _replay(path: Path, out: Path, console: PlainConsole) -> int:
    """Fly it with a run folder, which must not be there yet."""
    from swarm_ctl.fuzz.campaign import fly
    from swarm_ctl.report.page.summary_table import verdict_line
    from swarm_ctl.virtual.scenario import load_scenario

    scenario, mission = load_scenario(path)
    folder = out / "replayed" / path.stem
    if folder.exists():
        raise InputError(f"{folder}: is there already; delete it, or choose another --out")
    require_writable(folder, "choose with --out")
    flown, found = fly(scenario, mission, folder, twice=True)
    if flown is not None:
        console.print(verdict_line(flown.summary))
    for each in found:
        console.say(f"{each.invariant}: {each.text}", style="red")
    console.say("no invariant broke" if not found else f"{len(found)} broke")
    if flown is not None:
        typed = quote(str(folder))
        console.say(f"watch it: swarm-ctl replay {typed}; its page: swarm-ctl report {typed}")
    return 1 if found else 0
