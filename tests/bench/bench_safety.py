"""What the safety filter costs an agent, and how it flies beside other ways to keep apart.

    python -m tests.bench.bench_safety

1. Cost: a whole swarm of 32 on the virtual clock while it forms; the filter's share of the agents'
   ticks, in one run.
2. Beside ORCA (van den Berg et al. 2011, reciprocal half-planes from velocity obstacles, horizon 4
   s) and a plain potential field, both written here, on the same scenarios, vehicles (dead time 0.4
   s, lag 0.5 s, 2.8 m/s2, 5 m/s) and fresh news: two columns that change sides, and an antipodal
   swap on a ring. Both are given what they ask for: the goal of each agent as a point, while the
   law only knows the shape. Smallest distance, time until all are within
   0.5 m of their goals (or of the shape), and missions that are not there after 120 s.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from swarm_ctl.core.agent.agent import Agent
from swarm_ctl.core.model.arrays import Floats
from swarm_ctl.core.safety.safety_filter import SafetyFilter
from swarm_ctl.core.safety.velocity_qp import relaxed_many
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.study.batch.batch import Batch, blocks, draw
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.batch.motion import motion_of
from swarm_ctl.study.parameter_space import Study, value
from swarm_ctl.testing.virtual_swarm import VirtualSwarm

MISSION = Path(__file__).parents[2] / "missions" / "thirtytwo.yaml"
LIMIT_S, TOLERANCE, HORIZON_S = 120.0, 0.1, 4.0


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


def scenario(start: str, n: int, missions: int) -> Batch:
    """Jittered starts and each agent's goal opposite."""
    study = Study(
        n=(n,),
        start=(start,),
        slots=("given",),
        shape=("grid",),
        missions=missions,
        h=value(0.2),
        limit_s=LIMIT_S,
    )
    ((cell, first, count),) = blocks(study)
    return draw(cell, first, count)


def beside(batch: Batch, rule: Any) -> tuple[Floats, Floats, Floats]:
    """Fly towards the goals by a rule: smallest distances, times, which missions arrived; (m,)."""
    motion, goals, cell = motion_of(batch), batch.slots, batch.cell
    speed, count = cell.speed_mps / cell.unit_m, len(batch)
    smallest, time_s = np.full(count, np.inf), np.full(count, np.inf)
    off_diagonal = np.where(np.eye(cell.n, dtype=bool), np.inf, 0.0)[..., None]
    for tick in range(round(LIMIT_S / cell.tick_s)):
        p = motion.position
        apart = np.sqrt(((p[:, :, None] - p[:, None]) ** 2).sum(axis=0)) + off_diagonal
        smallest = np.minimum(smallest, apart.min(axis=(0, 1)))
        there = (np.sqrt(((p - goals) ** 2).sum(axis=0)) < TOLERANCE).all(axis=0)
        time_s = np.where(there, np.minimum(time_s, tick * cell.tick_s), np.inf)
        if there.all() and tick * cell.tick_s > time_s.max() + 1.0:
            break
        motion.move(rule(p, motion.velocity, goals, speed, cell))
    return smallest, time_s, np.isfinite(time_s)


def potential(p: Floats, _v: Floats, goals: Floats, speed: float, cell: Any) -> Floats:
    """Khatib's field: pulled by the goal, pushed by all agents within r_out."""
    pull = goals - p
    pull *= speed / np.maximum(np.sqrt((pull**2).sum(axis=0)), speed)
    q = p[:, :, None] - p[:, None]
    x = np.maximum(np.sqrt((q**2).sum(axis=0)), 1e-6)
    near = (x < cell.law.r_out) & ~np.eye(cell.n, dtype=bool)[..., None]
    push = np.where(near, (1 / x - 1 / cell.law.r_out) / x**2, 0.0)
    wish: Floats = pull + 0.5 * (push * q / x).sum(axis=2)
    size = np.sqrt((wish**2).sum(axis=0))
    return np.asarray(wish * (speed / np.maximum(size, speed)))


def orca(p: Floats, v: Floats, goals: Floats, speed: float, cell: Any) -> Floats:
    """Optimal reciprocal collision avoidance, radius D / 2 each."""
    _, n, m = p.shape
    reach = 0.8
    wish = goals - p
    wish *= speed / np.maximum(np.sqrt((wish**2).sum(axis=0)), speed)
    normals, bounds = np.zeros((n - 1, 2, n * m)), np.zeros((n - 1, n * m))
    for k in range(1, n):
        other = (np.arange(n) + k) % n
        gap, relative = (p[:, other] - p).reshape(2, -1), (v - v[:, other]).reshape(2, -1)
        u, normal = velocity_obstacle(gap, relative, reach, cell.tick_s)
        normals[k - 1], bounds[k - 1] = normal, (normal * (v.reshape(2, -1) + 0.5 * u)).sum(axis=0)
    flown, _ = relaxed_many(
        wish.reshape(2, -1),
        normals,
        bounds,
        np.zeros(bounds.shape, dtype=bool),
        np.full(n * m, speed),
    )
    return flown.reshape(2, n, m)


def velocity_obstacle(
    gap: Floats, relative: Floats, reach: float, tick_s: float
) -> tuple[Floats, Floats]:
    """(u, n): the least change of the relative velocity that leaves the obstacle, and its outward
    normal (2, K)."""
    distance2 = (gap**2).sum(axis=0)
    overlap = distance2 <= reach**2
    w = relative - gap / np.where(overlap, tick_s, HORIZON_S)
    w_size = np.maximum(np.sqrt((w**2).sum(axis=0)), 1e-9)
    cut = overlap | (
        ((w * gap).sum(axis=0) < 0) & ((w * gap).sum(axis=0) ** 2 > reach**2 * w_size**2)
    )
    front = w / w_size
    u_front = (reach / np.where(overlap, tick_s, HORIZON_S) - w_size) * front
    leg = np.sqrt(np.maximum(distance2 - reach**2, 1e-9))
    left = gap[0] * w[1] - gap[1] * w[0] > 0
    along = np.where(
        left,
        np.stack((gap[0] * leg - gap[1] * reach, gap[0] * reach + gap[1] * leg)),
        -np.stack((gap[0] * leg + gap[1] * reach, -gap[0] * reach + gap[1] * leg)),
    ) / np.maximum(distance2, 1e-9)
    normal_leg = np.stack((-along[1], along[0]))
    u_leg = (relative * along).sum(axis=0) * along - relative
    return np.where(cut, u_front, u_leg), np.where(cut, front, normal_leg)


def compare(console: Console, missions: int) -> None:
    """The same starts flown four ways."""
    table = Table("scenario", "n", "by", "under r_in", "smallest", "median s", "not there")
    for start, n in (("crossing", 8), ("crossing", 24), ("antipodal", 6), ("antipodal", 12)):
        batch = scenario(start, n, missions)
        results = {
            f"law, {level}": _of(fly(batch_with(batch, level)))
            for level in ("off", "align", "exchange")
        }
        results["ORCA"] = beside(batch, orca)
        results["potential field"] = beside(batch, potential)
        for name, (smallest, time_s, there) in results.items():
            median = f"{np.median(time_s[there]):.1f}" if there.any() else "-"
            table.add_row(
                start,
                str(n),
                name,
                f"{np.count_nonzero(smallest < batch.cell.law.r_in)} of {len(batch)}",
                f"{smallest.min():.2f}",
                median,
                str(np.count_nonzero(~there)),
            )
    console.print(table)


def batch_with(batch: Batch, level: Any) -> Batch:
    """The same missions under another safety."""
    from dataclasses import replace

    return replace(batch, cell=batch.cell.model_copy(update={"safety": level}))


def _of(outcome: Any) -> tuple[Floats, Floats, Floats]:
    time_s = np.where(outcome.converged, outcome.time_s, math.inf)
    return outcome.smallest, time_s, outcome.converged


def main() -> None:
    """Both parts."""
    arguments = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    arguments.add_argument("--missions", type=int, default=60)
    console = Console(highlight=False, width=120)
    cost(console)
    compare(console, arguments.parse_args().missions)


if __name__ == "__main__":
    main()
