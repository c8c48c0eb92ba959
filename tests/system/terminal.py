"""A real terminal (tmux) with one command in it: keys go in, the screen is read."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

import pytest

from tests.system.running import SWARM_CTL

needs_tmux = pytest.mark.skipif(
    shutil.which("tmux") is None, reason="tmux is not installed; it is the terminal here"
)


class Terminal:
    """`swarm-ctl` (or another program) with these arguments in a terminal of `size`; afterwards a
    shell that says DONE and its exit code."""

    def __init__(
        self,
        *arguments: str | Path,
        cwd: Path,
        size: tuple[int, int] = (100, 30),
        program: tuple[str, ...] = (str(SWARM_CTL),),
    ) -> None:
        self.cwd = cwd
        self._socket = cwd / f"tmux-{len(list(cwd.glob('tmux-*')))}"
        command = shlex.join([*program, *map(str, arguments)])
        modes = "stty -a | tr ' ' '\\n' | grep -x -e '-*isig;*' -e '-*echo;*'"
        script = f"trap : INT; {command}; echo DONE $?; {modes}; exec cat"
        self._tmux(
            "new-session",
            "-d",
            "-x",
            str(size[0]),
            "-y",
            str(size[1]),
            "-c",
            str(cwd),
            "sh",
            "-c",
            script,
        )

    def _tmux(self, *arguments: str) -> str:
        command = ["tmux", "-S", str(self._socket), "-f", os.devnull, *arguments]
        environment = {key: value for key, value in os.environ.items() if key != "TMUX"} | {
            "LC_ALL": "C.UTF-8"
        }
        return subprocess.run(
            command, check=True, capture_output=True, text=True, env=environment
        ).stdout

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for path in self.cwd.glob("runs/*/processes.json"):
            for pid in json.loads(path.read_text()).values():
                if Path(f"/proc/{pid}").exists() and str(path.parent.name) in _command_line(pid):
                    os.kill(pid, signal.SIGKILL)
        self._tmux("kill-server")

    def press(self, *keys: str) -> None:
        """Keys as tmux names them (`C-c`, `Tab`, `l`)."""
        self._tmux("send-keys", *keys)

    def screen(self) -> str:
        """What is on the terminal now."""
        return self._tmux("capture-pane", "-p")

    def wait_for(self, words: str | Callable[[str], bool], seconds: float = 60.0) -> str:
        """The screen, once it shows the words (or makes the condition true)."""
        until = time.monotonic() + seconds
        while True:
            shown = self.screen()
            if words(shown) if callable(words) else words in shown:
                return shown
            assert time.monotonic() < until, f"{words!r} not seen in {seconds} s:\n{shown}"
            time.sleep(0.1)

    def close(self) -> None:
        """As a user closes the window."""
        self._tmux("new-session", "-d", "sh")  # the server goes on
        self._tmux("kill-session", "-t", "0")

    def kill(self, name: str, number: signal.Signals = signal.SIGKILL) -> None:
        """End one process of the run, or `run` itself."""
        (path,) = self.cwd.glob("runs/*/processes.json")
        pids = json.loads(path.read_text())
        stat = Path(f"/proc/{pids['station']}/stat").read_text()
        pids["run"] = int(stat.rpartition(")")[2].split()[1])  # who started the station
        os.kill(pids[name], number)

    def modes(self) -> set[str]:
        """What `stty` says of the terminal: `isig` or `-isig`, and so on."""
        name = self._tmux("display-message", "-p", "#{pane_tty}").strip()
        command = ["stty", "-a", "-F", name]
        return set(
            subprocess.run(command, check=True, capture_output=True, text=True)
            .stdout.replace(";", " ")
            .split()
        )

    def wait_for_end(self, seconds: float = 90.0) -> tuple[int, str]:
        """The command's exit code, and the screen; the terminal is as it was before (AssertionError
        otherwise)."""
        shown = self.wait_for(
            lambda text: "DONE" in text and "isig" in text and "echo" in text.split("DONE")[1],
            seconds,
        )
        code, *modes = shown.split("DONE")[1].split()
        assert {mode.strip(";") for mode in modes} == {"isig", "echo"}, shown
        return int(code), shown


def _command_line(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return ""
