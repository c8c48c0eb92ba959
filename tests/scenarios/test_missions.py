"""Every ready mission flies to its end, apart, and as long as `validate` says; from its own starts
and from others."""

from __future__ import annotations

import json
import math
import random
from pathlib import Path

import pytest

from swarm_ctl.core.law import graph
from swarm_ctl.mission.compile.forecast import forecast
from swarm_ctl.mission.compile.loader import LoadedMission, dumps, load, loads
from swarm_ctl.mission.input.units import metres
from swarm_ctl.mission.mission_file import json_schema
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm
from tests.on_demand import on_demand
from tests.scenarios.swarm import at_half_rate, landing_fast, low_hexagon
from tests.scenarios.watched import Watch

FOLDER = Path(__file__).parents[2] / "missions"
MISSIONS = sorted(path.name for path in FOLDER.glob("*.yaml"))
DAILY = "crossing.yaml"
"""At half the rate; at its own, golden traces fly it. The others are large, long, or with the steps
of others alone; the hexagon is what the tests of attacks and of forged words fly to its end."""
HURT = {"faults": {2: "failed"}}
"""Who does not complete, by mission: its own timetable drains its battery."""
FACTOR = 1.5
TRUE_ALARMS = {
    "faults": [
        ("not believed", (6,)),  # a GPS that jumps
        ("holding", (6,)),
        ("failed", (2,)),  # a battery
    ]
}
"""An alarm that a correct mission raises is a defect: these are of the timetable of faults."""


def assert_flown(swarm: VirtualSwarm) -> None:
    """To the end, completed by all that can; no two vehicles under r_in, all down."""
    completed = dict.fromkeys((agent.id for agent in swarm.plan.agents), "completed")
    assert swarm.outcomes() == completed | HURT.get(swarm.plan.name, {})
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m
    assert swarm.all_down


@pytest.mark.timeout(1800)  # a hundred agents take about 450 s of CPU time
@pytest.mark.parametrize("name", [name if name == DAILY else on_demand(name) for name in MISSIONS])
def test_ready_mission(name: str) -> None:
    """Each step takes what was forecast, within a factor of 1.5; a station that watches raises no
    alarm but the true ones."""
    mission = loads(at_half_rate(name), name) if name == DAILY else load(FOLDER / name)
    watch = Watch(VirtualSwarm(mission))
    watch.fly()
    swarm = watch.swarm
    assert_flown(swarm)
    assert watch.raised == TRUE_ALARMS.get(mission.plan.name, [])
    assert watch.banners[-1][2] == "all agents have ended, and say: completed" or watch.raised
    whole = {i: m for i, m in swarm.members.items() if m.ended and m.ended.outcome == "completed"}
    behind, forecasts = dict.fromkeys(whole, 0), iter(forecast(mission.plan))
    for group in mission.plan.groups:
        members = [i for i in group.members if i in whole]
        for number, step in enumerate(group.steps, start=1):
            expected = next(forecasts)
            results = [m.steps[behind[i] + number] for i in members if (m := whole[i].status)]
            took_s = max(r.end_s or math.inf for r in results) - min(r.start_s for r in results)
            assert expected.expected_s is not None
            least_s, most_s = expected.expected_s / FACTOR, expected.expected_s * FACTOR
            # a barrier is as long as others take
            assert step.barrier or least_s < took_s < most_s, (group.name, number, results[0].name)
        behind |= {i: behind[i] + len(group.steps) for i in members}
    assert next(forecasts, None) is None


def scattered(mission: LoadedMission, seed: int) -> LoadedMission:
    """The mission from random starts: pairwise r_out apart, as far from zones, and connected."""
    dice, law, count = random.Random(seed), mission.file.law, len(mission.file.agents)
    zones, unit_m = mission.plan.zones, metres(mission.file)
    walls = [(n / unit_m, e / unit_m) for zone in zones for n, e in zone.outline_m]
    side = law.r_out * 1.9 * math.sqrt(count)
    while True:
        points: list[tuple[float, float]] = []
        for _ in range(5000):
            point = (round(dice.uniform(0, side), 3), round(dice.uniform(0, side), 3))
            near = (math.dist(point, other) <= law.r_out for other in (*points, *walls))
            if len(points) < count and not any(near):
                points.append(point)
        parts = graph.components(graph.neighbours(dict(enumerate(points)), law.r))
        if len(points) == count and len(parts) == 1:
            break
        side *= 1.02
    agents = tuple(
        a.model_copy(update={"start": p}) for a, p in zip(mission.file.agents, points, strict=True)
    )
    return loads(dumps(mission.file.model_copy(update={"agents": agents})), mission.source.name)


def test_from_a_random_start() -> None:
    """One of those below, for every day: low, and at half the rate."""
    fly_scattered(low_hexagon(), 1)


@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("name", [name for name in MISSIONS if name != "hundred.yaml"])
def test_from_random_starts(name: str, seed: int) -> None:
    """Twenty of them; a hundred agents take minutes for one."""
    fly_scattered(load(FOLDER / name), seed)


def fly_scattered(mission: LoadedMission, seed: int) -> None:
    swarm = landing_fast(VirtualSwarm(scattered(mission, seed), seed))
    swarm.fly(1500)
    assert_flown(swarm)


@pytest.mark.parametrize("name", MISSIONS)
def test_a_mission_can_be_written_again(name: str) -> None:
    """Round trip: the same plan."""
    mission = load(FOLDER / name)
    assert loads(dumps(mission.file), name).plan == mission.plan


def test_the_schema_beside_the_missions_is_the_one_of_the_program() -> None:
    """`swarm-ctl schema > missions/mission.schema.json`; each mission names it."""
    assert json.loads((FOLDER / "mission.schema.json").read_text()) == json_schema()
    for name in MISSIONS:
        assert (
            (FOLDER / name)
            .read_text()
            .startswith("# yaml-language-server: $schema=mission.schema.json\n")
        )
