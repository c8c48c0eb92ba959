"""Drawn missions of three groups of four, with losses, orders, and agents that leave and come back:
nobody waits for ever, nobody comes under r_in, and who completes has done all of its steps."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
import pytest

from swarm_ctl.core.model.messages import Outcome
from swarm_ctl.core.model.steps.goto import GotoStep
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from swarm_ctl.virtual.scenario_flight import longest_s
from tests.on_demand import on_demand
from tests.scenarios.swarm import VirtualSwarm, at_half_rate, landing_fast, ready

HEAD: Final = """\
version: 1
name: drawn
origin: {lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}
lengths: metres
tick_s: 0.1
law: {r: 60, r_out: 7.5, r_in: 2.5}
agents:
"""
SHAPES: Final = """\
shapes:
  row: {kind: line, spacing: 9}
  ring: {kind: ring, side: 10}
  grid: {kind: grid, spacing: 10}
"""
NAMES: Final = ("a", "b", "c")


def drawn(dice: np.random.Generator) -> LoadedMission:
    """Twelve agents in three groups by lot; one may keep out of all groups."""
    ids = [int(i) for i in dice.permutation(12) + 1]
    waiting = ids[0] if dice.random() < 0.3 else 0
    lines = []
    for k in range(12):
        waits = ", waits: true" if k + 1 == waiting else ""
        lines.append(f"  - {{id: {k + 1}, start: [{k // 4 * 10}, {k % 4 * 10}]{waits}}}\n")
    size = 4 if dice.random() < 0.6 else 3
    groups = {name: sorted(ids[k * size : (k + 1) * size]) for k, name in enumerate(NAMES)}
    barrier = set(dice.choice(NAMES, 2, replace=False)) if dice.random() < 0.5 else set()
    lands = str(dice.choice(NAMES)) if dice.random() < 0.3 else ""
    text = HEAD + "".join(lines)
    text += f"policies: {{agent_lost: {dice.choice(['continue', 'land'], p=[0.7, 0.3])}}}\n"
    text += "groups:\n" + "".join(f"  {name}: {of}\n" for name, of in groups.items()) + SHAPES
    gap = ", on_gap: close" if dice.random() < 0.5 else ""
    text += f"steps:\n  - takeoff: {{height_m: 4}}\n  - form: {{shape: grid, settle_s: 1{gap}}}\n"
    text += "  - split:\n"
    for k, name in enumerate(NAMES):
        text += f"      {name}:\n"
        steps = [f"move: {{by: [{dice.integers(-15, 40)}, {40 * (k - 1)}], speed_mps: 4}}"]
        if dice.random() < 0.7:
            shape = dice.choice(["row", "ring"])
            steps.insert(int(dice.integers(0, 2)), f"form: {{shape: {shape}, settle_s: 1{gap}}}")
        if dice.random() < 0.5:
            steps.append(f"hold: {{duration_s: {dice.integers(2, 20)}}}")
        if name in barrier:
            steps.insert(int(dice.integers(1, len(steps) + 1)), "barrier: {name: meet}")
        if name == lands:
            steps.append("return")
        text += "".join(f"        - {step}\n" for step in steps)
    return loads(f"{text}  - form: {{shape: ring, settle_s: 1{gap}}}\n  - return\n")


def happenings(
    dice: np.random.Generator, mission: LoadedMission
) -> tuple[list[tuple[float, Callable[[VirtualSwarm], None]]], set[int]]:
    """What happens, at which time, and which agents die."""
    found, dead = list[tuple[float, Callable[[VirtualSwarm], None]]](), set[int]()
    for k in range(int(dice.integers(0, 4))):
        at_s, agent = float(dice.uniform(10.0, 90.0)), int(dice.integers(1, 13))
        group = mission.plan.groups[int(dice.integers(1, 4))].ids
        place = (float(dice.uniform(-60, -30)), float(dice.uniform(-30, 60)))
        match str(dice.choice(["die", "die all", "goto", "hold", "land", "launch"])):
            case "die":
                found.append((at_s, lambda s, i=agent: s.kill(i)))  # type: ignore[misc]
                dead.add(agent)
            case "die all":
                found += [(at_s, lambda s, i=i: s.kill(i)) for i in group]  # type: ignore[misc]
                dead.update(group)
            case "goto":
                step = GotoStep(((agent, place),), 4.0, 1e9)
                found.append((at_s, _order("goto", (agent,), f"g{k}", step=step)))
                if dice.random() < 0.7:
                    found.append((at_s + 20.0, _order("resume", (agent,), f"b{k}")))
            case "hold":
                found.append((at_s, _order("hold", group, f"h{k}")))
                found.append((at_s + 15.0, _order("resume", group, f"r{k}")))
            case "land":
                found.append((at_s, _order("land", (agent,), f"l{k}")))
            case _:
                ids = tuple(a.id for a in mission.plan.agents if a.waits)
                if ids:
                    found.append((at_s, _order("launch", ids, f"u{k}")))
    return sorted(found, key=lambda each: each[0]), dead


def _order(
    kind: str, agents: tuple[int, ...], name: str, **more: object
) -> Callable[[VirtualSwarm], None]:
    return lambda swarm: swarm.command(kind, agents, name=name, **more)


@pytest.mark.parametrize("seed", [1, *map(on_demand, range(2, 101))])
def test_a_drawn_mission_of_groups_ends_and_keeps_apart(seed: int) -> None:
    """Its bound is the sum of its waits. Two dead agents that stand in the air are no pair."""
    dice = np.random.default_rng(seed)
    mission = drawn(dice)
    swarm = landing_fast(VirtualSwarm(mission, seed))
    due, dead = happenings(dice, mission)
    bound_s = longest_s(mission.plan)
    while swarm.now < bound_s and any(m.alive for m in swarm.members.values()):
        while due and swarm.now >= due[0][0]:
            _, do = due.pop(0)
            do(swarm)
        swarm.tick()
    assert swarm.now < bound_s
    ids = [agent.id for agent in mission.plan.agents]
    pairs = {(ids[i], ids[j]): apart for (i, j), apart in swarm.minimum.items() if apart < math.inf}
    live = {pair: apart for pair, apart in pairs.items() if not dead.issuperset(pair)}
    assert min(live.values()) > 2.5, min(live.items(), key=lambda each: each[1])
    outcomes = swarm.outcomes()
    assert set(outcomes) | dead >= set(ids)
    for agent, outcome in outcomes.items():
        status = swarm.members[agent].status
        assert status is not None
        assert outcome in (Outcome.COMPLETED, Outcome.ABORTED, Outcome.FAILED)
        waited = mission.plan.agent(agent).waits and len(status.steps) == 1
        if outcome == Outcome.COMPLETED and not waited:
            assert len(status.steps) == len(mission.plan.steps_of(agent)) + 1
        if outcome != Outcome.COMPLETED:
            assert status.reason


@pytest.mark.parametrize(
    ("ready", "seed"), [on_demand(at_half_rate, 1), *(on_demand(ready, s) for s in range(1, 21))]
)
def test_the_ready_mission_of_groups(ready: Callable[[str], str], seed: int) -> None:
    """All steps of all groups, by twenty seeds."""
    mission = loads(ready("groups.yaml"))
    swarm = landing_fast(VirtualSwarm(mission, seed))
    swarm.fly()
    assert set(swarm.outcomes().values()) == {Outcome.COMPLETED}
    assert swarm.closest_m > 2.5
    assert swarm.all_down
