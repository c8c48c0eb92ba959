"""Two groups in one swarm, built in Python: each with its steps, barrier, shape, frame and graph;
they keep clear of each other, and wait for none of the other."""

from __future__ import annotations

from swarm_ctl.core.law.formation import formation_error
from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import GroupPlan
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from tests.scenarios.swarm import VirtualSwarm, landing_fast

TEXT = """\
version: 1
name: two-groups
origin: {lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}
unit_m: 1
tick_s: 0.1
law: {r: 20, r_out: 6, r_in: 2.5}
agents:
  - {id: 1, start: [0, 0]}
  - {id: 2, start: [0, 9]}
  - {id: 3, start: [0, 18]}
  - {id: 4, start: [20, 0]}
  - {id: 5, start: [20, 9]}
  - {id: 6, start: [20, 18]}
shapes:
  row: {kind: line, spacing: 9}
  wedge: {kind: wedge, spacing: 9}
steps:
  - takeoff: {height_m: 4}
"""
SEARCH = """\
  - form: {shape: row, slots: fixed, settle_s: 1}
  - move: {by: [-30, 0]}
  - land: {}
"""
WATCH = """\
  - form: {shape: wedge, slots: fixed, settle_s: 1}
  - hold: {duration_s: 60}
  - land: {}
"""


def mission(steps: str, ids: tuple[int, ...]) -> LoadedMission:
    lines = [
        line
        for line in TEXT.splitlines(keepends=True)
        if "start:" not in line or any(f"id: {i}," in line for i in ids)
    ]
    return loads("".join(lines) + steps)


def group(name: str, steps: str, ids: tuple[int, ...]) -> GroupPlan:
    plan = mission(steps, ids).plan
    return GroupPlan(name, plan.agents, plan.steps)


def test_two_groups_fly_their_own_steps_and_keep_apart() -> None:
    """The searchers are down while the watchers still hold; nobody comes under r_in."""
    search = group("search", SEARCH, (1, 2, 3))
    watch = group("watch", WATCH, (4, 5, 6))
    # who all are, and what a word of any of them may be, is the whole plan's
    swarm = landing_fast(VirtualSwarm(mission(SEARCH, (1, 2, 3, 4, 5, 6)), groups=(search, watch)))

    def ended(ids: tuple[int, ...]) -> bool:
        return ids == tuple(i for i in ids if i in swarm.outcomes())

    swarm.wait(lambda _: ended((1, 2, 3)))
    assert not any(i in swarm.outcomes() for i in (4, 5, 6))
    at = swarm.positions()
    shape = watch.steps[1].new_shape
    assert shape is not None
    assert formation_error([at[i] for i in (4, 5, 6)], shape.slots) < 0.5
    assert max(at[i][0] for i in (1, 2, 3)) < -15.0
    swarm.fly()
    assert set(swarm.outcomes().values()) == {"completed"}
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m
    assert swarm.all_down


def test_a_group_waits_for_its_members_alone() -> None:
    """An agent that dies stops its own group, and not the other."""
    search, watch = group("search", SEARCH, (1, 2, 3)), group("watch", WATCH, (4, 5, 6))
    whole = mission(SEARCH, (1, 2, 3, 4, 5, 6))
    swarm = landing_fast(VirtualSwarm(whole, groups=(search, watch)))
    swarm.wait(lambda s: s.phases() == {Phase.FLY})
    swarm.kill(6)
    swarm.fly()
    outcomes = swarm.outcomes()
    assert {outcomes[i] for i in (1, 2, 3)} == {"completed"}
    assert {outcomes[i] for i in (4, 5)} == {"failed"}
