"""Companion computers: each an SSH server with a home of its own, on this machine's loopback or in
a network namespace, that can be switched off at any moment."""

from __future__ import annotations

import functools
import getpass
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
_SSHD = shutil.which("sshd", path=f"/usr/sbin:{os.environ.get('PATH', '')}")
_WAIT_S = 10.0

_CONFIG = """\
Port {port}
ListenAddress {address}
HostKey {keys}/host
AuthorizedKeysFile {keys}/user.pub
PidFile none
StrictModes no
UsePAM no
PermitRootLogin prohibit-password
PasswordAuthentication no
ForceCommand {home}/login
"""

_CLIENT = """\
Host {name}
    HostName {address}
    Port {port}
    User {user}
    IdentityFile {keys}/user
    IdentitiesOnly yes
    UserKnownHostsFile {keys}/known_hosts
    HostKeyAlias computers
    StrictHostKeyChecking yes
    ControlPath none
"""


@functools.cache
def why_not() -> str:
    """Why there are no computers here; '' where there are."""
    for program in (_SSHD, shutil.which("ssh"), shutil.which("ssh-keygen")):
        if program is None:
            return "needs sshd, ssh and ssh-keygen (OpenSSH)"
    if os.geteuid() == 0:
        Path("/run/sshd").mkdir(mode=0o755, exist_ok=True)
    return ""


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Computer:
    """One computer: `inside` is the beginning of a command line that runs the rest there."""

    def __init__(
        self, name: str, keys: Path, where: Path, address: str, port: int, inside: Sequence[str]
    ) -> None:
        self.name, self.home = name, where / name
        self._keys, self._address, self._port, self._inside = keys, address, port, inside
        self._process: subprocess.Popen[bytes] | None = None
        program = self.home / ".local/bin/swarm-ctl"
        program.parent.mkdir(parents=True)
        _script(program, f'exec {sys.executable} -m swarm_ctl.cli.main "$@"')
        # a login shell of a home of its own; OpenSSH takes the home from the system's users
        _script(
            self.home / "login",
            f"export HOME={self.home} PYTHONPATH={ROOT}:{ROOT / 'sim'}",
            'cd; exec sh -c "$SSH_ORIGINAL_COMMAND"',
        )
        self._config = where / f"{name}.sshd"
        self._config.write_text(
            _CONFIG.format(port=port, address=address, keys=keys, home=self.home)
        )

    @property
    def client(self) -> str:
        """What the operator's ssh is told of it."""
        return _CLIENT.format(
            name=self.name,
            address=self._address,
            port=self._port,
            user=getpass.getuser(),
            keys=self._keys,
        )

    def switch_on(self) -> None:
        """Boot: only the SSH server runs."""
        with (self.home / "sshd.log").open("ab") as log:
            line = [*self._inside, str(_SSHD), "-D", "-e", "-f", str(self._config)]
            self._process = subprocess.Popen(line, stdout=log, stderr=log)
        until = time.monotonic() + _WAIT_S
        while (
            b"Server listening" not in (self.home / "sshd.log").read_bytes().rpartition(b"--\n")[2]
        ):
            assert self._process.poll() is None, (self.home / "sshd.log").read_text()
            assert time.monotonic() < until, "sshd does not listen"
            time.sleep(0.02)

    def switch_off(self) -> None:
        """Lose the power. In a namespace all that runs there is gone with its first process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None
            with (self.home / "sshd.log").open("ab") as log:
                log.write(b"--\n")

    @property
    def root(self) -> Path:
        """What swarm-ctl keeps there."""
        return self.home / ".local/share/swarm-ctl/host"


def made_keys(where: Path) -> Path:
    """A folder with the keys of all computers and of the operator."""
    keys = where / "keys"
    keys.mkdir(mode=0o700)
    for name in ("host", "user"):
        line = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(keys / name)]
        subprocess.run(line, check=True)
    (keys / "known_hosts").write_text(f"computers {(keys / 'host.pub').read_text()}")
    return keys


def ssh_config(where: Path, computers: Mapping[str, Computer]) -> Path:
    """The operator's file for `ssh -F`."""
    path = where / "ssh_config"
    path.write_text("".join(computer.client for computer in computers.values()))
    return path


def _script(path: Path, *lines: str) -> None:
    path.write_text("\n".join(("#!/bin/sh", *lines)) + "\n")
    path.chmod(0o755)
