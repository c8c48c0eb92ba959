"""What the system around the program has: cores, ports, clock, browser; each with what to do where
something is missing. `doctor` shows it."""

from __future__ import annotations

import contextlib
import os
import shutil
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from swarm_ctl.engine.system import GROUND_ALONE, lacks, lacks_for_lockstep
from swarm_ctl.engine.vehicles.instances import GCS_PORT

AGENTS_A_CORE: Final = 16
"""In real time, simulator and station included: docs/understand/figures.md, "How a run grows"."""
_PORTS: Final = (
    (socket.SOCK_DGRAM, GCS_PORT, "ground control software (--gcs)"),
    (socket.SOCK_DGRAM, 14540, "the first PX4 (SITL)"),
    (socket.SOCK_STREAM, 5760, "the first ArduCopter (SITL)"),
)
_CLOCK_KEEPERS: Final = {
    "systemd-timesyncd": "/run/systemd/timesync/synchronized",
    "chrony": "/run/chrony",
    "ntpd": "/run/ntpd.pid",
}
_BROWSERS: Final = ("chromium", "chromium-browser", "google-chrome", "firefox")


def surroundings() -> Iterator[tuple[str, str, bool]]:
    """Name, state, and whether nothing flies without it."""
    missing = lacks()
    flies = f"flies nothing: lacks {', '.join(missing)}; allowed: {GROUND_ALONE}"
    yield "system", flies if missing else f"{sys.platform}, flies", bool(missing)
    stepped = lacks_for_lockstep()
    yield "lockstep", f"not here: lacks {', '.join(stepped)}" if stepped else "works here", False
    yield "cores and memory", _size(), False
    for kind, port, whose in _PORTS:
        yield f"port {port}", _port(kind, port, whose), False
    yield "system clock", _clock(), False
    browser = next(filter(None, map(shutil.which, _BROWSERS)), None)
    yield "browser", browser or "none in the PATH; report.html opens on any other computer", False


def _size() -> str:
    cores = os.cpu_count() or 1
    agents = AGENTS_A_CORE * cores
    size = f"{cores} cores{_memory()}: about {agents} agents in real time"
    return f"{size}; more with --lockstep, or a --speedup under 1"


def _memory() -> str:
    with contextlib.suppress(AttributeError, ValueError, OSError):  # Windows has no sysconf
        pages = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        return f", {pages / 2**30:.1f} GiB free"
    return ""


def _port(kind: socket.SocketKind, port: int, whose: str) -> str:
    with socket.socket(socket.AF_INET, kind) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            why = error.strerror or str(error)
            return f"in use ({why}), by {whose}? run itself takes others"
    return f"free, for {whose}"


def _clock() -> str:
    for keeper, path in _CLOCK_KEEPERS.items():
        if Path(path).exists():
            return f"kept by {keeper}"
    return (
        "no time service seen; agents measure their clocks against each other, but certificates"
        " have dates: install chrony"
    )
