"""`swarm-ctl run` in a real terminal (a pty): log lines, Ctrl-C as a key, a closed
output."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import pty
import signal
import struct
import subprocess
import termios
import time
from pathlib import Path

import pytest

from tests.system.running import HELD, LOW, SWARM_CTL
from tests.system.test_run import assert_truth_ends_on_the_ground

pytestmark = [pytest.mark.lockstep, pytest.mark.timeout(300)]

QUICK = ("--speedup", "max", "--headless", "--no-report")


class Terminal:
    """A command with a pty of 80x24 as its controlling terminal; what it writes is collected."""

    def __init__(self, *arguments: str | Path, cwd: Path) -> None:
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))

        def take_terminal() -> None:
            fcntl.ioctl(slave, termios.TIOCSCTTY, 0)

        self.process = subprocess.Popen(
            [str(SWARM_CTL), *map(str, arguments)],
            cwd=cwd,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            start_new_session=True,
            preexec_fn=take_terminal,
            env=os.environ | {"TERM": "xterm-256color"},
        )
        os.close(slave)
        os.set_blocking(self._master, False)
        self.text = ""

    def read(self) -> str:
        """Everything written so far."""
        while True:
            try:
                data = os.read(self._master, 65536)
            except BlockingIOError:
                break
            except OSError as error:
                if error.errno == errno.EIO:  # the other side is closed
                    break
                raise
            if not data:
                break
            self.text += data.decode(errors="replace")
        return self.text

    def press(self, keys: bytes) -> None:
        os.write(self._master, keys)

    def wait_for(self, text: str, seconds: float = 60.0) -> None:
        until = time.monotonic() + seconds
        while text not in self.read():
            assert time.monotonic() < until, self.text[-3000:]
            assert self.process.poll() is None, self.text[-3000:]
            time.sleep(0.05)

    def wait(self, seconds: float = 60.0) -> int:
        """The exit code; goes on reading, or the command would wait for us."""
        until = time.monotonic() + seconds
        while self.process.poll() is None:
            self.read()
            assert time.monotonic() < until, self.text[-3000:]
            time.sleep(0.05)
        self.read()
        return self.process.returncode

    def close(self) -> None:
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
        os.close(self._master)


def test_log_lines_and_ctrl_c(tmp_path: Path) -> None:
    """The lines tell the flight; Ctrl-C as a key lands the swarm, and a line tells who
    acknowledged."""
    terminal = Terminal("run", HELD, *QUICK, cwd=tmp_path)
    try:
        terminal.wait_for("step 2/4: form hexagon")
        terminal.press(b"\x03")
        terminal.wait_for("command land: acknowledged by agents 1-3")
        assert terminal.wait() == 130
        assert "ABORTED" in terminal.text
    finally:
        terminal.close()
    (folder,) = (tmp_path / "runs").iterdir()
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["outcome"] == "aborted"
    assert set(summary["exit_codes"].values()) == {0}
    assert_truth_ends_on_the_ground(folder)


def test_a_closed_output_does_not_end_the_flight(tmp_path: Path) -> None:
    """`swarm-ctl run ... | head -1`: the reader goes away in flight, the mission goes on to its
    end."""
    read, write = os.pipe()
    process = subprocess.Popen(
        [str(SWARM_CTL), "run", str(LOW), *QUICK],
        cwd=tmp_path,
        stdout=write,
        stderr=subprocess.DEVNULL,
        stdin=subprocess.DEVNULL,
    )
    os.close(write)
    try:
        said = b""
        while b"starting" not in said:
            said += os.read(read, 100)
        os.close(read)
        assert process.wait(240) == 0
        (folder,) = (tmp_path / "runs").iterdir()
        assert '"outcome": "completed"' in (folder / "summary.json").read_text()
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
