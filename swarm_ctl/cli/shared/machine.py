"""What this machine has of all that the program can use."""

from __future__ import annotations

import contextlib
import os
import platform
import shutil
import socket
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Final

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.cores import cores
from swarm_ctl.engine.system import GROUND_ALONE, lacks, lacks_for_lockstep
from swarm_ctl.engine.vehicle_memory import VehicleMemory, state_folder
from swarm_ctl.engine.vehicles.binaries import find
from swarm_ctl.engine.vehicles.containers import ENGINES
from swarm_ctl.engine.vehicles.instances import GCS_PORT
from swarm_ctl.errors import StartError
from swarm_ctl.installed import packages

LEAST_PYTHON: Final = (3, 11)
_EXTRAS: Final = ("ground", "study", "foxglove", "ros2", "notebook", "serial", "trust")


@dataclass(frozen=True, slots=True)
class Fact:
    """One thing and its state."""

    name: str
    state: str
    attention: bool = False
    """Without it nothing flies."""


def machine() -> list[Fact]:
    """All facts, the most needed first."""
    around = (Fact(*found) for found in surroundings())
    known = (*_autopilots(), _containers(), _terminal(), *_remembered())
    return [_python(), *around, *_packages(), *known]


def _python() -> Fact:
    least = ".".join(map(str, LEAST_PYTHON))
    old = sys.version_info < LEAST_PYTHON
    state = f"{platform.python_version()}, {sys.executable}"
    return Fact("python", f"{state}; needed: {least}" if old else state, attention=old)


def _packages() -> list[Fact]:
    core = _versions("core", ["swarm-ctl", *packages("")], attention=True)
    return [core, *(_versions(f"[{extra}]", packages(extra)) for extra in _EXTRAS)]


def _versions(title: str, names: list[str], *, attention: bool = False) -> Fact:
    found = {name: _version(name) for name in names}
    missing = [name for name, version in found.items() if not version]
    if not names:
        return Fact(f"packages {title}", "unknown to this installation; install it again")
    state = ", ".join(f"{name} {version}" for name, version in found.items() if version)
    if missing:
        there = f"; there: {state}" if state else ""
        extra = "" if attention else f"; pip install 'swarm-ctl{title}'"
        state = f"missing: {', '.join(missing)}{there}{extra}"
    return Fact(f"packages {title}", state, attention and bool(missing))


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


def _autopilots() -> list[Fact]:
    facts = []
    for kind in (VehicleKind.ARDUCOPTER, VehicleKind.PX4):
        try:
            state = str(find(kind))
        except StartError as error:
            state = str(error)
        facts.append(Fact(f"{kind} program", state))
    return facts


def _containers() -> Fact:
    found = [path for name in ENGINES if (path := shutil.which(name))]
    return Fact("containers", ", ".join(found) or "neither podman nor docker")


def _terminal() -> Fact:
    if not sys.stdout.isatty():
        return Fact("terminal", "output goes to a file or pipe: no dashboard here")
    columns, lines = shutil.get_terminal_size()
    return Fact("terminal", f"{os.environ.get('TERM', 'no TERM')}, {columns} x {lines}")


def _remembered() -> list[Fact]:
    folder = state_folder()
    try:
        entries = VehicleMemory(folder).entries()
    except OSError as error:
        where = f"{error.filename}: {error.strerror}"
        return [Fact("remembered vehicles", where, attention=True)]
    if not _writable(folder):
        where = f"{folder} can't be written; allowed: SWARM_CTL_STATE=FOLDER that can"
        return [Fact("remembered vehicles", where, attention=True)]
    facts = [Fact("remembered vehicles", f"{len(entries)} in {folder}")]
    for entry in entries:
        own = ", ".join(f"{name} {value.own:g}" for name, value in entry.values.items())
        vehicle = f"{entry.vehicle.autopilot} {entry.vehicle.sysid} at {entry.endpoint}"
        facts.append(
            Fact(f"  {vehicle}", f"own values {own}; left by {entry.flight} of {entry.since}")
        )
    return facts


def _writable(folder: Path) -> bool:
    """Whether this folder, or the first one above that is there, may be written."""
    there = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    return os.access(there, os.W_OK | os.X_OK)


_AGENTS_A_CORE, _AT_TICKS_OF_S = 16, 0.05
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


def carried(tick_s: float = _AT_TICKS_OF_S, speedup: float = 1.0) -> int:
    """About how many agents this machine carries by the wall clock, `speedup` times real time."""
    return round(_AGENTS_A_CORE * cores() * tick_s / (_AT_TICKS_OF_S * speedup))


def too_many(agents: int, tick_s: float, speedup: float) -> list[str]:
    """The warning where so many agents are more than this machine carries by the wall clock."""
    most = carried(tick_s, speedup)
    if agents <= most:
        return []
    fast = "in real time" if speedup == 1.0 else f"at {speedup:g} times real time"
    flown = f"{agents} agents, {1 / tick_s:g} ticks a second, {fast}"
    late = "over that ticks are late, and vehicles that hear nothing land"
    instead = "`--speedup max` flies simulated vehicles in lockstep, as slowly as it has to"
    return [f"{flown}: this machine carries about {most}; {late}; {instead}"]


def _size() -> str:
    have = "1 core" if cores() == 1 else f"{cores()} cores"
    size = f"{have}{_memory()}: about {carried()} agents in real time"
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
