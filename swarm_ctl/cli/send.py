"""`swarm-ctl send`: an operator's command to a swarm that flies."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.console import Console

from swarm_ctl.cli.station import newest_run
from swarm_ctl.core.agent.command_handler import KINDS
from swarm_ctl.core.model.messages import Ack
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.errors import InputError

_ARGUMENTS: Final = {"form": ("SHAPE",), "move": ("N", "E"), "tune": ("NAME=VALUE",)}
"""What a command needs behind its name; the others need nothing. `tune` takes several."""


def send(
    command: Annotated[str, typer.Argument(help=f"One of {', '.join(KINDS)}.")],
    arguments: Annotated[
        list[str] | None,
        typer.Argument(
            help="form: a SHAPE of the mission's file; move: metres N E of the origin; tune: values of the law."
        ),
    ] = None,
    run: Annotated[
        Path | None, typer.Option(help="The run folder; default: the newest in runs/.")
    ] = None,
    agents: Annotated[str, typer.Option(help="Only these, e.g. 2,5-7; default: all.")] = "",
    by: Annotated[
        bool, typer.Option("--by", help="move: by N E metres from where the formation is.")
    ] = False,
    speed: Annotated[
        float | None, typer.Option(help="move: m/s; default: half of what the vehicles may.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask before kill.")] = False,
) -> None:
    """Command a swarm that flies, and show each agent's answer.

    hold (stay), resume (the mission), next (step), form SHAPE, move N E, tune NAME=VALUE... (the
    law, of all agents at one time or of none: h, kappa, delta_a, delta_l; `tune plan` for the
    mission's own), land, return (home, one at a time), kill (motors off at once: the vehicles
    fall).

    Exit codes: 0 everybody accepted, 1 somebody refused or did not answer, 2 bad input, 3 nobody
    can be heard.

    Examples:

        swarm-ctl send hold

        swarm-ctl send form vee

        swarm-ctl send move -20 35.5 --speed 2

        swarm-ctl send tune h=0.04 kappa=15

        swarm-ctl send kill --agents 3
    """
    from swarm_ctl.commands.parse import Order
    from swarm_ctl.runtime.station.run_client import RunClient
    from swarm_ctl.station.picture.summaries import command_words

    given = arguments or []
    _check(command, given)
    meant = agents_of(agents)
    if command in _ARGUMENTS and meant:
        raise InputError(f"{command} is for the whole swarm; leave out --agents")
    folder = run if run is not None else newest_run(Path("runs"))
    console = Console(highlight=False)
    if command == "kill" and not yes:
        who = f"agent {agents}" if meant else "EVERY agent"
        typer.confirm(
            f"kill: the motors of {who} stop at once and the vehicle falls. Really?", abort=True
        )
    if command == "move":
        given = [str(_number(word)) for word in given] + ([] if speed is None else [str(speed)])
    with RunClient(folder) as client:
        answers = client.order(Order(command, tuple(given), meant, by))
    for words, ids in _said(answers.acks.values()).items():
        console.print(f"{agents_named(ids)}: {words}", soft_wrap=True)
    if answers.silent:
        console.print(f"{agents_named(answers.silent)}: no answer", style="bold red")
    if answers.accepted and answers.command.tuning is not None:
        console.print(f"all agents: {command_words(answers.command)}", soft_wrap=True)
    if answers.failed:
        console.print(f"nothing changes: {answers.failed}", style="bold red", soft_wrap=True)
    raise typer.Exit(0 if answers.accepted else 1)


def _said(acks: Iterable[Ack]) -> dict[str, list[int]]:
    """Who said what: one line for all that say the same, but for their own names."""
    found: dict[str, list[int]] = {}
    for ack in sorted(acks, key=lambda ack: ack.agent):
        reason = ack.reason.removeprefix(f"agent {ack.agent} ").removeprefix("is ")
        found.setdefault("accepted" if ack.accepted else f"refused: {reason}", []).append(ack.agent)
    return found


def _check(command: str, given: list[str]) -> None:
    if command not in KINDS:
        raise InputError(f"unknown command {command!r}; allowed: {', '.join(KINDS)}")
    needed = _ARGUMENTS.get(command, ())
    if len(given) != len(needed) and not (command == "tune" and given):
        what = f"{command} {' '.join(needed)}".strip()
        raise InputError(f"{command} with {len(given)} arguments; allowed: swarm-ctl send {what}")


def agents_of(text: str, option: str = "--agents") -> tuple[int, ...]:
    """The ids in `2,5-7`, in order; '' is none."""
    chosen: set[int] = set()
    for word in filter(None, map(str.strip, text.split(","))):
        first, _, last = word.partition("-")
        try:
            span = range(int(first), int(last or first) + 1)
        except ValueError:
            span = range(0)
        if not 0 < len(span) <= 65535:
            raise InputError(
                f"{option} {text!r}; allowed: ids and ranges with commas between them, such as 2,5-7"
            )
        chosen.update(span)
    return tuple(sorted(chosen))


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{text!r} is no number of metres") from None
