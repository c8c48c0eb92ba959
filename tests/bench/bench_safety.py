"""What the safety filter costs an agent, and how it flies beside other ways to keep apart.

    python -m tests.bench.bench_safety [--missions 100] [--processes 2]

1. Cost: a whole swarm of 32 on the virtual clock while it forms; the filter's share of the agents'
   ticks, in one run.
2. The same missions flown in each way: the law alone and with each part of the safety switched on
   in turn, at the largest gains that `validate` takes without a warning (kappa * h: 1 a second, 4
   with the dead-lock release, 0.05 on positions); ORCA (van den Berg et al. 2011, horizon 4 s,
   keep-out distance of the filter) and a potential field (Khatib 1986), on positions and on stop
   points. All have the same vehicles (lag 0.3 to 0.6 s, dead time 0.2 to 0.5 s, 2.8 m/s2, 5 m/s;
   model: the middle) and hear of each other alike (up to 0.2 s late, up to 20 % lost). ORCA and the
   field are given more: the goal of each agent as a point, while the law only knows the shape.

Arrived: all within 0.5 m of the goals, or of the shape, for 1 s. Shares with 95 % intervals
(Wilson).
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from swarm_ctl.core.agent.agent import Agent
from swarm_ctl.core.model.arrays import Floats
from swarm_ctl.core.model.plan import Compensation
from swarm_ctl.core.model.timeouts import PREDICT_S
from swarm_ctl.core.safety.safety_filter import SafetyFilter
from swarm_ctl.core.safety.velocity_qp import relaxed_many
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.study.batch.batch import Batch, draw
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.batch.lossy_channel import LossyChannel
from swarm_ctl.study.batch.motion import motion_of
from swarm_ctl.study.parameter_space import SafetyLevel, StartKind, Study
from swarm_ctl.study.rows_table import share
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm

MISSION = Path(__file__).parents[2] / "missions" / "thirtytwo.yaml"
LIMIT_S, TOLERANCE, SETTLE_S, HORIZON_S = 120.0, 0.1, 1.0, 4.0
REACH: Final = 0.85
"""The filter's keep-out distance [units] at r_in 0.5 and r_out 1.5."""
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


class Others(NamedTuple):
    """What each agent knows: its own point and velocity (2, n, m), and those of the others as it
    has heard of them and carried them on (2, n, n, m). Units, units a second."""

    own: Floats
    velocity: Floats
    points: Floats
    velocities: Floats


Rule = Callable[[Others, Floats, float, float], Floats]
"""From what agents know, the velocity towards the goal that each would like, the speed limit and
the length of a tick to the velocities that they fly, (2, n, m)."""


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


@dataclass(frozen=True)
class Beside:
    """Another rule, on stop points and the others' setpoints or on positions and velocities."""

    rule: Rule
    stop_points: bool
    rate: float
    """[1/s] How fast a goal pulls; faster ones overshoot."""

    def fly(self, batch: Batch) -> Flown:
        motion, cell = motion_of(batch), batch.cell
        channel, tick_s = LossyChannel(batch, cell.tick_s), cell.tick_s
        middle = batch.starts.mean(axis=1, keepdims=True)
        goals = batch.slots - batch.slots.mean(axis=1, keepdims=True) + middle
        speed, everyone = cell.speed_mps / cell.unit_m, (2, cell.n, cell.n, len(batch))
        smallest, since = np.full(len(batch), np.inf), np.full(len(batch), np.inf)
        before = motion.position
        for tick in range(round(LIMIT_S / tick_s) + 1):
            position = motion.position
            smallest = np.minimum(smallest, nearest(before, position))
            there = (np.sqrt(((position - goals) ** 2).sum(axis=0)) < TOLERANCE).all(axis=0)
            since = np.where(there, np.minimum(since, tick * tick_s), np.inf)
            if (tick * tick_s - since >= SETTLE_S).all():
                break
            own, velocity = position, (position - before) / tick_s
            if self.stop_points:
                own, velocity = motion.points(), motion.velocity
            before = position
            heard = channel.exchange(tick, own, velocity)
            points = np.broadcast_to(heard.carried(PREDICT_S), everyone)
            known = Others(own, velocity, points, np.broadcast_to(heard.velocity, everyone))
            wish = shortened(self.rate * (goals - own), speed)
            motion.move(self.rule(known, wish, speed, tick_s))
        return Flown(smallest, since)


def nearest(before: Floats, now: Floats) -> Floats:
    """The smallest distance of any two (m,) on straight ways from `before` to `now` (2, n, m)."""
    first, second = np.triu_indices(before.shape[1], 1)
    gap = before[:, first] - before[:, second]
    way = now[:, first] - now[:, second] - gap
    length = np.maximum((way * way).sum(axis=0), 1e-300)
    gap = gap + np.clip(-(gap * way).sum(axis=0) / length, 0.0, 1.0) * way
    return np.asarray(np.sqrt((gap * gap).sum(axis=0).min(axis=0)))


def shortened(velocity: Floats, speed: float) -> Floats:
    """At most this fast."""
    return np.asarray(velocity * (speed / np.maximum(np.sqrt((velocity**2).sum(axis=0)), speed)))


def potential(known: Others, wish: Floats, speed: float, _tick_s: float) -> Floats:
    """Khatib's field: pulled by the goal, pushed by all agents within r_out 1.5."""
    q = known.own[:, :, None] - known.points
    x = np.maximum(np.sqrt((q**2).sum(axis=0)), 1e-6)
    near = (x < 1.5) & ~np.eye(x.shape[0], dtype=bool)[..., None]
    push = np.where(near, (1 / x - 1 / 1.5) / x**2, 0.0)
    return shortened(wish + 0.5 * (push * q / x).sum(axis=2), speed)


def orca(known: Others, wish: Floats, speed: float, tick_s: float) -> Floats:
    """Optimal reciprocal collision avoidance, radius D / 2 each."""
    _, n, m = wish.shape
    agents, own_velocity = np.arange(n), known.velocity.reshape(2, -1)
    normals, bounds = np.zeros((n - 1, 2, n * m)), np.zeros((n - 1, n * m))
    for k in range(1, n):
        other = (agents + k) % n
        gap = (known.points[:, agents, other] - known.own).reshape(2, -1)
        relative = own_velocity - known.velocities[:, agents, other].reshape(2, -1)
        u, normal = velocity_obstacle(gap, relative, REACH, tick_s)
        normals[k - 1], bounds[k - 1] = normal, (normal * (own_velocity + 0.5 * u)).sum(axis=0)
    soft = np.zeros(bounds.shape, dtype=bool)
    top = np.full(n * m, speed)
    flown, _ = relaxed_many(wish.reshape(2, -1), normals, bounds, soft, top)
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


WAYS: Final[dict[str, Law | Beside]] = {
    "law on positions": Law("off", 0.05, Compensation.NONE),
    "law": Law("off", 1.0),
    "+ filter": Law("filter", 1.0),
    "+ guard": Law("guard", 1.0),
    "+ release, same gain": Law("release", 1.0),
    "+ release": Law("release", 4.0),
    "+ align (what agents fly)": Law("align", 4.0),
    "+ exchange": Law("exchange", 4.0),
    "ORCA on positions": Beside(orca, False, 1.0),
    "ORCA on stop points": Beside(orca, True, 4.0),
    "potential field, positions": Beside(potential, False, 1.0),
    "potential field, stop points": Beside(potential, True, 4.0),
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
