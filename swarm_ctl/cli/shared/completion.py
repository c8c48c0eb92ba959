"""What the shell completes at tab (`swarm-ctl --install-completion`). A word that lands, returns or
kills is typed whole."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import typer

from swarm_ctl.core.model.plan import Plan
from swarm_ctl.errors import SwarmError


def orders(incomplete: str) -> list[tuple[str, str]]:
    """The commands of `send`, and what they do."""
    from swarm_ctl.commands.parse import KINDS

    harmless = [kind for kind in KINDS if not kind.asks[0]]
    return [(kind.name, kind.does) for kind in harmless if kind.name.startswith(incomplete)]


def words(ctx: typer.Context, incomplete: str) -> list[str]:
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


def agents(ctx: typer.Context, incomplete: str) -> list[str]:
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
