"""A swarm that holds its shape for hours: does anything grow, does anything get later?

    python -m tests.bench.bench_soak --minutes 120

Flies the hexagon (`--mission` for another) with a hold as long (mission time), looks every few seconds, and prints for
each process its memory and how it grows (an hour of the wall clock), and for each agent the age of its newest news and
of its vehicle's answers.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rich.console import Console

from tests.bench.bench_run import Usage, _look
from tests.system.running import HEXAGON, Running

_EVERY_S = 5.0
_WARM_S = 60.0
"""Take-off, first shapes, caches: not looked at."""


def _held(mission: Path, minutes: float) -> str:
    """The mission's file with all its holds together so long."""
    document = yaml.safe_load(mission.read_text())
    for step in document["steps"]:
        if isinstance(step, dict) and "hold" in step:
            step["hold"] = {"duration_s": minutes * 60.0}
            return str(yaml.safe_dump(document))
    raise SystemExit(f"{mission}: has no hold step to make longer")


def _slope(times_s: list[float], values: list[float]) -> float:
    """Growth an hour."""
    return float(np.polyfit(times_s, values, 1)[0]) * 3600.0 if len(times_s) > 1 else 0.0


def _statuses(running: Running, since_s: float) -> dict[int, list[dict[str, Any]]]:
    """By agent, from mission time `since_s` on, while it holds."""
    found: dict[int, list[dict[str, Any]]] = {}
    for line in (running.folder / "statuses.jsonl").read_text().splitlines():
        status = json.loads(line)
        if status["time_s"] > since_s and status["outcome"] == "running":
            found.setdefault(status["agent"], []).append(status)
    return found


def _memory(running: Running) -> dict[str, tuple[list[float], list[float]]]:
    """(seconds, MiB of its own) of each process, until the run ends."""
    series: dict[str, tuple[list[float], list[float]]] = {name: ([], []) for name in running.pids}
    began = time.monotonic()
    while running.process.poll() is None:
        time.sleep(_EVERY_S)
        for name, pid in running.pids.items():
            usage = Usage()
            try:
                _look(pid, usage, began)
            except OSError:
                continue  # it has ended
            if usage.watched_s > _WARM_S and usage.private_mib:
                series[name][0].append(usage.watched_s)
                series[name][1].append(usage.private_mib)
    return series


def main() -> None:
    """Fly, look, print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--speedup", type=float, default=1.0)
    parser.add_argument("--mission", type=Path, default=HEXAGON)
    arguments = parser.parse_args()
    console, load = Console(highlight=False, soft_wrap=True), os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        mission = Path(folder) / "soak.yaml"
        speedup = ("--speedup", str(arguments.speedup))
        mission.write_text(_held(arguments.mission, arguments.minutes))
        with Running("run", mission, "--headless", "--no-report", *speedup, cwd=Path(folder)) as running:
            running.wait_for(lambda: bool(list(Path(folder).glob("runs/*/processes.json"))))
            series = _memory(running)
            code = running.wait()
            statuses = _statuses(running, _WARM_S)
    flown = f"{arguments.minutes:g} minutes at speed-up {arguments.speedup:g}"
    console.print(f"{flown}: exit code {code}; load {load:.1f} to {os.getloadavg()[0]:.1f}")
    for name, (times_s, mib) in series.items():
        if mib:
            console.print(f"{name:12} {mib[0]:7.1f} MiB  last {mib[-1]:7.1f} MiB  {_slope(times_s, mib):+8.2f} MiB/h")
    for agent, lines in sorted(statuses.items()):
        _latency(agent, lines, console)
    sys.exit(code)


def _latency(agent: int, lines: list[dict[str, Any]], console: Console) -> None:
    times_s = [line["time_s"] for line in lines]
    ages = [1000 * max(link["age_s"] or 0.0 for link in line["links"].values()) for line in lines]
    trips = [1000 * (line["vehicle_link"]["round_trip_s"] or 0.0) for line in lines]
    overruns = lines[-1]["tick"]["overruns"] - lines[0]["tick"]["overruns"]
    console.print(
        f"agent {agent:<6} oldest news {np.median(ages):5.0f} ms {_slope(times_s, ages):+7.1f} ms/h  "
        f"vehicle there and back {np.median(trips):5.0f} ms {_slope(times_s, trips):+7.1f} ms/h  {overruns} overruns"
    )


if __name__ == "__main__":
    main()
