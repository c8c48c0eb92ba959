"""The folders of runs on this machine: a new one, those in the air, the one that is meant."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated, Final

from pydantic import Field, TypeAdapter, ValidationError

from swarm_ctl.engine import clock as wall
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.files import read_bytes
from swarm_ctl.report.judge.summary import SUMMARY
from swarm_ctl.runfolder.manifest import MANIFEST, Manifest, read_manifest

RUNS: Final = Path("runs")
"""Where `run` puts its folders, if it is not told otherwise."""
PROCESSES: Final = "processes.json"
_PIDS: Final = TypeAdapter(dict[str, Annotated[int, Field(gt=0, lt=1 << 31)]])
_MOST_BYTES: Final = 1 << 20
"""Of `processes.json`."""


def make_folder(runs: Path, mission: str) -> Path:
    """Make `runs/<time>-<mission>`, with a number behind it where that is taken."""
    name = f"{wall.date_and_time():%Y%m%d-%H%M%S}-{mission}"
    for number in range(1, 1000):
        folder = runs / (name if number == 1 else f"{name}-{number}")
        try:
            folder.mkdir(0o700, parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise StartError(
                f"can't make the run folder {folder}: {error.strerror}; choose with --runs"
            ) from None
        return folder
    raise StartError(f"{runs} has a thousand folders {name}-*")


def flying_run(named: Path | str | None = None, runs: Path = RUNS) -> Path:
    """The folder of the run that is meant: a run folder, the mission of a run in `runs` that flies,
    or (None) the only run that flies.

    Raises:
        InputError: several runs may be meant, or others than the named one fly; lists them.
        StartError: no run flies, or the one that is named has ended.
    """
    if named is not None and (Path(named) / MANIFEST).exists():
        if why := ended(Path(named), read_manifest(Path(named))):
            raise StartError(why)
        return Path(named)
    flying = _flying(runs)
    meant = {
        folder: manifest
        for folder, manifest in flying.items()
        if named is None or str(named) == manifest.plan.name
    }
    if len(meant) == 1:
        return next(iter(meant))
    if meant:
        alike = len({manifest.plan.name for manifest in meant.values()}) < len(meant)
        by = "folder" if alike else "mission or its folder"
        raise InputError(
            f"{len(meant)} swarms are in the air: {_listed(meant)}; name one by its {by}"
        )
    if named is not None:
        why = f"{named} is no run folder, and no mission that flies"
        if flying:
            raise InputError(f"{why}; in the air: {_listed(flying)}")
        raise StartError(f"{why}; no run of {runs}/ is in the air")
    if unsure := _started_elsewhere(runs):
        return max(unsure)
    last = max((path.parent for path in runs.glob(f"*/{MANIFEST}")), default=None)
    newest = f"; the newest run there, {last.name}, has ended" if last else ""
    raise StartError(
        f"nothing flies: no run in {runs}/ is in the air{newest}. Start one with swarm-ctl run, or"
        " name the folder of one that flies"
    )


def _started_elsewhere(runs: Path) -> list[Path]:
    """Runs without a summary whose agents other hosts started: no process here tells of them."""
    open_ = (p.parent for p in runs.glob(f"*/{MANIFEST}") if not (p.parent / SUMMARY).exists())
    return [folder for folder in open_ if read_manifest(folder).elsewhere]


def ended(folder: Path, manifest: Manifest) -> str:
    """That a run has ended, in words; '' where it flies, starts, or no process that is seen here
    tells of it: its agents are on other hosts, or it is in another container."""
    again = f"; watch it again with swarm-ctl replay {folder}"
    again = again if (folder / "recording.mcap").exists() else ""
    if (folder / SUMMARY).exists():
        return f"{folder} has ended{again}"
    processes = folder / PROCESSES
    seen = manifest.process_space in (None, process_space())
    if manifest.elsewhere or not seen:
        return ""
    if processes.exists():
        lives = _one_lives(processes)
    else:  # it starts, or was killed meanwhile
        lives = manifest.process is None or _lives(manifest.process)
    if lives and not _restarted_since(manifest):
        return ""
    return f"{folder} was killed: none of its processes lives, and it has no summary{again}"


def _flying(runs: Path) -> dict[Path, Manifest]:
    """By folder: without a summary, and one of its agents' processes lives."""
    found: dict[Path, Manifest] = {}
    for path in sorted(runs.glob(f"*/{PROCESSES}")):
        folder = path.parent
        if (folder / SUMMARY).exists() or not _one_lives(path, "agent-"):
            continue
        manifest = read_manifest(folder)
        if not _restarted_since(manifest):
            found[folder] = manifest
    return found


def process_space() -> str | None:
    """The space of process ids that this process sees; None where the system has but one."""
    try:
        return str(Path("/proc/self/ns/pid").readlink())
    except OSError:
        return None


def _restarted_since(manifest: Manifest) -> bool:
    """The machine was started again since the run was."""
    return manifest.epoch_s > wall.wall_s()


def _one_lives(processes: Path, kind: str = "") -> bool:
    """One of the processes lives whose name begins so."""
    try:
        pids = _PIDS.validate_json(read_bytes(processes, _MOST_BYTES))
    except (OSError, ValidationError):
        return False  # torn, or of another program
    return any(_lives(pid) for name, pid in pids.items() if name.startswith(kind))


def _lives(pid: int) -> bool:
    if sys.platform == "win32":
        return False  # nothing of ours flies there, and os.kill(pid, 0) would be a Ctrl-C
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # another user's
        return True
    try:
        state = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()[:1]
    except OSError:  # no Linux, or it has ended meanwhile
        return True
    return state != [b"Z"]  # dead, and nothing has asked for its exit code: a container's first may


def _listed(runs: dict[Path, Manifest]) -> str:
    return ", ".join(f"{manifest.plan.name} ({folder})" for folder, manifest in runs.items())
