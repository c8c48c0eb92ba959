"""What a tick costs with lockstep and without: CPU of each kind of process, and how fast the swarm
flies from the first lift-off to the last touchdown.

    python -m tests.bench.bench_lockstep [--mission missions/hexagon.yaml] [--speedup 1]

`--speedup` is that of the run in real time, of which a slow machine makes overruns: then its ticks
are fewer, and its figures say nothing of a tick.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import tempfile
import time
from collections import Counter
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tests.bench.bench_run import ROOT
from tests.system.running import SWARM_CTL


def main() -> None:
    """Fly both and print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--mission", type=Path, default=ROOT / "missions" / "hexagon.yaml")
    parser.add_argument("--speedup", default="1")
    arguments = parser.parse_args()
    table = Table("ms of CPU a tick", "real time", "lockstep")
    load = os.getloadavg()[0]
    runs = [_fly(arguments.mission, words) for words in (arguments.speedup, "max")]
    for name in ("agent", "simulator", "station", "clock", "all"):
        table.add_row(name, *(f"{costs.get(name, 0.0):.2f}" for costs, _, _ in runs))
    table.add_row("times real time", *(f"{factor:.1f}" for _, factor, _ in runs))
    table.add_row("overruns", *(str(overruns) for _, _, overruns in runs))
    console = Console()
    console.print(f"{arguments.mission.name}, load {load:.1f} before, {os.cpu_count()} cores")
    console.print(table)


def _fly(mission: Path, speedup: str) -> tuple[dict[str, float], float, int]:
    """CPU a tick by kind of process, without what came before the first tick; mission seconds a
    second in the air; overruns."""
    with tempfile.TemporaryDirectory() as folder:
        command = [str(SWARM_CTL), "run", str(mission.resolve()), "--speedup", speedup]
        process = subprocess.Popen(
            [*command, "--headless", "--no-report"], cwd=folder, stdout=subprocess.DEVNULL
        )
        first: dict[str, float] = {}
        last: dict[str, float] = {}
        moments: list[float] = []
        while process.poll() is None:
            time.sleep(0.05)
            for run in Path(folder).glob("runs/*/processes.json"):
                _watch(json.loads(run.read_text() or "{}"), first, last)
                _note_air(run.parent / "truth.jsonl", moments)
        run = next(Path(folder).glob("runs/*"))
        summary = json.loads((run / "summary.json").read_text())
    ticks = summary["mission_time_s"] / 0.05
    costs = Counter[str]()
    for name, cpu_s in last.items():
        kind = name.partition("-")[0]
        used_ms = 1000 * (cpu_s - first[name]) / ticks
        costs["all"] += used_ms
        costs[kind] += used_ms / len(summary["agents"]) if kind == "agent" else used_ms
    truth = summary["truth"]
    flown_s = truth["last_touchdown_s"] - truth["first_liftoff_s"]
    return dict(costs), flown_s / (moments[-1] - moments[0]), summary["tick"]["overruns"]


def _watch(pids: dict[str, int], first: dict[str, float], last: dict[str, float]) -> None:
    for name, pid in pids.items():
        try:
            cpu_s = _cpu_s(pid)
        except (OSError, ValueError):
            continue  # it has ended: its last figure stands
        first.setdefault(name, cpu_s)
        last[name] = max(cpu_s, last.get(name, 0.0))


def _cpu_s(pid: int) -> float:
    """Of all threads, to the nanosecond. (`stat` counts whole hundredths of a second, and a look at
    its memory would stop the process.)"""
    threads = Path(f"/proc/{pid}/task").iterdir()
    return sum(int((thread / "schedstat").read_text().split()[0]) for thread in threads) / 1e9


def _note_air(truth: Path, moments: list[float]) -> None:
    """The moments at which any vehicle was seen in the air."""
    if not truth.exists():
        return
    with truth.open("rb") as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - 20_000))
        states = [line for line in file.read().split(b"\n") if line.startswith(b'{"type":"state"')]
    if states and states[-1].endswith(b"}") and any(json.loads(states[-1])["airborne"]):
        moments.append(time.monotonic())


if __name__ == "__main__":
    main()
