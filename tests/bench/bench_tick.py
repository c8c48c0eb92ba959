"""What an agent's tick costs, part by part, on the virtual clock (no sockets, no zenoh): just after
the ticks of other agents, and after other work has pushed all that it needs out of the caches.

    python -m tests.bench.bench_tick [--mission missions/hexagon.yaml] [--megabytes 0,2,64]
        [--from 20] [--seconds 5]

CPU in microseconds, median of all agents' ticks in the given time of the mission. `--megabytes` are
touched before each tick: more than a core's own cache, more than the one that cores share.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Generator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from swarm_ctl.core.agent.agent import Actions, ended
from swarm_ctl.engine.collector import collect_rarely
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.virtual.virtual_swarm import VirtualAgent, VirtualSwarm
from tests.bench.bench_run import ROOT

PARTS = {
    "vehicle: receive": ("link", "receive"),
    "vehicle: view": ("link", "view"),
    "mesh: take": ("node", "take"),
    "vehicle: pursue": ("link", "pursue"),
    "mesh: send": ("node", "send"),
}
_ALL = (*PARTS, "step")


def main() -> None:
    """Fly the same time once for each amount that is touched, and print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--mission", type=Path, default=ROOT / "missions" / "hexagon.yaml")
    parser.add_argument("--megabytes", default="0,2,64")
    parser.add_argument("--from", dest="begins_s", type=float, default=20.0)
    parser.add_argument("--seconds", type=float, default=5.0)
    arguments = parser.parse_args()
    amounts = [float(word) for word in arguments.megabytes.split(",")]
    ends_s = arguments.begins_s + arguments.seconds
    columns = [_fly(arguments.mission, arguments.begins_s, ends_s, mb) for mb in amounts]
    table = Table("us of CPU a tick", *(f"{amount:g} MB touched" for amount in amounts))
    for part in (*_ALL, "all"):
        table.add_row(part, *(f"{column[part]:.0f}" for column in columns))
    console = Console()
    console.print(f"{arguments.mission.name}, load {os.getloadavg()[0]:.1f}")
    console.print(table)


def _fly(mission: Path, begins_s: float, ends_s: float, megabytes: float) -> dict[str, float]:
    swarm = VirtualSwarm(load(mission))  # not in lockstep: one agent after the other
    collect_rarely()  # as an agent's process does
    while swarm.now < begins_s:
        swarm.tick()
    touched = np.ones(int(megabytes * 2**20 / 8))
    ticks = [_watch(member, touched) for member in swarm.members.values()]
    while swarm.now < ends_s:
        swarm.tick()
    costs = [cost for each in ticks for cost in each]
    found = {part: statistics.median(cost[part] for cost in costs) for part in _ALL}
    return found | {"all": statistics.median(sum(cost.values()) for cost in costs)}


def _watch(member: VirtualAgent, touched: Any) -> list[dict[str, float]]:
    """Measure this agent's ticks from now on: the CPU of each by part [us]."""
    ticks: list[dict[str, float]] = []

    def measured(part: str, method: Callable[..., Any], *given: Any, **named: Any) -> Any:
        if part == "vehicle: receive":  # a tick begins
            np.add(touched, 1.0, out=touched)
            ticks.append(defaultdict(float))
        began = time.thread_time_ns()
        result = method(*given, **named)
        ticks[-1][part] += (time.thread_time_ns() - began) / 1000.0
        return result

    for part, (name, method) in PARTS.items():
        owner = getattr(member, name)
        setattr(owner, method, partial(measured, part, getattr(owner, method)))
    # in one, as where each agent has a process
    stages, step = member.agent.stages, partial(measured, "step", ended)

    def in_one(*given: Any) -> Generator[None, None, Actions]:
        yield
        return step(stages(*given))

    setattr(member.agent, "stages", in_one)  # noqa: B010 - a method is not to be assigned to
    return ticks


if __name__ == "__main__":
    main()
