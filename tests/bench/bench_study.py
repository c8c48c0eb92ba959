"""How many missions a study flies in a second: the README's mix, 2 to 16 agents and 2 to 50.

    python -m tests.bench.bench_study [--missions 100] [--processes 2] [--seed 1]

Each mix is all combinations of two kinds of starts and two of slots, `--missions` of each (a tenth
of that for 2 to 50 agents). Processor time counts what all processes used, so that other work on
the machine disturbs it less than the wall clock.
"""

from __future__ import annotations

import argparse
import io
import os
import tempfile
import time
from pathlib import Path

from rich.console import Console

from swarm_ctl.study.executor import run_study
from swarm_ctl.study.parameter_space import Range, Study, value


def mix(largest: int, missions: int, seed: int) -> Study:
    """The README's mix for 2 to `largest` agents."""

    def drawn(low: float, high: float) -> tuple[Range, ...]:
        return (Range(low=low, high=high),)

    return Study(
        n=tuple(range(2, largest + 1)),
        start=("random", "crossing"),
        slots=("given", "nearest"),
        h=value(0.2),
        delay_s=drawn(0.0, 0.2),
        loss=drawn(0.0, 0.2),
        lag_s=drawn(0.3, 0.6),
        dead_time_s=drawn(0.2, 0.5),
        silent=value(0.2),
        start_spacing=1.5,
        missions=missions,
        seed=seed,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--missions", type=int, default=100)
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    for largest, missions in ((16, given.missions), (50, max(1, given.missions // 10))):
        study = mix(largest, missions, given.seed)
        wall, used = time.perf_counter(), _processor_s()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "rows.csv"
            run_study(study, path, given.processes, Console(file=io.StringIO()))
        wall, used = time.perf_counter() - wall, _processor_s() - used
        print(
            f"n = 2 to {largest}: {study.rows} missions on {given.processes} processes:"
            f" {study.rows / wall:.0f} a second, {study.rows / used:.0f} a second of one processor"
        )


def _processor_s() -> float:
    """Of this process and those that it has waited for."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


if __name__ == "__main__":
    main()
