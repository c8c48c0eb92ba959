"""Ask a host over SSH, with OpenSSH's own client: keys, aliases and jump hosts are as in
~/.ssh/config. What travels goes through stdin and stdout, never through arguments."""

from __future__ import annotations

import shlex
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

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
class Answer:
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

    def ask(self, host: str, words: Sequence[str], within_s: float, data: bytes = b"") -> Answer:
        """Run `swarm-ctl on-host WORDS` there with `data` as its input, at most `within_s`.

        Raises:
            StartError: there is no ssh on this computer.
        """
        try:
            done = subprocess.run(
                self.line(host, words),
                input=data,
                capture_output=True,
                timeout=within_s,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return Answer(Reach.OFFLINE, words=f"no answer for {within_s:g} s")
        except FileNotFoundError:
            raise StartError("ssh: is not installed; allowed: OpenSSH's client") from None
        said = done.stderr.decode(errors="replace").strip().split("\n")[-1].strip()
        return Answer(_reach(done.returncode, said), done.stdout, said)


def _reach(code: int, said: str) -> Reach:
    if code == _LOST:
        return Reach.REFUSED if any(each in said for each in _REFUSALS) else Reach.OFFLINE
    known = {0: Reach.ANSWERED, _MISSING: Reach.MISSING}
    return known.get(code, Reach.FAILED)
