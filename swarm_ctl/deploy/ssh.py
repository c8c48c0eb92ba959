"""Ask a host over SSH, with OpenSSH's own client: keys, aliases and jump hosts are as in
~/.ssh/config. What travels goes through stdin and stdout, never through arguments.

A host may have been taken over: what it answers is read up to a bound, and no further.
"""

from __future__ import annotations

import io
import os
import selectors
import shlex
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import IO, Final

from swarm_ctl.core.model.text import printable
from swarm_ctl.engine.clock import wall_s
from swarm_ctl.errors import StartError

_CONNECT_S: Final = 10
_MISSING: Final = 127
"""A shell's exit code for a program that it does not find."""
_LOST: Final = 255
"""ssh's own."""
_FINDS: Final = (
    'PATH="$HOME/.local/bin:$HOME/.local/share/swarm-ctl/venv/bin:$PATH";'
    f' command -v "$0" >/dev/null || exit {_MISSING}; exec "$0" "$@"'
)
_REFUSALS: Final = ("Permission denied", "Host key verification failed", "Bad owner or permissions")
"""Of ssh's words: to wait does not help."""
_MOST_REPORT: Final = 1 << 20
"""Bytes of a host's report, or of its words."""
_CHUNK: Final = 1 << 16
_WORDS: Final = 1000


class Reach(StrEnum):
    """How far a call came."""

    ANSWERED = "answered"
    FAILED = "failed"
    """swarm-ctl of the host has refused, or failed."""
    MISSING = "missing"
    """No swarm-ctl in the PATH there."""
    REFUSED = "refused"
    """SSH does not let us in, or does not know the host."""
    OFFLINE = "offline"


@dataclass(frozen=True, slots=True)
class SshResult:
    """What came of one call."""

    reach: Reach
    out: bytes = b""
    words: str = ""
    """What the host, or ssh, says of it: one line."""


@dataclass(frozen=True, slots=True)
class Ssh:
    """OpenSSH's client."""

    config: Path | None = None
    """Instead of ~/.ssh/config."""

    def line(self, host: str, words: Sequence[str]) -> list[str]:
        """The command line that runs `swarm-ctl on-host WORDS` there."""
        if host.startswith("-"):
            raise StartError(f"{host!r} is no host")  # the fleet refuses it already
        remote = shlex.join(["sh", "-c", _FINDS, "swarm-ctl", "on-host", *words])
        config = ["-F", str(self.config)] if self.config else []
        options = ("BatchMode=yes", f"ConnectTimeout={_CONNECT_S}", "ServerAliveInterval=5")
        pairs = [word for each in options for word in ("-o", each)]
        return ["ssh", *config, *pairs, "-T", "--", host, remote]

    def ask(
        self,
        host: str,
        words: Sequence[str],
        within_s: float,
        data: bytes = b"",
        out: IO[bytes] | None = None,
        most: int = _MOST_REPORT,
    ) -> SshResult:
        """Run `swarm-ctl on-host WORDS` there with `data` as its input, at most `within_s`. What it
        answers goes to `out`, if that is given; of more than `most` bytes, ssh is ended and the
        answer is FAILED.

        Raises:
            StartError: there is no ssh on this computer.
        """
        answered = io.BytesIO() if out is None else out
        with tempfile.TemporaryFile() as told:  # ssh reads it as it likes
            told.write(data)
            told.seek(0)
            try:
                process = subprocess.Popen(
                    self.line(host, words),
                    stdin=told,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    bufsize=0,
                )
            except FileNotFoundError:
                raise StartError("ssh: is not installed; allowed: OpenSSH's client") from None
            with process:
                try:
                    code, said = _read(process, answered, most, wall_s() + within_s)
                except TimeoutError:
                    return SshResult(Reach.OFFLINE, words=f"no answer for {within_s:g} s")
                except OverflowError:
                    text = f"answers more than {most / 1e6:g} MB; allowed: less"
                    return SshResult(Reach.FAILED, words=text)
                finally:
                    process.kill()
        last = printable(said.decode(errors="replace").strip().split("\n")[-1].strip(), _WORDS)
        whole = answered.getvalue() if isinstance(answered, io.BytesIO) else b""
        return SshResult(_reach(code, last), whole, last)


def _read(
    process: subprocess.Popen[bytes], out: IO[bytes], most: int, until_s: float
) -> tuple[int, bytes]:
    """What a process writes until it ends: its exit code, and the end of its error output.
    TimeoutError at `until_s` [s], OverflowError beyond `most` bytes to `out`."""
    said, written = b"", 0
    with selectors.DefaultSelector() as ready:
        for pipe in (process.stdout, process.stderr):
            ready.register(pipe or -1, selectors.EVENT_READ)
        while ready.get_map():
            left_s = until_s - wall_s()
            found = ready.select(left_s) if left_s > 0 else []
            if not found:
                raise TimeoutError
            for key, _ in found:
                data = os.read(key.fd, _CHUNK)
                if not data:
                    ready.unregister(key.fileobj)
                elif key.fileobj is process.stderr:
                    said = (said + data)[-_MOST_REPORT:]
                else:
                    written += len(data)
                    if written > most:
                        raise OverflowError
                    out.write(data)
    try:
        return process.wait(max(0.0, until_s - wall_s())), said
    except subprocess.TimeoutExpired:
        raise TimeoutError from None


def _reach(code: int, said: str) -> Reach:
    if code == _LOST:
        return Reach.REFUSED if any(each in said for each in _REFUSALS) else Reach.OFFLINE
    known = {0: Reach.ANSWERED, _MISSING: Reach.MISSING}
    return known.get(code, Reach.FAILED)
