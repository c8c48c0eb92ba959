"""Agents that change sides in gusts and small units: by the simulator's truth no pair comes under
r_in in the gusts of which `validate` does not warn."""

from __future__ import annotations

import math
import random

import pytest

from swarm_ctl.fuzz.invariants.table import broken
from swarm_ctl.mission.checks.envelope import most_gusts_mps
from swarm_ctl.mission.compile.loader import loads
from swarm_ctl.virtual.scenario import scenario_of
from swarm_ctl.virtual.scenario_flight import fly_scenario
from tests.on_demand import on_demand


def drawn(seed: int, gusts_mps: float) -> str:
    """Of three to six on a ring, each flies to the opposite side, in a unit of 2 to 3 m."""
    draw = random.Random(seed)
    unit_m, count = draw.choice([2.0, 2.5, 3.0]), draw.choice([3, 4, 5, 6])
    r_in = round(draw.uniform(max(0.4, 1.0 / unit_m), 0.75), 2)
    radius = max(1.1, 1.92 / (2.0 * math.sin(math.pi / count)))
    turn = 2.0 * math.pi / count
    ring = [[round(radius * f(turn * k), 3) for f in (math.cos, math.sin)] for k in range(count)]
    apart = max(1.55, r_in + 4.05 / unit_m)
    kind = draw.choice(["ardupilot", "px4", "px4"])
    ids = range(1, count + 1)
    agents = [f"{{id: {k}, start: [0, {round(apart * (k - 1), 2)}]}}" for k in ids]
    return f"""\
version: 1
name: gusts
origin: {{lat_deg: 47.4, lon_deg: 8.55, alt_m: 450}}
unit_m: {unit_m}
tick_s: 0.1
law: {{r: 4.5, r_out: 1.5, r_in: {r_in}}}
agents: [{", ".join(agents)}]
shapes:
  one: {{kind: offsets, offsets: {ring}}}
  other: {{kind: offsets, offsets: {[[-north, -east] for north, east in ring]}}}
steps:
  - takeoff: {{height_m: 4}}
  - form: {{shape: one, slots: fixed, timeout_s: 90}}
  - form: {{shape: other, slots: fixed, timeout_s: 90, on_timeout: continue}}
  - land
simulation:
  parameters: {{SIM_WIND_SPD: 2, SIM_WIND_GUST: {gusts_mps}}}
fleet:
  agents: [{", ".join(f"{{id: {k}, autopilot: {kind}}}" for k in ids)}]
"""


ROWS = [seed if seed == 3 else on_demand(seed) for seed in range(20)]


@pytest.mark.parametrize("seed", ROWS)
def test_no_pair_comes_under_r_in(seed: int) -> None:
    """As hard as `validate` takes for fit, to a tenth."""
    most_mps = most_gusts_mps(loads(drawn(seed, 0.0)).plan)
    mission = drawn(seed, math.floor(10.0 * most_mps) / 10.0).replace("\n", "\n  ")
    scenario = f"version: 1\nname: gusts\nseed: {seed}\nmission:\n  {mission}"
    flown = fly_scenario(*scenario_of(scenario))
    assert broken(flown) == []
    assert flown.summary.min_distance_m is not None
    assert flown.summary.min_distance_m >= flown.mission.plan.law.r_in * flown.mission.plan.unit_m
