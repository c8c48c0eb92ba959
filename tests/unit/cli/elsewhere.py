"""`swarm-ctl` as another system would run it, simulated: `python elsewhere.py win32 COMMANDS`.

The libraries are loaded as on this system. Then what that system lacks is taken away: modules,
functions, constants; and `sys.platform` says its name. numba, which would compile for the system of
that name, is taken away as well: studies fly uncompiled. COMMANDS is JSON, a list of argument
lists; for each a JSON line tells its exit code. What such a system does differently, rather than
not at all, is not simulated (paths, locks of open files, `spawn`, consoles).
"""

from __future__ import annotations

import asyncio  # noqa: F401 - the libraries that look at the system when they are loaded
import json
import multiprocessing.pool  # noqa: F401
import os
import signal
import socket
import subprocess
import sys

import matplotlib.pyplot  # noqa: F401
import rich.console  # noqa: F401
import textual.app
import textual.widgets  # noqa: F401
import typer  # noqa: F401

MODULES = ("fcntl", "termios", "tty", "pty", "resource", "grp", "pwd", "syslog", "readline")
WINDOWS: dict[object, str] = {
    os: "fork forkpty register_at_fork getuid geteuid getgid getegid getsid setsid getpgrp"
    " tcgetpgrp nice set_blocking fchmod sync sched_getaffinity sysconf uname mkfifo killpg"
    " O_NONBLOCK O_CLOEXEC O_NOFOLLOW O_DIRECTORY O_NOCTTY",
    signal: "SIGHUP SIGKILL SIGSTOP SIGCONT SIGTTIN SIGTTOU SIGUSR1 SIGPIPE pthread_sigmask",
    socket: "AF_UNIX SO_PEERCRED",
    subprocess: "_fork_exec",
}
MACOS: dict[object, str] = {socket: "SO_PEERCRED", os: "sched_getaffinity"}


def main(platform: str, commands: list[list[str]]) -> None:
    """Run the commands, one after the other."""
    sys.platform = platform
    sys.modules["numba"] = None  # type: ignore[assignment] - so that importing it fails
    if platform == "win32":
        for name in MODULES:
            sys.modules[name] = None  # type: ignore[assignment]
    for module, names in (WINDOWS if platform == "win32" else MACOS).items():
        for name in names.split():
            if hasattr(module, name):
                delattr(module, name)
    from swarm_ctl.cli.app import main as swarm_ctl

    for command in commands:
        sys.argv = ["swarm-ctl", *command]
        code: object = 0
        try:
            swarm_ctl()
        except SystemExit as ended:
            code = ended.code or 0
        sys.stdout.flush()
        print(json.dumps({"command": command, "code": code}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], json.loads(sys.argv[2]))
