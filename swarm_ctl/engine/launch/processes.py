"""The processes that `run` starts by a command line, each behind the same few methods.

Each holds a pipe to its child, the lifeline. Letting go closes it: the child takes that as its
parent's end and winds down by itself (an agent lands, the simulator waits until all vehicles stand,
the station writes the summary). So nothing outlives a killed run.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from multiprocessing import Pipe
from pathlib import Path
from typing import Final

from swarm_ctl.engine.clock import pause, wall_s
from swarm_ctl.engine.lifeline import ALIVE, READY, ChildWords
from swarm_ctl.engine.vehicles.autopilots import remove_leftovers
from swarm_ctl.engine.vehicles.order import STARTED, STARTED_JSON, Started
from swarm_ctl.errors import StartError
from swarm_ctl.signals import deaf_children

_LOG_LINES: Final = 5
_POLL_WALL_S: Final = 0.02
_ASKED_WALL_S: Final = 5.0
"""For autopilots to end when they are asked to."""
_POLL_READY_WALL_S: Final = 0.01


class Child(ABC):
    """One process that `run` answers for; `log` has its last words. It says `READY` first, or why
    it does not start; `end` is what its own end means to the operator."""

    pid: int
    _words: ChildWords

    def __init__(self, name: str, log: Path | None, end: str = "") -> None:
        self.name = name
        self._log = log
        self._end = end
        self.ready = False
        """It has said that it works."""

    def poll_ready(self) -> bool:
        """True once it has said that it works; StartError when it has said why not, or died."""
        if not self.ready:
            word = self._words.next()
            self.ready = word == READY
            if word is not None and not self.ready:
                raise StartError(f"{self.title} did not start: {word}")
        if not self.ready and self.exit_code() is not None:
            raise StartError(
                f"{self.title} did not start, exit code {self.exit_code()}{_tail(self._log)}"
            )
        return self.ready

    @property
    def title(self) -> str:
        """What an operator calls it."""
        return f"the {self.name}"

    def words(self) -> list[str]:
        """What it has said since the last call."""
        found = []
        while (word := self._words.next()) is not None:
            found.append(word)
        return found

    def notes(self) -> list[str]:
        """What it has said for the operator since the last call; its end, too."""
        notes = [word for word in self.words() if word not in (READY, ALIVE)]
        if self._end and self.exit_code() is not None:
            notes.append(f"{self._end}; exit code {self.exit_code()}, see {self.name}.log")
            self._end = ""
        return notes

    @abstractmethod
    def exit_code(self) -> int | None:
        """None while it runs; negative: the signal that ended it."""

    @abstractmethod
    def let_go(self) -> None:
        """Close its lifeline."""

    @abstractmethod
    def kill(self) -> None:
        """End it at once (SIGKILL) and take its exit code; nothing happens if it has ended."""


class CommandChild(Child):
    """A process started by its command line. Its stdin is the lifeline and takes JSON lines."""

    def __init__(
        self,
        name: str,
        command: list[str],
        log: Path,
        end: str = "",
        *,
        own_terminal: bool = False,
        spoken: Callable[[str], str] = str,
    ) -> None:
        super().__init__(name, log, end)
        self._heard, told = Pipe(duplex=False)
        # It speaks on its stdout; the station's stdout is the terminal, so it speaks on a
        # descriptor of its own.
        says = told.fileno()
        with log.open("ab") as errors, deaf_children(), told:
            self._process = subprocess.Popen(
                [*command, str(says)] if own_terminal else command,
                stdin=subprocess.PIPE,
                stdout=None if own_terminal else says,
                stderr=errors,
                pass_fds=(says,) if own_terminal else (),
            )
        self.pid = self._process.pid
        self._words = ChildWords(self._heard, spoken)

    def exit_code(self) -> int | None:
        return self._process.poll()

    def say(self, **message: object) -> bool:
        """Send one JSON line; False where the process does not listen any more."""
        pipe = self._process.stdin
        try:
            if pipe is None or pipe.closed:
                return False
            pipe.write(json.dumps(message).encode() + b"\n")
            pipe.flush()
        except OSError:
            return False
        return True

    def let_go(self) -> None:
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):  # it has gone already
                self._process.stdin.close()

    def kill(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        self.let_go()
        self._heard.close()


class VehiclesChild(CommandChild):
    """The process that starts autopilots. It is asked to end before it is killed, so that it can
    remove what they leave outside the run's folder."""

    def __init__(self, folder: Path, log: Path) -> None:
        super().__init__("vehicles", _ours("vehicles.vehicles_process", folder), log)
        self._started = folder / STARTED

    def started(self) -> tuple[Started, ...]:
        """The autopilots; none before they are started."""
        if not self._started.exists():
            return ()
        return STARTED_JSON.validate_json(self._started.read_bytes())

    def kill(self) -> None:
        if self._process.poll() is None:
            self._process.terminate()
            wait_all([self], _ASKED_WALL_S)
        super().kill()
        for each in self.started():
            remove_leftovers(each.kind, each.instance)


def _ours(module: str, folder: Path) -> list[str]:
    """A process of ours is told a folder, and reads the rest there."""
    return [sys.executable, "-m", f"swarm_ctl.engine.{module}", str(folder)]


def relay(folder: Path) -> CommandChild:
    """The process that serves ground control software."""
    end = "ground control software is not served any more"
    return CommandChild("gcs", _ours("gcs.gcs_process", folder), folder / "gcs.log", end)


def keeper(folder: Path) -> CommandChild:
    """The keeper of mission time of a run in lockstep."""
    command = _ours("lockstep.keeper_process", folder)
    end = "lockstep has ended, on by the wall clock"
    return CommandChild("clock", command, folder / "clock.log", end)


def simulator(config: Path, log: Path) -> CommandChild:
    """The simulator, by its command line."""
    command = [sys.executable, "-m", "swarm_sim", "--config", str(config)]
    gone = "the simulated vehicles are gone"
    return CommandChild("simulator", command, log, gone, spoken=_of_simulator)


def _of_simulator(line: str) -> str:
    """The simulator is a program of its own: it speaks JSON."""
    try:
        message = json.loads(line)
    except ValueError:
        return line
    return READY if message.get("ready") else str(message.get("note"))


def station(folder: Path) -> CommandChild:
    """The ground station of a run; it has the terminal."""
    command = _ours("station.station_process", folder)
    return CommandChild("station", command, folder / "station.log", own_terminal=True)


def wait_ready(
    children: Sequence[Child], wall_seconds: float, stop: Callable[[], bool] = lambda: False
) -> list[Child]:
    """Wait until all are ready, until no other one has become so for so long, or until `stop`; the
    others.

    A slow machine starts a hundred processes one after the other.
    """
    until, waiting = wall_s() + wall_seconds, list(children)
    while wall_s() < until and not stop():
        before, waiting = len(waiting), [child for child in waiting if not child.poll_ready()]
        if not waiting:
            break
        if len(waiting) < before:
            until = wall_s() + wall_seconds
        pause(_POLL_READY_WALL_S)
    return waiting


def wait_all(children: Sequence[Child], wall_seconds: float) -> None:
    """Wait until all have ended, at most so long."""
    until = wall_s() + wall_seconds
    while wall_s() < until and any(child.exit_code() is None for child in children):
        pause(_POLL_WALL_S)


def _tail(log: Path | None) -> str:
    """The last lines of a log, for an error message."""
    if log is None or not log.exists():
        return ""
    lines = log.read_text(errors="replace").strip().splitlines()[-_LOG_LINES:]
    return ":\n  " + "\n  ".join(lines) if lines else ""
