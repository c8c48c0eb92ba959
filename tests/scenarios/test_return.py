"""Every agent of every grid comes home by `return`: by the simulator's truth, near its own start,
with no pair under r_in unless `validate` warned of it, all at once, and in bounded time."""

from __future__ import annotations

import math
import random

import pytest

from swarm_ctl.core.model.messages import Outcome
from swarm_ctl.core.model.vehicle import MISPLACED_M
from swarm_ctl.mission.compile.loader import loads
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm
from tests.on_demand import on_demand
from tests.scenarios.swarm import landing_fast
from tests.unit.plans import steps_of

HEAD = """\
version: 1
name: home
origin: {lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}
unit_m: 5
tick_s: 0.1
law: {r: 4.5, r_out: 1.5, r_in: 0.5}
"""


def mission(starts: list[tuple[float, float]], steps: list[str], more: str = "") -> str:
    agents = "".join(f"  - {{id: {k}, start: [{n}, {e}]}}\n" for k, (n, e) in enumerate(starts, 1))
    shapes = f"shapes:\n  row: {{kind: line, count: {len(starts)}, spacing: 2}}\n"
    listed = "".join(f"  - {step}\n" for step in steps)
    return f"{HEAD}agents:\n{agents}{shapes}steps:\n{listed}{more}"


def grid(count: int, spacing: float) -> list[tuple[float, float]]:
    side = math.ceil(math.sqrt(count))
    return [(round(spacing * (k // side), 3), round(spacing * (k % side), 3)) for k in range(count)]


def flown_home(
    text: str, seed: int, within_s: float, least: float = 1.0, *, fast: bool = True
) -> None:
    """The return lasts so long at most [s]; all of the property is checked on the way. `least` [of
    r_in]: less than 1 where `validate` has warned of the starts. `fast`: vehicles touch down so."""
    loaded = loads(text)
    plan = loaded.plan
    swarm, begun_s = VirtualSwarm(loaded, seed), math.inf
    if fast:
        landing_fast(swarm)
    while any(member.alive for member in swarm.members.values()):
        swarm.tick()
        steps = [member.status.step for member in swarm.members.values() if member.status]
        if math.isinf(begun_s) and max(steps, default=0) == len(steps_of(plan)):
            begun_s = swarm.now
        assert swarm.now - (0.0 if math.isinf(begun_s) else begun_s) < within_s + 300.0
    assert swarm.all_down
    assert set(swarm.outcomes().values()) == {Outcome.COMPLETED}
    warned = any("and as they land there" in str(warning) for warning in loaded.warnings)
    assert warned or least == 1.0
    closest_m = min(swarm.minimum.values(), default=math.inf)
    assert closest_m >= least * plan.law.r_in * plan.unit_m
    at = swarm.positions()
    for agent in plan.agents:
        home = [c * plan.unit_m for c in agent.start]
        assert math.dist(at[agent.id], home) < MISPLACED_M, f"agent {agent.id}"
    assert swarm.now - begun_s < within_s


TAKE_OFF = ["takeoff: {height_m: 5}", "form: {shape: row}"]


def test_a_square_comes_home_from_afar() -> None:
    """One of four was stranded 15 m from its start: it kept clear of those that had landed."""
    steps = [*TAKE_OFF, "move: {to: [-6, -6]}", "return"]
    flown_home(mission(grid(4, 1.8), steps), 1, 90.0)


def test_starts_closer_than_the_filter_s_distance_are_all_come_home_to() -> None:
    """3 m apart, r_in 2.5 m: one after the other goes down."""
    flown_home(mission(grid(4, 0.6), [*TAKE_OFF, "return"]), 1, 100.0)


def test_five_in_a_row_are_home_in_50_s() -> None:
    """One by one, from farther away, it took 118 s."""
    starts = [(0.0, 3.0 * k) for k in range(5)]
    flown_home(mission(starts, [*TAKE_OFF, "move: {by: [5, 0]}", "return"]), 1, 50.0)


def drawn(seed: int) -> str:
    """Any grid, moved and turned, with either autopilot, in fair weather or wind."""
    rng = random.Random(seed)
    count = rng.randint(2, 9)
    steps = [f"takeoff: {{height_m: {rng.choice([2.5, 4, 5, 10])}}}", "form: {shape: row}"]
    for _ in range(rng.randint(0, 2)):
        north, east = rng.randint(-12, 12), rng.randint(-12, 12)
        turn = rng.choice([90, 180, -135])
        steps.append(
            rng.choice([f"move: {{by: [{north}, {east}]}}", f"rotate: {{angle_deg: {turn}}}"])
        )
    kinds = [rng.choice(["ardupilot", "px4"]) for _ in range(count)]
    more = "fleet:\n  agents:\n" + "".join(
        f"    - {{id: {k}, sysid: {k}, autopilot: {kind}}}\n" for k, kind in enumerate(kinds, 1)
    )
    if rng.random() < 0.4:
        more += "simulation: {parameters: {SIM_WIND_SPD: 4, SIM_WIND_DIR: 200}}\n"
    return mission(grid(count, round(rng.uniform(0.6, 2.8), 2)), [*steps, "return"], more)


TOO_CLOSE = {23: 0.85, 35: 0.79, 53: 0.88, 75: 0.87, 90: 0.94}
"""[of r_in] By seed: so near pairs come, of starts that `validate` warns of."""
DAILY = (1, 29)
"""Of four and three; one is turned, in wind, and one is moved, each with both autopilots."""


@pytest.mark.parametrize(
    "seed", [seed if seed in DAILY else on_demand(seed) for seed in range(100)]
)
def test_all_come_home(seed: int) -> None:
    flown_home(drawn(seed), seed, 240.0, TOO_CLOSE.get(seed, 1.0), fast=False)


@pytest.mark.parametrize("seed", [0, on_demand(2)])
def test_px4s_that_land_as_they_pass_each_other_make_room_first(seed: int) -> None:
    """Small units: they came within 1.19 and 1.50 m, r_in 1.75 m."""
    text = f"""{HEAD.replace("unit_m: 5", "unit_m: 2.5").replace("tick_s: 0.1", "tick_s: 0.05")}"""
    text = text.replace("{r: 4.5, r_out: 1.5, r_in: 0.5}", "{r: 10, r_out: 1.5, r_in: 0.7}")
    corners = [(0, 0), (6, 6), (0, 6), (6, 0)]
    text += "agents:\n" + "".join(
        f"  - {{id: {k}, start: [{n}, {e}]}}\n" for k, (n, e) in enumerate(corners, 1)
    )
    text += "shapes:\n  swap: {kind: offsets, offsets: [[6, 6], [0, 0], [6, 0], [0, 6]]}\n"
    text += (
        "steps:\n  - takeoff: {height_m: 5}\n"
        "  - form: {shape: swap, slots: fixed, exchange: false}\n  - land\nfleet:\n  agents:\n"
    )
    text += "".join(f"    - {{id: {k}, sysid: {k}, autopilot: px4}}\n" for k in range(1, 5))
    swarm = VirtualSwarm(loads(text), seed)
    swarm.wait(lambda s: any(m.status and m.status.step >= 2 for m in s.members.values()))
    swarm.run(PASSING_S[seed])
    swarm.command("land")
    swarm.fly(300)
    assert swarm.all_down
    assert swarm.closest_m > 1.75


PASSING_S = {0: 7.78, 2: 8.61}
"""After so long in the step, with this seed, they are closest."""
