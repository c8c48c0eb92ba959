"""Flights in layers on the virtual clock: judged by truth, no pair comes closer than r_in
horizontally and `layer_m` in height at once."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from swarm_ctl.mesh import keys
from swarm_ctl.mission.compile.loader import loads
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm
from tests.on_demand import on_demand
from tests.scenarios.swarm import deaf, flown_once, landing_fast, ready

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
  - form: {shape: swapped, slots: fixed, settle_s: 2, timeout_s: 40}
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
  - hold: {duration_s: 15}
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


def begun(text: str, seed: int = 1) -> VirtualSwarm:
    """On the ground."""
    return landing_fast(VirtualSwarm(loads(text), seed))


def flown(
    swarm: VirtualSwarm, until: Callable[[VirtualSwarm], bool] | None = None
) -> tuple[VirtualSwarm, Judged]:
    """The swarm at its end, or `until` then."""
    found, plan = Judged(), swarm.plan
    r_in_m = plan.law.r_in * plan.unit_m
    while swarm.now < 300 and any(m.alive and not m.ended for m in swarm.members.values()):
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


@flown_once
def piled(text: str = HEAD + PILED) -> tuple[VirtualSwarm, Judged]:
    """Until all stand above each other, in their third step."""
    return flown(begun(text), until=lambda s: s.in_step(3))


def assert_kept(swarm: VirtualSwarm, found: Judged) -> None:
    """No pair was too near in both ways at once."""
    assert found.beside_m >= swarm.plan.law.r_in * swarm.plan.unit_m
    assert found.above_m >= swarm.plan.layer_m


@pytest.mark.parametrize("seed", [1, on_demand(2)])
def test_two_swap_heights_at_one_place(seed: int) -> None:
    """They stand above each other, part, pass, and stand above each other again."""
    swarm, found = flown(begun(HEAD + TWO, seed))
    assert set(swarm.outcomes().values()) == {"completed"}
    assert_kept(swarm, found)
    assert found.above_m < swarm.plan.slot_layer_m + 2.0  # they were above each other
    assert swarm.closest_m >= 2.5  # as the swarm's own judge says


@pytest.mark.parametrize("seed", [on_demand(seed) for seed in range(1, 21)])
def test_the_ready_mission_whose_layers_change_places(seed: int) -> None:
    """All steps, each of which the test above has in small."""
    swarm, found = flown(begun(ready("layers.yaml"), seed))
    assert set(swarm.outcomes().values()) == {"completed"}
    assert_kept(swarm, found)


def test_without_the_rule_two_swap_heights_through_each_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The test above can fail: where all pairs count as apart, the two collide."""
    monkeypatch.setattr("swarm_ctl.core.safety.safety_filter.apart_by_height", lambda *_: True)
    swarm, found = flown(begun(HEAD + TWO))
    with pytest.raises(AssertionError):
        assert_kept(swarm, found)


def test_words_that_are_late_put_a_pile_in_one_plane_again() -> None:
    """Three above each other hear nothing for 1.5 s: they part, slowly, and stand above each other
    again once they hear."""
    swarm, _ = piled()
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
    _, found = flown(swarm)
    assert 0.5 < fastest < 0.5 * swarm.plan.limits.speed_mps  # what a keep-out asks for at most
    assert found.above_m < swarm.plan.slot_layer_m + 2.0  # above each other again
    assert_kept(swarm, found)
    assert set(swarm.outcomes().values()) == {"completed"}


@pytest.mark.parametrize(
    ("agent", "down_m"),
    [(1, 3.0), (2, -3.0), *(on_demand(*row) for row in ((2, 3.0), (3, -3.0), (1, -3.0), (3, 3.0)))],
)
def test_a_height_that_is_off_by_3_m_counts_for_that_much_less(agent: int, down_m: float) -> None:
    """The estimate of one in a pile jumps by 3 m, so that it climbs or sinks towards another, by
    the spacing that is just enough for estimates that are right; on demand, away from it."""
    spacing_m = loads(HEAD + PILED).plan.slot_layer_m
    ups = f"up_m: [0, {spacing_m + 0.1:.1f}, {2 * spacing_m + 0.2:.1f}]"
    swarm, before = piled(HEAD + PILED.replace("up_m: [0, 8, 16]", ups))
    swarm.hub.world.vehicles[agent - 1].firmware.parameters.set("SIM_GPS_JUMP_D", down_m)
    _, found = flown(swarm, until=lambda s: s.in_step(4))
    assert before.above_m >= swarm.plan.layer_m
    assert_kept(swarm, found)
    doubted = [e.text for e in swarm.events if "its height jumped by 3.0 m" in e.text]
    assert len(doubted) == 2  # by both others


@pytest.mark.parametrize("agent", [on_demand(1), 2, on_demand(3)])
def test_one_whose_agent_dies_among_others_in_a_pile(agent: int) -> None:
    """The others hear nothing of it, make room in the plane, and go on once it has landed."""
    swarm, _ = piled(HEAD + "policies: {agent_lost: continue}\n" + PILED.replace("s: 15", "s: 30"))
    swarm.kill(agent)
    assert_kept(*flown(swarm))
    others = {i: how for i, how in swarm.outcomes().items() if i != agent}
    assert set(others.values()) == {"completed"}


@pytest.mark.parametrize("agents", [(2,), on_demand((3,)), ()], ids=str)
def test_who_is_ordered_down_from_a_pile_moves_aside_first(agents: tuple[int, ...]) -> None:
    """One, or all."""
    swarm, _ = piled()
    swarm.command("land", agents=agents)
    assert_kept(*flown(swarm))
    assert swarm.all_down


def test_a_return_from_a_pile() -> None:
    """All go home at the heights of returns, which are no slots'."""
    returns = PILED.replace("  - form: {shape: flat, settle_s: 1}\n  - land", "  - return")
    swarm, found = flown(begun(HEAD + returns))
    assert_kept(swarm, found)
    assert set(swarm.outcomes().values()) == {"completed"}


def test_a_step_that_waits_for_an_aircraft_in_the_way_ends_and_names_it() -> None:
    """An agent that is pinned under another one, and may not leave, gives up in time."""
    swarm, _ = piled(HEAD + TWO)
    for member in swarm.members.values():
        member.agent._controller.keep_clear = lambda *_, **__: (0.0, 0.0)  # type: ignore[method-assign]
    flown(swarm, until=lambda s: "failed" in s.outcomes().values())
    told = [e.text for e in swarm.events if "waits at its height for agent" in e.text]
    assert any("timed out" in text for text in told)
