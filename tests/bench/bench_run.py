"""What a run costs: from command to six airborne agents, tick lateness, CPU and memory of each
process.

    python -m tests.bench.bench_run [--speedup 1] [--mission missions/hexagon.yaml]

Prints the machine's load before and after: on a busy machine lateness tells about the machine, not
about the program.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[2]
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@dataclass
class Usage:
    """One process at the last look: CPU seconds so far, seconds watched, memory of its own
    [MiB]."""

    cpu_s: float = 0.0
    watched_s: float = 0.0
    private_mib: float = 0.0
    pss_mib: float = 0.0


def _look(pid: int, usage: Usage, since: float) -> None:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    memory = dict(
        line.split(":", 1)
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:]
        if ":" in line
    )
    usage.cpu_s = (int(fields[11]) + int(fields[12])) / _TICKS_PER_S
    usage.watched_s = time.monotonic() - since
    usage.private_mib = (
        sum(int(memory[key].split()[0]) for key in ("Private_Clean", "Private_Dirty")) / 1024
    )
    usage.pss_mib = int(memory["Pss"].split()[0]) / 1024


def main() -> None:
    """Fly once and print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--speedup", type=float, default=1.0)
    parser.add_argument("--mission", type=Path, default=ROOT / "missions" / "hexagon.yaml")
    arguments = parser.parse_args()
    load_before = os.getloadavg()
    with tempfile.TemporaryDirectory() as folder:
        summary, usages, airborne_s, ready_s = _fly(
            arguments.mission, arguments.speedup, Path(folder)
        )
    console = Console()
    console.print(
        f"{arguments.mission.name} at speed-up {arguments.speedup:g}: {summary['outcome']}"
    )
    console.print(
        f"load before {load_before[0]:.2f}, after {os.getloadavg()[0]:.2f}, {os.cpu_count()} cores"
    )
    console.print(
        f"command to all processes ready: {ready_s:.2f} s; "
        f"to all agents airborne: {airborne_s:.2f} s"
    )
    tick = summary["tick"]
    console.print(
        f"ticks of the worst agent: lateness p50 {tick['late_p50_ms']:.2f} ms, "
        f"p99 {tick['late_p99_ms']:.2f} ms, "
        f"max {tick['late_max_ms']:.1f} ms; {tick['overruns']} of {tick['count']} overrun"
    )
    table = Table("process", "CPU s", "CPU % of a core", "private MiB", "proportional MiB")
    for name, usage in usages.items():
        share = 100 * usage.cpu_s / max(usage.watched_s, 1e-9)
        table.add_row(
            name,
            f"{usage.cpu_s:.2f}",
            f"{share:.1f}",
            f"{usage.private_mib:.1f}",
            f"{usage.pss_mib:.1f}",
        )
    console.print(table)


def _fly(
    mission: Path, speedup: float, folder: Path, more: tuple[str, ...] = ()
) -> tuple[dict[str, object], dict[str, Usage], float, float]:
    command = [str(Path(sys.executable).parent / "swarm-ctl"), "run", str(mission.resolve())]
    start = time.monotonic()
    process = subprocess.Popen(
        [*command, "--headless", "--speedup", str(speedup), *more],
        cwd=folder,
        stdout=subprocess.DEVNULL,
    )
    usages: dict[str, Usage] = {}
    pids: dict[str, int] = {}
    ready_s = airborne_s = float("nan")
    next_look = 0.0
    while process.poll() is None:
        time.sleep(0.02)
        run = next(iter((folder / "runs").glob("*")), None) if (folder / "runs").exists() else None
        if run is None:
            continue
        if not pids and (run / "processes.json").exists():
            pids = json.loads((run / "processes.json").read_text() or "{}")
            usages = {name: Usage() for name in pids}
            ready_s = time.monotonic() - start
        if airborne_s != airborne_s and _all_airborne(run):
            airborne_s = time.monotonic() - start
        if time.monotonic() > next_look:
            next_look = time.monotonic() + 0.25
            for name, pid in pids.items():
                try:
                    _look(pid, usages[name], start + ready_s)
                except (OSError, KeyError, ValueError):
                    continue  # it has ended: its last figures stand
    summary = json.loads((run / "summary.json").read_text()) if run else {}
    return summary, usages, airborne_s, ready_s


def _all_airborne(run: Path) -> bool:
    truth = run / "truth.jsonl"
    if not truth.exists():
        return False
    lines = truth.read_text().splitlines()
    states = [
        line for line in lines[-20:] if line.startswith('{"type":"state"') and line.endswith("}")
    ]
    return bool(states) and all(json.loads(states[-1])["airborne"])


if __name__ == "__main__":
    main()
