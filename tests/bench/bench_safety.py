"""What the safety filter costs an agent, and what each part of the safety brings.

    python -m tests.bench.bench_safety [--missions 100] [--processes 2]

1. Cost: a whole swarm of 32 on the virtual clock while it forms; the filter's share of the agents'
   ticks, in one run.
2. The same missions flown in each way: the law alone and with each part of the safety switched on
   in turn, at the largest gains that `validate` takes without a warning (kappa * h: 1 a second, 4
   with the dead-lock release, 0.05 on positions). All have the same vehicles (lag 0.3 to 0.6 s,
   dead time 0.2 to 0.5 s, 2.8 m/s2, 5 m/s; model: the middle) and hear of each other alike (up to
   0.2 s late, up to 20 % lost).

Arrived: all within 0.5 m of the shape for 1 s. Shares with exact 95 %
intervals.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from swarm_ctl.core.agent.agent import Agent
from swarm_ctl.core.model.arrays import Floats
from swarm_ctl.core.model.plan import Compensation
from swarm_ctl.core.safety.safety_filter import SafetyFilter
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.study.batch.batch import Batch, draw
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.parameter_space import SafetyLevel, StartKind, Study
from swarm_ctl.study.rows_table import share
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm

MISSION = Path(__file__).parents[2] / "missions" / "thirtytwo.yaml"
LIMIT_S: Final = 120.0
SCENARIOS: Final[tuple[tuple[StartKind, int], ...]] = (
    *(("crossing", 8), ("crossing", 24), ("antipodal", 6), ("antipodal", 12)),
    *(("random", 8), ("random", 24)),
)


class Timed:
    """Counts and times the calls of one method."""

    def __init__(self, owner: type, name: str) -> None:
        self.each: list[float] = []
        inner = getattr(owner, name)

        def timed(*args: Any, **kwargs: Any) -> Any:
            begun = time.perf_counter()
            try:
                return inner(*args, **kwargs)
            finally:
                self.each.append(time.perf_counter() - begun)

        setattr(owner, name, timed)


def cost(console: Console) -> None:
    """The filter's share of an agent's tick at 32 agents."""
    filter_ = Timed(SafetyFilter, "velocity")
    step = Timed(Agent, "step")
    swarm = VirtualSwarm(load(MISSION), 1)
    while not all(m.status and m.status.step == 2 for m in swarm.members.values()):
        swarm.tick()
    for timed in (filter_, step):
        timed.each.clear()
    for _ in range(120):
        swarm.tick()
    ticks = np.array(step.each) * 1e6
    spent = sum(filter_.each) * 1e6
    console.print(
        f"agent's tick at 32 agents: p50 {np.percentile(ticks, 50):.0f}, "
        f"p99 {np.percentile(ticks, 99):.0f} us;"
        f" the filter: {spent / len(ticks):.0f} us a tick, {100 * spent / ticks.sum():.1f} % of it"
    )


def scenario(start: StartKind, n: int, missions: int) -> Batch:
    """Goals opposite the starts, or a grid in random order among random starts."""
    study = Study.model_validate(
        {
            "n": (n,),
            "start": (start,),
            "slots": ("random" if start == "random" else "given",),
            "shape": ("grid",),
            "missions": missions,
            "limit_s": LIMIT_S,
            "start_spacing": 1.5,
            "lag_s": ("0.3:0.6",),
            "dead_time_s": ("0.2:0.5",),
            "delay_s": ("0:0.2",),
            "loss": ("0:0.2",),
        }
    )
    (cell,) = study.cells()
    return draw(cell, 0, missions)


class Flown(NamedTuple):
    """Smallest distances [units], times of arrival [s], infinite without; (m,)."""

    smallest: Floats
    time_s: Floats


@dataclass(frozen=True)
class Law:
    """The formation law under a level of safety."""

    safety: SafetyLevel
    rate: float
    """kappa * h [1/s]."""
    compensation: Compensation = Compensation.STOP_POINT

    def fly(self, batch: Batch) -> Flown:
        changes = {"safety": self.safety, "compensation": self.compensation}
        cell = batch.cell.model_copy(update=changes)
        flown = fly(replace(batch, cell=cell, h=self.rate / batch.kappa))
        return Flown(flown.smallest, np.where(flown.converged, flown.time_s, np.inf))


WAYS: Final[dict[str, Law]] = {
    "law on positions": Law("off", 0.05, Compensation.NONE),
    "law": Law("off", 1.0),
    "+ filter": Law("filter", 1.0),
    "+ guard": Law("guard", 1.0),
    "+ release, same gain": Law("release", 1.0),
    "+ release": Law("release", 4.0),
    "+ align (what agents fly)": Law("align", 4.0),
    "+ exchange": Law("exchange", 4.0),
}


def flight(task: tuple[StartKind, int, int, str]) -> Flown:
    """One scenario in one way."""
    start, n, missions, way = task
    return WAYS[way].fly(scenario(start, n, missions))


def compare(console: Console, missions: int, processes: int) -> None:
    """The same missions flown in each way."""
    tasks = [(start, n, missions, way) for start, n in SCENARIOS for way in WAYS]
    title = f"{missions} missions each; shares with 95 % intervals"
    names = ("scenario", "way", "under r_in 0.5", "smallest", "arrived", "median s", "p95 s")
    table = Table(*names, title=title)
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for (start, n, _, way), flown in zip(tasks, pool.imap(flight, tasks), strict=True):
            arrived = flown.time_s[np.isfinite(flown.time_s)]
            table.add_row(
                f"{start}, n = {n}" if way == next(iter(WAYS)) else "",
                way,
                share(int((flown.smallest < 0.5).sum()), missions),
                f"{flown.smallest.min():.3f}",
                share(len(arrived), missions),
                *(f"{np.percentile(arrived, q):.1f}" if len(arrived) else "-" for q in (50, 95)),
                end_section=way == tuple(WAYS)[-1],
            )
    console.print(table)


def main() -> None:
    """Both parts."""
    arguments = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    arguments.add_argument("--missions", type=int, default=100)
    arguments.add_argument("--processes", type=int, default=2)
    asked = arguments.parse_args()
    console = Console(highlight=False, width=140)
    cost(console)
    compare(console, asked.missions, asked.processes)


if __name__ == "__main__":
    main()
