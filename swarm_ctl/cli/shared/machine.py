"""What this machine has of all that the program can use."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Final

from swarm_ctl.cli.shared.surroundings import surroundings
from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.engine.vehicle_memory import VehicleMemory, state_folder
from swarm_ctl.engine.vehicles.binaries import find
from swarm_ctl.engine.vehicles.containers import ENGINES
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
