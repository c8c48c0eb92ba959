"""Finds the autopilots' SITL binaries: an option, an environment variable, the PATH; or the
container image that one of the first two names."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Final

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.engine.vehicles.containers import PREFIX, Image, find_image
from swarm_ctl.errors import StartError

VARIABLES: Final = {
    VehicleKind.ARDUCOPTER: "SWARM_CTL_ARDUCOPTER",
    VehicleKind.PX4: "SWARM_CTL_PX4",
}
WHERE_TO_GET: Final = {
    VehicleKind.ARDUCOPTER: (
        "build it: git clone --recurse-submodules https://github.com/ArduPilot/ardupilot;"
        " ./waf configure --board sitl; ./waf copter; it is build/sitl/bin/arducopter"
        " (ready builds: https://firmware.ardupilot.org/Copter/stable/SITL_x86_64_linux_gnu)"
    ),
    VehicleKind.PX4: (
        "build it: git clone --recursive https://github.com/PX4/PX4-Autopilot;"
        " make px4_sitl_default; the folder is build/px4_sitl_default"
    ),
}


def find(kind: VehicleKind, given: str | None = None) -> Path | Image:
    """The `arducopter` binary or a container image with one, or the folder of PX4 that has bin/px4
    and etc/.

    StartError with where to get it.
    """
    variable = VARIABLES[kind]
    said = given or os.environ.get(variable)
    source = f"--{kind}" if given else variable
    if said and said.startswith(PREFIX):
        return _image(kind, said, source)
    if said:
        found = _at(kind, Path(said).expanduser())
        if found is None:
            raise StartError(f"{source} {said}: {_lacks(kind)}; {WHERE_TO_GET[kind]}")
        return found
    on_path = shutil.which("arducopter" if kind is VehicleKind.ARDUCOPTER else "px4")
    found = _at(kind, Path(on_path)) if on_path else None
    if found is None:
        raise StartError(
            f"no {kind} here; name it with --{kind} PATH or {variable}, or put it on the PATH."
            f" To get one, {WHERE_TO_GET[kind]}"
        )
    return found


def _image(kind: VehicleKind, said: str, source: str) -> Image:
    if kind is not VehicleKind.ARDUCOPTER:
        raise StartError(
            f"{source} {said}: of the autopilots, only arducopter is started in a container;"
            " allowed: a path, or a fleet whose endpoints are the container's"
        )
    try:
        return find_image(said)
    except StartError as error:
        raise StartError(f"{source} {said}: {error}") from None


def _at(kind: VehicleKind, path: Path) -> Path | None:
    """What `path` names, made absolute; None where it is not there."""
    path = path.resolve()
    if kind is VehicleKind.ARDUCOPTER:
        return path if path.is_file() and os.access(path, os.X_OK) else None
    # The folder itself, a source tree that was built, or the binary in such a folder.
    for folder in (path, path / "build" / "px4_sitl_default", path.parent.parent):
        if os.access(folder / "bin" / "px4", os.X_OK) and (folder / "etc").is_dir():
            return folder
    return None


def _lacks(kind: VehicleKind) -> str:
    if kind is VehicleKind.ARDUCOPTER:
        return "is no program that may be run"
    return "has no bin/px4 and etc/"
