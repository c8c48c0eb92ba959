"""A program's flight, in a process of its own: `python -m swarm_ctl.engine.launch.flight_process
FOLDER` flies what the program has written there. Stdin is its lifeline: a word on it, or its end,
lands the swarm. So neither a signal to the program nor its crash ends the flight otherwise.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pydantic import TypeAdapter

from swarm_ctl.engine.launch.run_setup import RunOptions
from swarm_ctl.engine.system import GROUND_ALONE, lacks, refuse_without
from swarm_ctl.errors import SwarmError
from swarm_ctl.rim import explained
from swarm_ctl.signals import ended, ended_in_one_line

if TYPE_CHECKING:
    from swarm_ctl.engine.launch.supervisor import RunResult

_FLIGHT: Final = "flight.json"
_LOG: Final = "run.log"


@dataclass(frozen=True, slots=True)
class ProgramFlight:
    """What a program flies."""

    mission: str
    """The mission's text (`dumps`)."""
    named: str
    """What its file is called; beside that are the files which it names."""
    options: RunOptions
    vehicles: str | None = None
    """The kinds of the vehicles that the run starts; None: the fleet's."""
    report: bool = True
    """The report is made at the end."""


_FLIGHT_JSON: Final = TypeAdapter(ProgramFlight)


class FlightProcess:
    """The process of a flight, seen from its program.

    Args:
        folder: has what it is told, and its log.
        flight: to fly.
        apart: it has a process group of its own, which Ctrl-C in the terminal does not reach.
    """

    def __init__(self, folder: Path, flight: ProgramFlight, *, apart: bool) -> None:
        refuse_without(lacks(), "a flight with processes", GROUND_ALONE)
        self._log = folder / _LOG
        (folder / _FLIGHT).write_bytes(_FLIGHT_JSON.dump_json(flight, indent=1))
        theirs, self._lifeline = os.pipe()
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__, str(folder)],
                stdin=theirs,
                stdout=log,
                stderr=subprocess.STDOUT,
                process_group=0 if apart else None,
            )
        os.close(theirs)
        self.pid = self._process.pid

    @property
    def over(self) -> bool:
        """It has ended."""
        return self._process.poll() is not None

    def wait(self, wall_seconds: float) -> bool:
        """Until it has ended, at most so long; whether it has."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(wall_seconds)
        return self.over

    def land(self, why: str) -> None:
        """Land the swarm; `why` stands in the verdict."""
        with contextlib.suppress(OSError):  # it has ended meanwhile
            os.write(self._lifeline, why.encode())

    def interrupt(self) -> None:
        """As Ctrl-C does: the first one lands the swarm, a second one ends all processes."""
        if not self.over:
            self._process.send_signal(signal.SIGINT)

    def kill(self) -> None:
        """End it at once, if it is there still: its children notice through their pipes, and
        land."""
        if not self.over:
            self._process.kill()
            self._process.wait()
        if self._lifeline >= 0:
            os.close(self._lifeline)
            self._lifeline = -1

    def said(self, lines: int) -> str:
        """The last lines that it wrote."""
        return "\n".join(self._log.read_text(errors="replace").splitlines()[-lines:])


def main(folder: Path) -> int:
    """The process; its exit code: 0 when it has flown, whatever came of it, else as of `run`."""
    from swarm_ctl.engine.launch.supervisor import fly
    from swarm_ctl.mission.compile.loader import loads

    try:
        flight = _FLIGHT_JSON.validate_json((folder / _FLIGHT).read_bytes())
        mission = loads(flight.mission, flight.named, vehicles=flight.vehicles)
        for warning in mission.warnings:
            _say(f"warning: {warning}")
        options = replace(flight.options, lifeline=0)  # its stdin
        result = fly(mission, options, _say, lambda *_: None)
    except SwarmError as error:
        _say(f"error: {error}")
        return error.exit_code
    if flight.report:
        _report(result)
    return 0


def _report(result: RunResult) -> None:
    """The result stands, whatever happens to the figures."""
    from swarm_ctl.report.page.html_page import make_report

    try:
        make_report(result.folder)
    except Exception as error:
        again = f"swarm-ctl report {result.folder} makes it"
        _say(f"no report: {explained(error)}; {again}")


def _say(text: str) -> None:
    with contextlib.suppress(OSError):  # a full disk
        print(text, flush=True)  # noqa: T201


if __name__ == "__main__":
    ended_in_one_line()
    code = main(Path(sys.argv[1]))
    ended()
    sys.exit(code)
