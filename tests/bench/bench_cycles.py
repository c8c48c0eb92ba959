"""Starts and stops a whole swarm again and again, and counts what is left over.

    python -m tests.bench.bench_cycles --cycles 500

A cycle: `swarm-ctl run` until all processes are ready, Ctrl-C, its end. After each one counted:
processes of its session, processes, sockets and open files of this machine, entries in the folder
for temporary files and in shared memory, memory in use. Ends with exit code 1 when a cycle has
failed, a process is left, or a count grows by more than one in ten cycles. On a machine that does
other things, too, root counts in namespaces without other processes:

    unshare --net --pid --mount --fork --mount-proc sh -c 'ip link set lo up && mount -t tmpfs none
    /dev/shm &&
      python -m tests.bench.bench_cycles --cycles 500'
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console

from tests.system.running import HEXAGON, Running

_GROWS: float = 0.1
_TELL = 50
"""Cycles between two words on how far it is."""
_NAMES = (
    "processes",
    "sockets",
    "temporary files",
    "shared memory files",
    "open files",
    "memory [MiB]",
    "time [s]",
)
_STRICT = 4
"""The first of them that belong to this program alone, where no other runs; the rest are shared."""


def _sockets() -> int:
    """Of this machine, but for TCP ones that only wait for late packets."""
    count = 0
    for name in ("tcp", "tcp6", "udp", "udp6"):
        path = Path("/proc/net") / name
        lines = path.read_text().splitlines()[1:] if path.exists() else []
        count += sum(line.split()[3] != "06" for line in lines)
    return count


def _lives(stat: Path) -> bool:
    """No zombie: those are the business of init, which in a namespace of its own may be this
    program."""
    try:
        return stat.read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False  # it has ended


def _memory_mib() -> float:
    found = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text().splitlines())
    return (int(found["MemTotal"].split()[0]) - int(found["MemAvailable"].split()[0])) / 1024


def _entries(folder: str) -> int:
    return len(list(Path(folder).iterdir())) if Path(folder).is_dir() else 0


def _counts(seconds: float) -> list[float]:
    processes = sum(_lives(stat) for stat in Path("/proc").glob("[0-9]*/stat"))
    files = int(Path("/proc/sys/fs/file-nr").read_text().split()[0])
    entries = [_entries(tempfile.gettempdir()), _entries("/dev/shm")]  # noqa: S108
    return [processes, _sockets(), *entries, files, _memory_mib(), seconds]


def _cycle(mission: Path, where: Path) -> str:
    """One start and stop; what went wrong, or ''."""
    with Running("run", mission, "--headless", "--no-report", cwd=where) as running:
        running.wait_for(lambda: bool(list(where.glob("runs/*/processes.json"))))
        running.interrupt()
        code = running.wait(60)
        running.assert_nothing_left()
        return "" if code == 130 else f"exit code {code}: {running.output[-500:]}"


def _cycle_in(where: Path, mission: Path) -> str:
    """A cycle in a folder of its own, which is gone then; what went wrong, or ''."""
    where.mkdir()
    try:
        return _cycle(mission, where)
    except AssertionError as error:
        return str(error)
    finally:
        shutil.rmtree(where)


def main() -> None:
    """Count, and say how each count has grown."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cycles", type=int, default=20)
    parser.add_argument("--mission", type=Path, default=HEXAGON)
    arguments = parser.parse_args()
    console, rows, failures = Console(highlight=False), [], []
    load = os.getloadavg()[0]
    try:
        with tempfile.TemporaryDirectory() as folder:
            for number in range(arguments.cycles + 1):
                began = time.monotonic()
                failure = _cycle_in(Path(folder) / str(number), arguments.mission.resolve())
                failures += [f"cycle {number}: {failure}"] if failure else []
                if number:  # the first one warms caches up
                    rows.append(_counts(time.monotonic() - began))
                if number % _TELL == 0:
                    console.print(f"cycle {number}: {len(failures)} failed", style="dim")
    except KeyboardInterrupt:
        console.print("interrupted; so far:")
    console.print(
        f"{len(rows)} cycles of {arguments.mission.name}; load {load:.1f} to "
        f"{os.getloadavg()[0]:.1f}"
    )
    grown = _report(np.array(rows), console)
    for text in failures:
        console.print(text, style="red", markup=False)
    sys.exit(1 if failures or grown else 0)


def _report(counts: np.ndarray, console: Console) -> bool:
    """A line for each count; whether one that only this program moves has grown."""
    grown = False
    for k, name in enumerate(_NAMES):
        column = counts[:, k]
        slope = float(np.polyfit(np.arange(len(column)), column, 1)[0]) if len(column) > 1 else 0.0
        console.print(
            f"{name:20} first {column[0]:9.1f}  last {column[-1]:9.1f}  {slope:+8.3f} a cycle"
        )
        grown |= k < _STRICT and slope > _GROWS and column[-1] > column[0]
    return grown


if __name__ == "__main__":
    main()
