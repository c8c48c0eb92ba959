"""`swarm-ctl evidence`: the claims of the safety and security pages, flown again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import alone_in, option, require_writable, switch
from swarm_ctl.errors import InputError
from swarm_ctl.installed import require

if TYPE_CHECKING:
    from swarm_ctl.evidence.claims import ClaimRow


def evidence(
    listed: Annotated[bool, switch("--list", "Show the rows, and fly none.")] = False,
    row: Annotated[
        list[str] | None, option("NAME", "Fly this row; repeat it for another.", "--row")
    ] = None,
    quick: Annotated[bool, switch("--quick", "Fly what two cores fly in 15 minutes.")] = False,
    every: Annotated[bool, switch("--all", "Fly all but what is marked `by hand`: hours.")] = False,
    out: Annotated[
        Path, option("FOLDER", "Page, JSON, journal, logs; the same command goes on from there.")
    ] = Path("evidence"),
) -> None:
    """Fly the claims of the safety pages again.

    Each row is a claim, the command that shows it, and what was found when it was flown here: the
    figure, its exact bound, seed, commit, limits. The page also has what an assessor by SORA 2.5
    asks for, and what is not covered. It needs a checkout, installed with `.[dev]`.

    The exit code is 0 where all that was flown holds, 1 where a figure moved or a row failed.

    Examples:

    \b
        swarm-ctl evidence --list
        swarm-ctl evidence --quick
        swarm-ctl evidence --row mix --row fuzz
        swarm-ctl evidence --all --out evidence-all
    """
    from swarm_ctl.evidence.claims import FlownWith, read_claims

    claims = read_claims()
    if listed:
        if quick or every or row:
            raise InputError("--list flies none; allowed: that alone")
        _list(claims.rows)
        return
    if not (quick or every or row):
        raise InputError("nothing to fly; allowed: --quick, --all, --row NAME, or --list")
    require("study", "swarm-ctl evidence")
    require("ground", "swarm-ctl evidence")
    require_writable(out, "choose with --out")
    from swarm_ctl.evidence.flown import FAILED, HOLDS, MOVED, Evidence, wanted
    from swarm_ctl.evidence.page import counted, told, write_evidence

    console = PlainConsole()
    chosen = wanted(
        claims.rows, FlownWith.ALL if every else FlownWith.QUICK if quick else None, row or ()
    )
    flown, states = set[str](), set[str]()
    with alone_in(out):
        made = Evidence(out)
        try:
            for each, again in made.fly(chosen):
                write_evidence(made, claims)  # all of it takes hours: what there is can be read
                if again is None:
                    flown.add(each.name)
                    console.say(f"{each.name}: {each.command}", style="dim")
                    continue
                states.add(again.state)
                colour = {HOLDS: "green", MOVED: "red", FAILED: "red"}.get(again.state, "yellow")
                when = f"{again.took_s:.0f} s" if each.name in flown else f"flown {again.at}"
                words = filter(None, [f"{each.name}: {again.state}, {when}", told(again)])
                console.say(": ".join(words), style=colour)
        except (KeyboardInterrupt, SystemExit):
            console.say(f"{out}: {counted(made, claims)}; the same command goes on from here")
            raise
        finally:
            page = write_evidence(made, claims)
        console.say(f"{counted(made, claims)}\npage: {page}")
    raise typer.Exit(int(bool(states & {MOVED, FAILED})))


def _list(rows: tuple[ClaimRow, ...]) -> None:
    from rich.table import Table

    table = Table("row", "method", "flown", "claim")
    for row in rows:
        table.add_row(row.name, row.method, row.flown, row.claim)
    PlainConsole().print(table)
