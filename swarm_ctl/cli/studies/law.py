"""`swarm-ctl law`: the laws that are here, checked, added."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.errors import InputError
from swarm_ctl.files import replacing
from swarm_ctl.installed import require

law = typer.Typer(name="law", rich_markup_mode=None)
Name = Annotated[
    str, typer.Argument(metavar="NAME", help="A law; swarm-ctl law lists those that are here.")
]


@law.callback(invoke_without_command=True)
def listed(context: typer.Context) -> None:
    """List the laws that are here, check one, or add one of your own.

    Example:

    \b
        swarm-ctl law
        swarm-ctl law check orca
        swarm-ctl law add mean.py
        swarm-ctl study --law paper,orca,mean
    """
    if context.invoked_subcommand is not None:
        return
    from swarm_ctl.law_loader import found_laws, own_law

    console = PlainConsole()
    console.say("paper: the law of Mondal et al. (2017), which missions fly by default")
    for name in found_laws():
        try:
            found = own_law(name)
        except InputError as error:
            console.say(f"{name}: {error}", style="red")
            continue
        console.say(f"{name}: {found.about or 'it says nothing of itself'} ({found.where})")
        for each in found.parameters:
            span = f"{each.least:g} to {each.most:g}, default {each.value:g}"
            console.say(f"    {each.name}: {span}; {found.says[each.name]}")


@law.command()
def check(name: Name) -> None:
    """Check a law before it flies: what it gives, what it remembers, what it costs, small studies.

    The exit code is 0 where all checks hold, 1 where one fails, 2 where there is no such law.

    Example:

    \b
        swarm-ctl law check orca
        swarm-ctl law check mean && swarm-ctl run mean.yaml
    """
    require("study", "swarm-ctl law check")
    from swarm_ctl.engine.clock import wall_s
    from swarm_ctl.study.law_check import checked

    console, table, failed, count = PlainConsole(), Table("check", "", "found"), 0, 0
    for each in checked(name, wall_s):
        count += 1
        failed += each.good is False
        word = {True: "holds", False: "FAILS", None: "-"}[each.good]
        table.add_row(each.name, word, each.found, style="red" if each.good is False else None)
    console.print(table)
    console.say(f"law {name}: {count} checks, {failed} failed")
    raise typer.Exit(1 if failed else 0)


@law.command()
def add(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="NAME.py, the law of this name.")],
    replace: Annotated[
        bool, typer.Option("--replace", help="In place of yours of the same name.")
    ] = False,
) -> None:
    """Add a law of your own: its file is copied to where this user's laws are.

    From then on NAME is a law for missions (law.own), studies and checks. Each computer of a swarm
    needs the same file: an agent whose file differs does not start. A changed file is added again,
    with --replace.

    Example:

    \b
        swarm-ctl law add mean.py
        swarm-ctl law check mean
    """
    from swarm_ctl.law_loader import NAME, found_laws, law_in_file, laws_folder

    name, folder = file.stem, laws_folder()
    if file.suffix != ".py" or not NAME.fullmatch(name):
        raise InputError(f"{file}: is no name of a law; allowed: a-z, 0-9, _ and -, as in mean.py")
    target = folder / file.name
    taken = found_laws().get(name)
    if name == "paper" or (taken is not None and not (replace and taken == str(target))):
        more = "; or --replace" if taken == str(target) else ""
        where = taken or "the law of missions"
        raise InputError(f"law {name!r} is there already: {where}; allowed: another name{more}")
    try:
        found = law_in_file(file)
    except OSError as error:
        raise InputError(
            f"{file}: can't be read: {error.strerror}; allowed: a law's file"
        ) from None
    folder.mkdir(parents=True, exist_ok=True)
    with replacing(target) as to:
        to.write(file.read_bytes())
    PlainConsole(stderr=True).say(
        f"{target}: the law {found.pinned}; check it with swarm-ctl law check {name}"
    )
