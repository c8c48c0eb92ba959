"""The `swarm-ctl` command: one module a subcommand, one place for errors."""

from __future__ import annotations

import io
import itertools
import os
import sys
from collections.abc import Callable
from typing import Annotated, Any, Final

import typer
from typer.core import TyperCommand

from swarm_ctl.cli.checks.doctor import doctor
from swarm_ctl.cli.checks.measure import measure
from swarm_ctl.cli.flight.agent import agent
from swarm_ctl.cli.flight.keys import keys
from swarm_ctl.cli.flight.link import link
from swarm_ctl.cli.flight.router import router
from swarm_ctl.cli.flight.run import run
from swarm_ctl.cli.flight.send import send
from swarm_ctl.cli.flight.sim import sim
from swarm_ctl.cli.flight.station import station
from swarm_ctl.cli.flight.target import target
from swarm_ctl.cli.hosts.deploy import deploy
from swarm_ctl.cli.hosts.hosts import hosts
from swarm_ctl.cli.hosts.on_host import on_host
from swarm_ctl.cli.missions.missions import missions, plan, schema, validate
from swarm_ctl.cli.missions.zones import zones
from swarm_ctl.cli.results.report import compare, replay, report
from swarm_ctl.cli.security.trust import trust
from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import filled
from swarm_ctl.cli.studies.evidence import evidence
from swarm_ctl.cli.studies.fuzz import fuzz
from swarm_ctl.cli.studies.law import law
from swarm_ctl.cli.studies.study import options_of_study, paper, study
from swarm_ctl.engine.system import FLYING, GROUND_ALONE, lacks, refuse_without
from swarm_ctl.errors import InputError, SwarmError
from swarm_ctl.installed import commit, require, version

app = typer.Typer(
    name="swarm-ctl",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # markup would swallow what stands in square brackets
    context_settings={"help_option_names": ["-h", "--help"]},
)


_COMMANDS: Final[dict[str, tuple[Callable[..., None], ...]]] = {
    "ground": (run, validate, plan, station, send, replay, report, compare, fuzz),
    "": (agent, link, router, target, sim, measure, doctor, schema, keys),
    "study": (study, paper, evidence),
}
"""The commands that need an extra, or only the core."""


class _Command(TyperCommand):
    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Some options may stand without their value."""
        return super().parse_args(ctx, filled(args))

    def invoke(self, ctx: Any) -> Any:
        """Refuse to start where the system can't fly, or the command's extra is not installed."""
        if self.name in FLYING:
            refuse_without(lacks(), f"swarm-ctl {self.name}", GROUND_ALONE)
        for extra, functions in _COMMANDS.items():
            if extra and str(self.name) in (function.__name__ for function in functions):
                require(extra, f"swarm-ctl {self.name}")
        return super().invoke(ctx)


class _StudyCommand(_Command):
    """Its options are the fields of a study's file, read when they are asked for."""

    _whole = False

    @property
    def params(self) -> list[Any]:
        """With those of the fields."""
        if not self._whole:
            self._whole = True
            self._params[1:1] = options_of_study()
        return self._params

    @params.setter
    def params(self, params: list[Any]) -> None:
        self._params = params


for function in itertools.chain(*_COMMANDS.values()):
    # `send move -20 35`: a number, not an option
    settings = {"ignore_unknown_options": function is send}
    kind = _StudyCommand if function is study else _Command
    app.command(cls=kind, context_settings=settings)(function)
app.command(cls=_Command)(deploy)
app.add_typer(hosts)
app.add_typer(on_host)
app.add_typer(missions)
app.add_typer(zones)
app.add_typer(law)
app.add_typer(trust)


def _show_version(wanted: bool) -> None:
    if wanted:
        built_of = f" (commit {known})" if (known := commit()) else ""
        sys.stdout.write(f"swarm-ctl {version()}{built_of}\n")
        raise typer.Exit


@app.callback()
def top(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            help="Show version and commit, and exit.",
            is_eager=True,
            callback=_show_version,
        ),
    ] = False,
) -> None:
    """Fly a formation of drones from one terminal.

    Try: swarm-ctl run hexagon
    """


def main() -> None:
    """Run the command line. An error of ours or of the system is one message and an exit code,
    without a traceback."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a file's name need not be text
    try:
        _refuse_bytes(sys.argv[1:])
        app(prog_name="swarm-ctl")
    except SwarmError as error:
        _fail(str(error), error.exit_code)
    except BrokenPipeError:
        # The reader of our output is gone: no more output, no traceback about it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(141)  # as a shell reports SIGPIPE
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _fail(f"{where}{error.strerror or error}", 3)


def _refuse_bytes(words: list[str]) -> None:
    """InputError where the command line is no text: paths go into JSON files and onto screens."""
    for word in words:
        try:
            word.encode()
        except UnicodeEncodeError:
            shown = word.encode(errors="backslashreplace").decode()
            raise InputError(f"{shown}: is not UTF-8; allowed: names in UTF-8") from None


def _fail(text: str, exit_code: int) -> None:
    PlainConsole(stderr=True).say(f"error: {text}", style="red")
    sys.exit(exit_code)
