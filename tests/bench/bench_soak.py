"""A swarm that holds its shape for hours: does anything grow, does anything get later?

    python -m tests.bench.bench_soak --minutes 120

Flies the hexagon (`--mission` for another) with holds as long (mission time) and batteries that
last, looks every few seconds, and prints for each process its memory and how it grows, in the whole
time and in its second half; and for each agent how late its ticks are, the age of its newest news
and of its vehicle's answers, and how they change. All by the hour of mission time, after the first
minutes (`_WARM_S`).

Two kinds of memory: `allocated` are all pages that no file backs; `own` those of them that are not
shared with the process it was forked from. Own ones grow for a long time while nothing is
allocated: an agent that counts a reference of an object made before the fork makes its page its
own, one after the other, until all in use are.

Two things are known to grow while all is well. An agent's subscriptions are rings of 4096 slots of
256 bytes, touched one after the other: the beacons' (4 Hz) takes 17 minutes to its full 1 MiB. And
the station's recorder keeps 0.8 kB for each chunk of the recording, one a second of the wall clock:
3 MiB an hour, of which the recording's index is made.
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
from rich.table import Table

from tests.system.running import HEXAGON, Running

_EVERY_S = 5.0
_WARM_S = 300.0
"""Mission time of take-off, first shapes, caches: not looked at."""
_LONGEST_HOLD_S = 3600.0

Series = tuple[list[float], list[float]]
"""Mission times [s] and values."""


def _held(mission: Path, minutes: float) -> str:
    """The mission's file with its first hold so long, in parts that a mission file may have;
    batteries last."""
    document = yaml.safe_load(mission.read_text())
    document.setdefault("simulation", {}).setdefault("parameters", {})["SIM_BATT_DRAIN"] = 0
    for k, step in enumerate(document["steps"]):
        if isinstance(step, dict) and "hold" in step:
            whole, rest = divmod(minutes * 60.0, _LONGEST_HOLD_S)
            parts = [_LONGEST_HOLD_S] * int(whole) + [rest] * (rest > 0)
            document["steps"][k : k + 1] = [{"hold": {"duration_s": part}} for part in parts]
            return str(yaml.safe_dump(document))
    raise SystemExit(f"{mission}: has no hold step to make longer")


def _slope(times_s: list[float], values: list[float]) -> float:
    """Growth an hour."""
    return float(np.polyfit(times_s, values, 1)[0]) * 3600.0 if len(times_s) > 1 else 0.0


def _slopes(series: Series) -> str:
    """In the whole time, and in its second half."""
    times_s, values = series
    half = len(times_s) // 2
    return f"{_slope(times_s, values):+.2f}, {_slope(times_s[half:], values[half:]):+.2f}"


def _statuses(running: Running, since_s: float) -> dict[int, list[dict[str, Any]]]:
    """By agent, from mission time `since_s` on, while it holds."""
    found: dict[int, list[dict[str, Any]]] = {}
    for line in (running.folder / "statuses.jsonl").read_text().splitlines():
        status = json.loads(line)
        if status["time_s"] > since_s and status["outcome"] == "running":
            found.setdefault(status["agent"], []).append(status)
    return found


def _look(pid: int) -> tuple[float, float]:
    """Allocated and own memory [MiB]; OSError when it has ended."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:]
    kib = {name: int(rest.split()[0]) for name, rest in (line.split(":", 1) for line in lines)}
    return kib["Anonymous"] / 1024, kib["Private_Dirty"] / 1024


def _memory(running: Running, speedup: float) -> dict[str, tuple[Series, Series]]:
    """Allocated and own memory of each process, until the run ends."""
    series: dict[str, tuple[Series, Series]] = {name: (([], []), ([], [])) for name in running.pids}
    began = time.monotonic()
    while running.process.poll() is None:
        time.sleep(_EVERY_S)
        at_s = (time.monotonic() - began) * speedup
        for name, pid in running.pids.items():
            try:
                found = _look(pid)
            except OSError:
                continue  # it has ended
            for (times_s, values), mib in zip(series[name], found, strict=True):
                if at_s > _WARM_S and mib:
                    times_s.append(at_s)
                    values.append(mib)
    return series


def main() -> None:
    """Fly, look, print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--speedup", type=float, default=1.0)
    parser.add_argument("--mission", type=Path, default=HEXAGON)
    arguments = parser.parse_args()
    console, load = Console(highlight=False, soft_wrap=True, width=160), os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        mission = Path(folder) / "soak.yaml"
        speedup = ("--speedup", str(arguments.speedup))
        mission.write_text(_held(arguments.mission, arguments.minutes))
        with Running(
            "run", mission, "--headless", "--no-report", *speedup, cwd=Path(folder)
        ) as running:
            running.wait_for(lambda: bool(list(Path(folder).glob("runs/*/processes.json"))))
            series = _memory(running, arguments.speedup)
            code = running.wait()
            statuses = _statuses(running, _WARM_S)
            told = running.summary()
    flown = f"{arguments.minutes:g} minutes at speed-up {arguments.speedup:g}"
    console.print(
        f"{flown}: {told['outcome']} {told['reason']}; load {load:.1f} to {os.getloadavg()[0]:.1f}"
    )
    console.print(_memories(series))
    console.print(_latencies(statuses))
    sys.exit(code)


def _memories(series: dict[str, tuple[Series, Series]]) -> Table:
    table = Table(
        "process",
        "allocated [MiB]",
        "an hour: all, 2nd half",
        "own [MiB]",
        "an hour: all, 2nd half",
    )
    for name, kinds in series.items():
        if kinds[0][1]:
            table.add_row(
                name,
                *(
                    c
                    for kind in kinds
                    for c in (f"{kind[1][0]:.1f} to {kind[1][-1]:.1f}", _slopes(kind))
                ),
            )
    return table


def _latencies(statuses: dict[int, list[dict[str, Any]]]) -> Table:
    """Ticks' lateness is over all ticks so far: it rises where the last ones are later than those
    before."""
    table = Table(
        "agent",
        "ticks late p99 [ms]",
        "an hour",
        "overruns",
        "oldest news [ms]",
        "an hour",
        "vehicle [ms]",
        "an hour",
    )
    for agent, lines in sorted(statuses.items()):
        times_s = [line["time_s"] for line in lines]
        late = [line["tick"]["late_p99_ms"] for line in lines]
        ages = [
            1000 * max(link["age_s"] or 0.0 for link in line["links"].values()) for line in lines
        ]
        trips = [1000 * (line["vehicle_link"]["round_trip_s"] or 0.0) for line in lines]
        overruns = lines[-1]["tick"]["overruns"] - lines[0]["tick"]["overruns"]
        table.add_row(
            str(agent),
            f"{late[0]:.2f} to {late[-1]:.2f}",
            _slopes((times_s, late)),
            str(overruns),
            f"{np.median(ages):.0f}",
            _slopes((times_s, ages)),
            f"{np.median(trips):.1f}",
            _slopes((times_s, trips)),
        )
    return table


if __name__ == "__main__":
    main()
