"""`swarm-ctl send`: an operator's command to a swarm that flies."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Annotated

import typer

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import (
    IdentityFolder,
    RunName,
    ZenohConfig,
    option,
    switch,
    zenoh_settings,
)
from swarm_ctl.core.model.messages import CommandKind
from swarm_ctl.core.model.plan import Plan, Zone
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.errors import InputError, SwarmError


def send(
    context: typer.Context,
    command: Annotated[
        str,
        typer.Argument(
            metavar="COMMAND", help="One of those above.", autocompletion=complete_orders
        ),
    ],
    arguments: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="WORD", help="What the command needs, as above.", autocompletion=complete_words
        ),
    ] = None,
    run: RunName = None,
    agents: Annotated[
        str | None,
        option(
            "IDS",
            "Only these: ids, or groups of the mission, e.g. 2,5-7 or @scouts,7.  [default: all]",
            autocompletion=complete_agents,
        ),
    ] = None,
    by: Annotated[bool, switch("--by", "move: N and E count from the formation's centre.")] = False,
    speed: Annotated[
        float | None, option("M/S", "move, goto: the speed.  [default: half of the limit]")
    ] = None,
    identity: IdentityFolder = None,
    zenoh_config: ZenohConfig = None,
    yes: Annotated[bool, switch("--yes", "Do not ask before kill.")] = False,
) -> None:
    """Command a swarm that flies, and show each agent's answer.

    \b
    hold                 stop in the air; collision avoidance stays on
    resume               continue the mission
    next                 end the current step
    form SHAPE           fly into another shape of the mission file
    move N E             take the formation's centre N m north, E m east
                         of the origin
    goto N E             send some agents there (--agents 3; or LAT,LON), the
                         others go on without them; join or resume: come back
    launch               send up agents that wait on the ground (--agents 7)
    follow TARGET N E    keep it N m north, E m east of a target of the mission;
                         `course` behind them: ahead of it and to its right
    tune NAME=VALUE ...  set h, kappa, delta_a or delta_l of the law, in all
                         agents or in none; `tune plan`: as in the mission
    zone add NAME ...    a zone that no vehicle enters: `circle N E R`, or
                         `polygon N E N E N E ...` [m]; in all agents or none
    zone lift NAME       it is none any more
    zone list            the zones in force
    land                 land in place
    return               fly home, all at once, and land
    kill                 stop the motors at once: the vehicles fall
    expel AGENT          all others listen to it no more and keep clear of it;
                         it holds where it is
    readmit AGENT        all others listen to it again

    form, move and follow are for the whole swarm, or for one group of the
    mission (--agents @scouts); where it flies in groups, one has to be named.

    Agents that are landed, called back or killed alone have left the
    formation; the others do as the mission says (policies.left_by_order).

    Exit codes: 0 all accepted, 1 an agent refused or did not answer, 2 bad input, 3 no agent is
    heard.

    Examples:

    \b
        swarm-ctl send hold
        swarm-ctl send form vee
        swarm-ctl send move -20 35.5 --speed 2
        swarm-ctl send goto 60 -20 --agents 3
        swarm-ctl send join --agents 3
        swarm-ctl send follow boat -20 0 course
        swarm-ctl send tune h=0.04 kappa=15
        swarm-ctl send zone add pond circle 30 -5 8
        swarm-ctl send land --run hexagon --agents 3
        swarm-ctl send hold --agents @scouts
    """
    from swarm_ctl.commands.answers import answers as answered
    from swarm_ctl.commands.parse import parse
    from swarm_ctl.engine.flying_runs import flying_run
    from swarm_ctl.engine.station.run_client import RunClient
    from swarm_ctl.runfolder.manifest import read_manifest
    from swarm_ctl.station.picture.summaries import command_words

    _refuse_options(context, (command, *(arguments or ())))
    for name, given, kinds in (
        ("--by", by, ("move",)),
        ("--speed", speed is not None, ("move", "goto")),
    ):
        if given and command not in kinds:
            of = " and ".join(kinds)
            raise InputError(f"{name} is of {of} alone; allowed: {command} without it")
    folder, console = flying_run(run), PlainConsole()
    manifest = read_manifest(folder)
    plan = manifest.plan
    words = [command, *(arguments or [])]
    if speed is not None:
        words.append(str(speed))
    if agents is not None:
        words.append("@" + agents.replace(" ", "").replace("@", ""))
    order = parse(" ".join([*words, *(["--by"] if by else [])]), plan)
    if command == "kill" and not yes:
        named = f"@{order.whom}" if order.whom else "EVERY agent"
        what = f"kill: the motors of {named} of {plan.name} ({folder}) stop at once"
        typer.confirm(f"{what} and their vehicles fall. Really?", abort=True)
    own = zenoh_settings(zenoh_config, guarded=manifest.guarded) if zenoh_config else None
    with RunClient(folder, identity=identity, zenoh=own) as client:
        if order.kind == CommandKind.ZONE and order.arguments == ("list",):
            _list_zones(client.zones(), console)
            return
        answers = client.order(order)
        view = client.view()
    whom = f" @{order.whom}" if order.groups else ""
    console.say(f"{order.text}{whom}, {plan.name} ({folder}):")
    for line in answered(answers, plan, view.left, view.beside(answers.meant)):
        console.say(line)
    if answers.silent:
        console.say(f"{agents_named(answers.silent)}: no answer", style="bold red")
    if answers.accepted and answers.command.tuning is not None:
        console.say(f"all agents: {command_words(answers.command)}")
    if answers.failed:
        console.say(f"nothing changes: {answers.failed}", style="bold red")
    raise typer.Exit(0 if answers.accepted else 1)


def _refuse_options(context: typer.Context, words: Sequence[str]) -> None:
    """InputError for what is meant as an option and is none: numbers alone begin with `-`."""
    unknown = [word for word in words if re.match(r"-+[A-Za-z]", word)]
    if unknown:
        from swarm_ctl.mission.input.near_matches import did_you_mean

        given = unknown[0].partition("=")[0]
        names = [name for each in context.command.params for name in each.opts]
        known = [name for name in names if name.startswith("--")]
        hint = did_you_mean(given, known)
        raise InputError(f"{given}: no such option{hint}; allowed: {', '.join(known)}")


def _list_zones(zones: tuple[Zone, ...], console: PlainConsole) -> None:
    """One a line."""
    for zone in zones:
        (north, east), corners = zone.corners_m[0], len(zone.corners_m)
        shape = f"circle of {zone.radius_m:g} m at" if corners == 1 else f"{corners} corners from"
        low = "the ground" if zone.floor_m is None else f"{zone.floor_m:g} m"
        high = "any height" if zone.ceiling_m is None else f"{zone.ceiling_m:g} m"
        place = f"{north:.1f} m north, {east:.1f} m east"
        console.say(
            f"{zone.name}: {shape} {place}, {low} to {high}, clear of {zone.clearance_m:g} m"
        )
    if not zones:
        console.say("no zones")


def complete_orders(incomplete: str) -> list[tuple[str, str]]:
    """The commands of `send`, and what they do."""
    from swarm_ctl.commands.parse import KINDS

    harmless = [kind for kind in KINDS if not kind.asks[0]]
    return [(kind.name, kind.does) for kind in harmless if kind.name.startswith(incomplete)]


def complete_words(ctx: typer.Context, incomplete: str) -> list[str]:
    """The arguments of the command that stands before them: shapes of the run's mission, values of
    its law."""
    from swarm_ctl.commands.parse import complete

    before = " ".join([ctx.params.get("command") or "", *_words(ctx.params.get("arguments"))])
    line = f"{before} {incomplete}"
    return [
        word
        for plan in _plan(ctx)
        for found in complete(line, plan)
        if not (word := found.removeprefix(f"{before} ")).startswith("@")
    ]


def complete_agents(ctx: typer.Context, incomplete: str) -> list[str]:
    """The groups of the run's mission and the ids of its agents, also behind a comma."""
    from swarm_ctl.commands.parse import group_names

    before, comma, last = incomplete.rpartition(",")
    words = [f"@{name}" for plan in _plan(ctx) for name in group_names(plan)]
    words += [str(agent.id) for plan in _plan(ctx) for agent in plan.agents]
    named = before.split(",")
    return [
        f"{before}{comma}{word}" for word in words if word.startswith(last) and word not in named
    ]


def _words(given: Sequence[str] | str | None) -> Sequence[str]:
    return [given] if isinstance(given, str) else given or []


def _plan(ctx: typer.Context) -> Iterator[Plan]:
    """The plan of the run that is meant; none where there is no such run."""
    from swarm_ctl.engine.flying_runs import flying_run
    from swarm_ctl.runfolder.manifest import read_manifest

    try:
        yield read_manifest(flying_run(ctx.params.get("run"))).plan
    except SwarmError:
        return  # there is nothing to complete: the command itself will say what is wrong
