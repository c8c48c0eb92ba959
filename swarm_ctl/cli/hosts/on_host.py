"""`swarm-ctl on-host`: the host's side of `deploy`. It answers in JSON."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from swarm_ctl.cli.shared.options import option, switch
from swarm_ctl.errors import StartError

if TYPE_CHECKING:
    from swarm_ctl.deploy.host import Host

WITHIN: Final = 300.0
"""To land and end, by default [s]."""


def install(
    bundle: Annotated[Path, typer.Argument(metavar="BUNDLE", help="The file, or - for stdin.")],
) -> None:
    """Take in a bundle of this host.

    Agents that fly already go on with what they have.

    Example:

    \b
        swarm-ctl on-host install drone3.tar
    """
    from swarm_ctl.deploy.bundle import MOST_BYTES, read_bundle, unpacked

    host = _host()
    from_stdin = str(bundle) == "-"
    most = MOST_BYTES  # what is longer is torn
    host.install(unpacked(sys.stdin.buffer.read(most)) if from_stdin else read_bundle(bundle))
    _answer(host)


def start(
    bundle: Annotated[
        str, option("DIGEST", "Start only if the newest is this one.  [default: the newest]")
    ] = "",
) -> None:
    """Start what the newest bundle says and does not run yet.

    The vehicles fly when all agents of the swarm are there. The exit code is 3 where a process
    does not start; with --bundle, as deploy gives it, the answer alone says so.

    Example:

    \b
        swarm-ctl on-host start
    """
    host = _host()
    host.start(bundle)
    _answer(host)
    failed = [] if bundle else [f"{s.name}: {s.said}" for s in host.report().failed]
    if failed:
        raise StartError("; ".join(failed))


def stop(within: Annotated[float, option("SECONDS", "At most so long.", min=1.0)] = WITHIN) -> None:
    """Land this host's vehicles and end its agents and router.

    The router ends when all agents have ended.

    Example:

    \b
        swarm-ctl on-host stop
    """
    host = _host()
    host.stop(within)
    _answer(host)


def state() -> None:
    """Say what was deployed here, and how it stands.

    Example:

    \b
        swarm-ctl on-host state
    """
    _answer(_host())


def logs(
    every: Annotated[bool, switch("--all", "Of all flights, not only the newest.")] = False,
) -> None:
    """Write a tar of logs, tlogs and last statuses to stdout.

    Example:

    \b
        swarm-ctl on-host logs > drone3-logs.tar
    """
    _host().logs(sys.stdout.buffer, every=every)


def _host() -> Host:
    from swarm_ctl.deploy.host import Host

    return Host()


def _answer(host: Host) -> None:
    sys.stdout.write(host.report().model_dump_json(indent=1) + "\n")


on_host = typer.Typer(
    name="on-host",
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Take in, start and stop a bundle on this host.\n\n"
    "Try: swarm-ctl on-host install drone3.tar",
)
for function in (install, start, stop, state, logs):
    on_host.command()(function)
