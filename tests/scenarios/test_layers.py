"""Flights in layers on the virtual clock: judged by truth, no pair comes closer than r_in
horizontally and `layer_m` in height at once."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from swarm_ctl.mesh import keys
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm
from tests.on_demand import on_demand
from tests.scenarios.swarm import at_half_rate, deaf, landing_fast, ready

HEAD = """\
version: 1
name: in-layers
origin: {lat_deg: -35.363262, lon_deg: 149.165237, alt_m: 584}
lengths: metres
tick_s: 0.1
law: {r: 22.5, r_out: 7.5, r_in: 2.5, kappa: 10}
"""
TWO = """\
agents: [{id: 1, start: [0, 0]}, {id: 2, start: [0, 10]}]
shapes:
  stack: {kind: offsets, offsets: [[0, 0], [0, 0]], up_m: [0, 8]}
  swapped: {kind: offsets, offsets: [[0, 0], [0, 0]], up_m: [8, 0]}
  flat: {kind: line, spacing: 10}
steps:
  - takeoff: {height_m: 6}
  - form: {shape: stack, slots: fixed, settle_s: 2, timeout_s: 60}
  - form: {shape: swapped, slots: fixed, settle_s: 2, timeout_s: 60}
  - form: {shape: flat, settle_s: 1}
  - land
"""
PILED = """\
agents: [{id: 1, start: [0, 0]}, {id: 2, start: [0, 10]}, {id: 3, start: [0, 20]}]
shapes:
  pile: {kind: offsets, offsets: [[0, 0], [0, 0], [0, 0]], up_m: [0, 8, 16]}
  flat: {kind: line, spacing: 10}
steps:
  - takeoff: {height_m: 6}
  - form: {shape: pile, slots: fixed, settle_s: 2}
  - hold: {duration_s: 30}
  - form: {shape: flat, settle_s: 1}
  - land
"""


@dataclass
class Judged:
    """What the truth of a flight says."""

    beside_m: float = math.inf
    """The closest that two in the air came horizontally, less than `layer_m` apart in height."""
    above_m: float = math.inf
    """The least difference of heights of two in the air that were under r_in horizontally."""


def flown(
    mission: LoadedMission,
    seed: int = 1,
    until: Callable[[VirtualSwarm], bool] | None = None,
    swarm: VirtualSwarm | None = None,
) -> tuple[VirtualSwarm, Judged]:
    """The swarm at its end, or `until` then."""
    swarm, found, plan = swarm or landing_fast(VirtualSwarm(mission, seed)), Judged(), mission.plan
    r_in_m = plan.law.r_in * plan.unit_m
    while swarm.now < 300 and not all(member.ended for member in swarm.members.values()):
        swarm.tick()
        up = [at for at in swarm.hub.world.positions() if at[2] < -1.0]
        for one, other in itertools.combinations(up, 2):
            beside, above = math.dist(one[:2], other[:2]), abs(one[2] - other[2])
            if above < plan.layer_m:
                found.beside_m = min(found.beside_m, beside)
            if beside < r_in_m:
                found.above_m = min(found.above_m, above)
        if until is not None and until(swarm):
            break
    return swarm, found


def kept(mission: LoadedMission, found: Judged) -> bool:
    """No pair was too near in both ways at once."""
    r_in_m = mission.plan.law.r_in * mission.plan.unit_m
    return found.beside_m >= r_in_m and found.above_m >= mission.plan.layer_m


@pytest.mark.parametrize("seed", [1, on_demand(2)])
def test_two_swap_heights_at_one_place(seed: int) -> None:
    """They stand above each other, part, pass, and stand above each other again."""
    mission = loads(HEAD + TWO)
    swarm, found = flown(mission, seed)
    assert set(swarm.outcomes().values()) == {"completed"}
    assert kept(mission, found)
    assert found.above_m < mission.plan.slot_layer_m + 2.0  # they were above each other
    assert swarm.closest_m >= 2.5  # as the swarm's own judge says


@pytest.mark.parametrize(
    ("ready", "seed"), [(at_half_rate, 1), *(on_demand(ready, seed) for seed in range(1, 21))]
)
def test_the_ready_mission_whose_layers_change_places(
    ready: Callable[[str], str], seed: int
) -> None:
    """All steps; twenty seeds with real processes: `tests/system/test_lockstep.py`, on demand."""
    mission = loads(ready("layers.yaml"))
    swarm, found = flown(mission, seed)
    assert set(swarm.outcomes().values()) == {"completed"}
    assert kept(mission, found)


def test_without_the_rule_two_swap_heights_through_each_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The test above can fail: where all pairs count as apart, the two collide."""
    monkeypatch.setattr("swarm_ctl.core.safety.safety_filter.apart_by_height", lambda *_: True)
    mission = loads(HEAD + TWO)
    _, found = flown(mission)
    assert not kept(mission, found)


def test_words_that_are_late_put_a_pile_in_one_plane_again() -> None:
    """Three above each other hear nothing for 1.5 s: they part, slowly, and stand above each other
    again once they hear."""
    mission = loads(HEAD + PILED)
    swarm, _ = flown(mission, until=lambda s: s.in_step(3))
    hear_again = [deaf(swarm, agent, keys.STATE) for agent in (1, 2, 3)]
    begun_s, fastest, parted = swarm.now, 0.0, 0.0
    while swarm.now < begun_s + 4.0:
        before = swarm.positions()
        swarm.tick()
        at = swarm.positions()
        if swarm.now < begun_s + 2.0:  # then they come back
            fastest = max(fastest, *(math.dist(at[i], before[i]) / 0.1 for i in at))
        parted = max(parted, min(math.dist(at[i], at[j]) for i, j in ((1, 2), (1, 3), (2, 3))))
        if swarm.now > begun_s + 1.5:
            for hear in hear_again:
                hear()
    assert parted > 0.3
    swarm, found = flown(mission, swarm=swarm)
    plan = mission.plan
    assert 0.5 < fastest < 0.5 * plan.limits.speed_mps  # what a keep-out asks for at most
    assert found.above_m < mission.plan.slot_layer_m + 2.0  # above each other again
    assert kept(mission, found)
    assert set(swarm.outcomes().values()) == {"completed"}


@pytest.mark.parametrize("down_m", [3.0, -3.0])
@pytest.mark.parametrize("agent", [1, 2, 3])
def test_a_height_that_is_off_by_3_m_counts_for_that_much_less(agent: int, down_m: float) -> None:
    """The estimate of one in a pile jumps by 3 m, so that it climbs or sinks towards another, by
    the spacing that is just enough for estimates that are right."""
    spacing_m = loads(HEAD + PILED).plan.slot_layer_m
    ups = f"up_m: [0, {spacing_m + 0.1:.1f}, {2 * spacing_m + 0.2:.1f}]"
    mission = loads(HEAD + PILED.replace("up_m: [0, 8, 16]", ups))
    swarm, before = flown(mission, until=lambda s: s.in_step(3))
    swarm.hub.world.vehicles[agent - 1].firmware.parameters.set("SIM_GPS_JUMP_D", down_m)
    swarm, found = flown(mission, swarm=swarm, until=lambda s: s.in_step(4))
    assert before.above_m >= mission.plan.layer_m
    assert kept(mission, found)
    doubted = [e.text for e in swarm.events if "its height jumped by 3.0 m" in e.text]
    assert len(doubted) == 2  # by both others


@pytest.mark.parametrize("agent", [1, 2, 3])
def test_one_whose_agent_dies_among_others_in_a_pile(agent: int) -> None:
    """The others hear nothing of it, make room in the plane, and go on once it has landed."""
    lost = "policies: {agent_lost: continue}\n"
    mission = loads(HEAD + lost + PILED)
    swarm, _ = flown(mission, until=lambda s: s.in_step(3))
    swarm.kill(agent)
    swarm, found = flown(mission, swarm=swarm)
    assert kept(mission, found)
    others = {i: how for i, how in swarm.outcomes().items() if i != agent}
    assert set(others.values()) == {"completed"}


@pytest.mark.parametrize("agent", [2, 3])
def test_one_that_is_ordered_down_from_a_pile_moves_aside_first(agent: int) -> None:
    mission = loads(HEAD + PILED)
    swarm, _ = flown(mission, until=lambda s: s.in_step(3))
    swarm.command("land", agents=(agent,))
    swarm, found = flown(mission, swarm=swarm)
    assert kept(mission, found)
    assert swarm.all_down


def test_all_that_are_ordered_down_from_a_pile_part_first() -> None:
    mission = loads(HEAD + PILED)
    swarm, _ = flown(mission, until=lambda s: s.in_step(3))
    swarm.command("land")
    swarm, found = flown(mission, swarm=swarm)
    assert kept(mission, found)
    assert swarm.all_down


def test_a_return_from_a_pile() -> None:
    """All go home at the heights of returns, which are no slots'."""
    mission = loads(
        HEAD + PILED.replace("  - form: {shape: flat, settle_s: 1}\n  - land", "  - return")
    )
    swarm, found = flown(mission)
    assert kept(mission, found)
    assert set(swarm.outcomes().values()) == {"completed"}


def test_a_step_that_waits_for_an_aircraft_in_the_way_ends_and_names_it() -> None:
    """An agent that is pinned under another one, and may not leave, gives up in time."""
    mission = loads(HEAD + TWO)
    swarm, _ = flown(mission, until=lambda s: s.in_step(3))
    for member in swarm.members.values():
        member.agent._controller.keep_clear = lambda *_, **__: (0.0, 0.0)  # type: ignore[method-assign]
    swarm, _ = flown(mission, swarm=swarm, until=lambda s: "failed" in s.outcomes().values())
    told = [e.text for e in swarm.events if "waits at its height for agent" in e.text]
    assert any("timed out" in text for text in told)
