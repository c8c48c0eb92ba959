"""What flying takes that not every system has, by name. The commands that fly nothing (`validate`,
`study`, `report`, `compare`, `replay`, ...) take none of it."""

from __future__ import annotations

import importlib.util
import os
import signal
import socket
import sys

from swarm_ctl.errors import InputError

FLYING = ("run", "station", "send", "agent", "router", "sim", "measure")
"""The commands that start processes of a flight, or speak with them."""
GROUND_ALONE = (
    "Linux (also WSL or a container), where all commands work; here: validate, plan, study, paper,"
    " report, compare, replay --headless, missions, schema, keys"
)


def lacks() -> list[str]:
    """What this system lacks of all that processes of a flight use; on Linux and macOS nothing."""
    has = {
        "fork (agents start by it)": hasattr(os, "fork"),
        "pipes that do not wait (a lifeline is one)": hasattr(os, "set_blocking"),
        "the signals SIGHUP and SIGKILL": hasattr(signal, "SIGHUP") and hasattr(signal, "SIGKILL"),
        "file locks (fcntl)": importlib.util.find_spec("fcntl") is not None,
        "terminals (termios)": importlib.util.find_spec("termios") is not None,
        "owners of files": hasattr(os, "geteuid"),
    }
    return [name for name, there in has.items() if not there]


def lacks_for_lockstep() -> list[str]:
    """The same of lockstep, whose keeper listens in an abstract name space and asks who connects:
    Linux alone has both."""
    has = {
        "Unix sockets in an abstract name space": sys.platform == "linux",
        "the user of a connected process (SO_PEERCRED)": hasattr(socket, "SO_PEERCRED"),
    }
    return [name for name, there in has.items() if not there]


def refuse_without(missing: list[str], what: str, instead: str) -> None:
    """InputError where something is missing; `instead`: what works here."""
    if missing:
        raise InputError(
            f"{what} does not work on {sys.platform}, which lacks {', '.join(missing)};"
            f" allowed: {instead}"
        )
