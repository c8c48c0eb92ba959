"""How fast flights on the virtual clock are: CPU time of one core, as multiples of real time.

    python -m tests.bench.bench_virtual [--flights 3] [MISSION...]

Each mission is flown alone, as a scenario that is judged, and as one that leaves a run folder, in
turn; the best of so many flights counts, for other work on the machine only makes one slower. What
comes before a flight, loading the mission and building its parts, is told apart.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from rich.console import Console
from rich.table import Table

from swarm_ctl.mission.compile.loader import LoadedMission, load
from swarm_ctl.virtual.scenario import Scenario
from swarm_ctl.virtual.scenario_flight import ScenarioFlight
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm
from tests.bench.bench_run import ROOT

T = TypeVar("T")

_MISSIONS = (ROOT / "missions" / "hexagon.yaml", ROOT / "tests" / "scenarios" / "triangle.yaml")


def main() -> None:
    """Fly each mission in each way, and print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("missions", nargs="*", type=Path, default=_MISSIONS)
    parser.add_argument("--flights", type=int, default=3)
    arguments = parser.parse_args()
    names = ("mission", "agents", "lasts", "before it", "flown", "and judged", "with a run folder")
    table = Table(*names)
    for path in arguments.missions:
        begins_s, mission = _cpu_s(lambda path=path: load(path))
        built_s, _ = _cpu_s(lambda mission=mission: VirtualSwarm(mission, lockstep=True))
        flights = [_flights(mission) for _ in range(arguments.flights)]
        pace = [max(way) for way in zip(*(paces for _, paces in flights), strict=True)]
        lasts = f"{flights[0][0]:.1f} s"
        before = f"{1000 * (begins_s + built_s):.0f} ms"
        agents = str(len(mission.plan.agents))
        table.add_row(path.stem, agents, lasts, before, *(f"{each:.1f} x" for each in pace))
    console = Console()
    console.print(f"CPU of one core, load {os.getloadavg()[0]:.1f}")
    console.print(table)


def _flights(mission: LoadedMission) -> tuple[float, list[float]]:
    """How long the mission lasts [s], and how many times as fast as real time each way flies it."""
    alone = VirtualSwarm(mission, lockstep=True)
    alone_s, _ = _cpu_s(alone.fly)
    scenario = Scenario(version=1, mission=str(mission.source))
    judged_s, judged = _cpu_s(lambda: ScenarioFlight(scenario, mission).fly())
    with tempfile.TemporaryDirectory() as folder:
        kept_s, kept = _cpu_s(lambda: ScenarioFlight(scenario, mission, Path(folder) / "run").fly())
    return alone.now, [alone.now / alone_s, judged.end_s / judged_s, kept.end_s / kept_s]


def _cpu_s(work: Callable[[], T]) -> tuple[float, T]:
    """CPU time of this process [s], and what came of it."""
    began = time.process_time()
    result = work()
    return time.process_time() - began, result


if __name__ == "__main__":
    main()
