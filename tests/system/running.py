"""`swarm-ctl` as a user starts it: a process of its own, watched through its run folder, nothing
left behind."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from swarm_ctl.recording import IndexedRecording
from swarm_ctl.runfolder.manifest import read_manifest
from swarm_ctl.station.picture.playback import Film

ROOT = Path(__file__).parents[2]
HEXAGON = ROOT / "missions" / "hexagon.yaml"
LOW = Path(__file__).with_name("low.yaml")
HELD = Path(__file__).with_name("held.yaml")
"""LOW, for flights that are broken off: it holds until then."""
SWARM_CTL = Path(sys.executable).parent / "swarm-ctl"


class Running:
    """One command in a session of its own, so that every process it starts can be found by its
    session id."""

    def __init__(
        self,
        *arguments: str | Path,
        cwd: Path,
        env: dict[str, str] | None = None,
        stderr: bool = False,
    ) -> None:
        """`stderr`: kept apart from stdout, as `errors`."""
        self.cwd = cwd
        count = len(list(cwd.glob("output-*")))
        self._output, self._errors = cwd / f"output-{count}.txt", cwd / f"errors-{count}.txt"
        with self._output.open("wb") as output, self._errors.open("wb") as errors:
            self.process = subprocess.Popen(
                [str(SWARM_CTL), *map(str, arguments)],
                cwd=cwd,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=errors if stderr else subprocess.STDOUT,
                start_new_session=True,
                env=os.environ | (env or {}),
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for pid in self.alive():
            with contextlib.suppress(ProcessLookupError):  # it has ended meanwhile
                os.kill(pid, signal.SIGKILL)
        self.process.wait()

    @property
    def output(self) -> str:
        return self._output.read_text(errors="replace")

    @property
    def errors(self) -> str:
        return self._errors.read_text(errors="replace")

    @property
    def folder(self) -> Path:
        """The run folder (the only one under cwd/runs)."""
        (folder,) = (self.cwd / "runs").iterdir()
        return folder

    @property
    def pids(self) -> dict[str, int]:
        """By process name."""
        found: dict[str, int] = json.loads((self.folder / "processes.json").read_text())
        return found

    def kill(self, name: str, number: signal.Signals = signal.SIGKILL) -> None:
        """A process of the run, once `run` has told of all."""
        self.wait_for((self.folder / "processes.json").exists)
        os.kill(self.pids[name], number)

    def interrupt(self) -> None:
        """Ctrl-C as a terminal sends it: to the whole foreground group."""
        os.killpg(self.process.pid, signal.SIGINT)

    def wait_for(self, condition: Callable[[], bool], seconds: float = 150.0) -> None:
        """Poll until the condition holds; AssertionError with the output when the command ended or
        took too long."""
        until = time.monotonic() + seconds
        while not condition():
            assert self.process.poll() is None, (
                f"ended with {self.process.returncode}:\n{self.output}"
            )
            assert time.monotonic() < until, f"not reached in {seconds} s:\n{self.output}"
            time.sleep(0.05)

    def wait_for_event(self, text: str, count: int = 1) -> None:
        """Wait until `count` events on the mesh have said `text`."""
        self.wait_for(lambda: self._events().count(text) >= count)

    def _events(self) -> str:
        try:
            return (self.folder / "events.jsonl").read_text()
        except (OSError, ValueError):
            return ""

    def wait(self, seconds: float = 240.0) -> int:
        """The exit code."""
        try:
            return self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"hangs:\n{self.output}\nalive: {self.alive()}") from None

    def summary(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads((self.folder / "summary.json").read_text())
        return found

    def alive(self) -> list[int]:
        """Every process of the command's session that still runs (zombies don't)."""
        found = []
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                fields = stat.read_text().rpartition(")")[2].split()
            except OSError:
                continue
            state, session = fields[0], int(fields[3])
            if session == self.process.pid and state != "Z":
                found.append(int(stat.parent.name))
        return found

    def assert_nothing_left(self, seconds: float = 30.0) -> None:
        """All processes are gone within a moment (multiprocessing's helpers end just after their
        parent)."""
        until = time.monotonic() + seconds
        while self.alive() and time.monotonic() < until:
            time.sleep(0.05)
        left = {
            pid: Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ") for pid in self.alive()
        }
        assert not left, left


def raised(folder: Path) -> list[tuple[str, tuple[int, ...]]]:
    """(name, agents) of the alarms of the recorded flight, in their order."""
    manifest = read_manifest(folder)
    found = dict[tuple[str, tuple[int, ...]], None]()
    with IndexedRecording(folder) as recording:
        film = Film(recording, manifest.plan, speedup=manifest.speedup)
        for look in range(int((film.end_s - film.start_s) / film.look_s) + 1):
            film.seek(film.start_s + look * film.look_s)
            found |= dict.fromkeys(alarm.key for alarm in film.journal.standing)
    return list(found)
