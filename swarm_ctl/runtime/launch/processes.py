"""The processes `run` starts, each behind the same few words: start, alive, exit code, let go,
kill.

Each holds a pipe to its child. Letting go closes it: the child takes that as its parent's end and
winds down by itself (an agent lands, the simulator waits until all stand, the station writes the
summary). So nothing outlives a killed run.
"""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import select
import subprocess
import sys
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from types import ModuleType
from typing import IO, Protocol

from swarm_ctl.errors import StartError
from swarm_ctl.runtime.agent import agent_process
from swarm_ctl.runtime.agent.agent_process import READY, AgentConfig
from swarm_ctl.runtime.clock import pause, wall_s

_LOG_LINES = 5
_POLL_S = 0.02


class Child(Protocol):
    """One process that `run` answers for."""

    name: str

    @property
    def pid(self) -> int:
        """Its process id."""

    def poll_ready(self) -> bool:
        """True once it has said that it works; StartError when it has said why not, or died."""

    def exit_code(self) -> int | None:
        """None while it runs; negative: the signal that ended it."""

    def let_go(self) -> None:
        """Close its lifeline."""

    def kill(self) -> None:
        """End it at once (SIGKILL) and take its exit code; nothing happens if it has ended."""


@contextlib.contextmanager
def _without_main() -> Iterator[None]:
    """Keep multiprocessing from importing our command line (typer, scipy) into every agent as
    `__mp_main__`."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


class AgentChild:
    """An agent, forked from a server that has imported everything already (32 in 0.2 s instead of
    2.7 s)."""

    def __init__(self, config: AgentConfig) -> None:
        self.name = f"agent-{config.agent_id}"
        self.config = config
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["swarm_ctl.runtime.agent.preload"])
        self._lifeline, theirs = context.Pipe()
        self._process = context.Process(
            target=agent_process.child_main, args=(config, theirs), name=self.name, daemon=False
        )
        with _without_main():
            self._process.start()
        theirs.close()
        self._ready = False
        self._heard_wall_s = wall_s()

    @property
    def pid(self) -> int:
        """As `Child.pid`."""
        return self._process.pid or 0

    def silent_wall_s(self) -> float:
        """Seconds since it last said that it is alive (it does with every status)."""
        while _has_data(self._lifeline):
            try:
                self._lifeline.recv()
            except (EOFError, OSError):
                break  # it has closed its end: its exit code will tell
            self._heard_wall_s = wall_s()
        return wall_s() - self._heard_wall_s

    def poll_ready(self) -> bool:
        """As `Child.poll_ready`."""
        if not self._ready and _has_data(self._lifeline):
            word = self._lifeline.recv()
            if word != READY:
                raise StartError(f"{self.name} did not start: {word}")
            self._ready = True
        elif not self._ready and self.exit_code() is not None:
            raise StartError(
                f"{self.name} died while starting, exit code {self.exit_code()}{_tail(self.config.log)}"
            )
        return self._ready

    def exit_code(self) -> int | None:
        """As `Child.exit_code`."""
        return self._process.exitcode

    def let_go(self) -> None:
        """As `Child.let_go`."""
        self._lifeline.close()

    def kill(self) -> None:
        """As `Child.kill`."""
        if self._process.exitcode is None:
            self._process.kill()
        self._process.join()
        self._lifeline.close()


def _has_data(connection: Connection) -> bool:
    try:
        return not connection.closed and connection.poll()
    except OSError:
        return False


class CommandChild:
    """A process started by its command line; stdin is its lifeline and takes JSON lines, `words` is
    what it says."""

    def __init__(
        self, name: str, command: list[str], log: Path, *, own_terminal: bool = False
    ) -> None:
        self.name = name
        self._log = log
        self._ready = False
        self._heard = b""
        read, write = os.pipe()
        with log.open("ab") as errors:
            # the simulator speaks on its stdout; the station's is the terminal, so it gets a
            # descriptor of its own
            self._process = subprocess.Popen(
                [*command, "--words-fd", str(write)] if own_terminal else command,
                stdin=subprocess.PIPE,
                stdout=None if own_terminal else write,
                stderr=errors,
                pass_fds=(write,) if own_terminal else (),
            )
        os.close(write)
        self._words = read

    @property
    def pid(self) -> int:
        """As `Child.pid`."""
        return self._process.pid

    def poll_ready(self) -> bool:
        """As `Child.poll_ready`: ready with its first whole line."""
        if not self._ready:
            if select.select([self._words], [], [], 0)[0]:
                self._heard += os.read(self._words, 65536)
            self._ready = b"\n" in self._heard
        if not self._ready and self.exit_code() is not None:
            raise StartError(
                f"the {self.name} did not start, exit code {self.exit_code()}{_tail(self._log)}"
            )
        return self._ready

    def exit_code(self) -> int | None:
        """As `Child.exit_code`."""
        return self._process.poll()

    def say(self, **message: object) -> bool:
        """Send one JSON line; False when nobody listens any more."""
        pipe: IO[bytes] | None = self._process.stdin
        try:
            if pipe is None or pipe.closed:
                return False
            pipe.write(json.dumps(message).encode() + b"\n")
            pipe.flush()
        except OSError:
            return False
        return True

    def let_go(self) -> None:
        """As `Child.let_go`."""
        if self._process.stdin is not None and not self._process.stdin.closed:
            with contextlib.suppress(
                BrokenPipeError
            ):  # it is gone already: that is what we wanted to tell it
                self._process.stdin.close()

    def kill(self) -> None:
        """As `Child.kill`."""
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        self.let_go()
        if self._words >= 0:
            os.close(self._words)
            self._words = -1


def simulator(config: Path, log: Path) -> CommandChild:
    """The simulator, by its command line."""
    return CommandChild("simulator", [sys.executable, "-m", "sim", "--config", str(config)], log)


def station(folder: Path, log: Path, show: str, metrics_port: int | None = None) -> CommandChild:
    """The ground station of a run; it has the terminal."""
    command = [
        sys.executable,
        "-m",
        "swarm_ctl.runtime.station.station_process",
        "--run",
        str(folder),
    ]
    metrics = [] if metrics_port is None else ["--metrics", str(metrics_port)]
    return CommandChild("station", [*command, "--show", show, *metrics], log, own_terminal=True)


def wait_all(children: list[Child], wall_seconds: float) -> list[Child]:
    """Wait until all have ended, at most so long; returns those that still run."""
    until = wall_s() + wall_seconds
    running = [child for child in children if child.exit_code() is None]
    while running and wall_s() < until:
        pause(_POLL_S)
        running = [child for child in running if child.exit_code() is None]
    return running


def _tail(log: Path | None) -> str:
    """The last lines of a log, for an error message."""
    if log is None or not log.exists():
        return ""
    lines = log.read_text(errors="replace").strip().splitlines()[-_LOG_LINES:]
    return ":\n  " + "\n  ".join(lines) if lines else ""
