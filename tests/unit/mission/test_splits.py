"""Groups and splits of a mission file: what they become, and each mistake at its place."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.model.route import Routes
from swarm_ctl.errors import MissionError, Problem
from swarm_ctl.mission.checks.group_checks import crowded
from swarm_ctl.mission.checks.mission_checks import _dead_lock
from swarm_ctl.mission.compile.loader import loads

TEXT = """\
version: 1
name: parted
origin: {lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}
lengths: metres
law: {r: 40, r_out: 7.5, r_in: 2.5}
agents:
  - {id: 1, start: [0, 0]}
  - {id: 2, start: [0, 10]}
  - {id: 3, start: [10, 0]}
  - {id: 4, start: [10, 10]}
  - {id: 5, start: [20, 0]}
groups:
  west: [1, 3]
  east: [2, 4]
shapes:
  row: {kind: line, spacing: 9}
steps:
  - takeoff: {height_m: 4}
  - form: {shape: row}
  - split:
      west:
        - move: {by: [0, -20]}
        - barrier: {name: ridge}
      east:
        - form: {shape: row}
        - hold: {duration_s: 12}
        - barrier: {name: ridge}
  - form: {shape: row}
  - land
"""


def edited(*edits: tuple[str, str]) -> str:
    text = TEXT
    for old, new in edits:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def problem(text: str) -> Problem:
    with pytest.raises(MissionError) as caught:
        loads(text)
    return caught.value.problems[0]


def test_a_split_is_a_group_for_each_name_and_one_for_the_rest() -> None:
    """All from step 3 on, and all as many steps; the whole swarm goes on after them."""
    plan = loads(TEXT).plan
    found = [(g.name, g.ids, g.before, [s.title for s in g.steps]) for g in plan.groups]
    assert found == [
        ("all", (1, 2, 3, 4, 5), 0, ["takeoff", "form row"]),
        ("west", (1, 3), 2, ["move", "barrier ridge", "join 1", "join 1"]),
        ("east", (2, 4), 2, ["form row", "hold", "barrier ridge", "join 1"]),
        ("rest", (5,), 2, ["join 1"] * 4),
        ("all", (1, 2, 3, 4, 5), 6, ["form row", "land"]),
    ]


def test_each_group_begins_where_the_one_before_leaves_its_agents() -> None:
    """The shape before a split is kept; after it, the places that the groups have flown to."""
    plan = loads(TEXT).plan
    whole, west, _, _, last = plan.groups
    end = dict(zip(whole.ids, whole.formations(plan.unit_m)[-1].places, strict=True))
    assert {agent.id: agent.start for agent in west.agents} == {i: end[i] for i in west.ids}
    assert west.formations(plan.unit_m)[0].formed
    assert not last.formations(plan.unit_m)[0].formed
    moved = dict(zip(west.ids, west.formations(plan.unit_m)[-1].places, strict=True))
    starts = {agent.id: agent.start for agent in last.agents}
    assert {i: starts[i] for i in west.ids} == moved
    assert starts[5] == end[5]
    assert last.flies_m == 4.0


def test_a_group_that_lands_is_not_in_the_steps_that_follow() -> None:
    text = edited(("        - barrier: {name: ridge}\n      east", "        - return\n      east"))
    text = text.replace("        - barrier: {name: ridge}\n", "")
    plan = loads(text).plan
    assert plan.groups[-1].ids == (2, 4, 5)
    assert len(plan.groups[-1].steps[0].new_shape.slots) == 3  # type: ignore[union-attr]
    assert set(Routes(plan).awaited(2, 5)) == {2, 4, 5}


MISTAKES = {
    "no such group": (("      west:\n", "      wets:\n"), "steps#3.split.wets", "no group 'wets'; did you mean west?"),
    "no such agent": (("west: [1, 3]", "west: [1, 9]"), "groups.west#2", "there is no agent 9"),
    "an agent twice": (("west: [1, 3]", "west: [1, 1]"), "groups.west#2", "1 is taken by"),
    "in two groups": (("east: [2, 4]", "east: [3, 4]"), "steps#3.split.east", "agent 3 is in west, too"),
    "a name of every mission": (("  west: [1, 3]", "  all: [1, 3]"), "groups.all", "all is a group of every mission"),
    "a name that reads as ids": (("  west: [1, 3]", "  1-3: [1, 3]"), "groups.1-3", "@1-3 names agents by their ids"),
    "the whole swarm": (("west: [1, 3]", "west: [1, 2, 3, 4, 5]"), "steps#3.split.west", "west is the whole swarm"),
    "takeoff in a split": (("        - hold: {duration_s: 12}", "        - takeoff: {height_m: 4}"), "split.east#2", "takeoff in the air"),
    "land in the middle": (("        - hold: {duration_s: 12}", "        - land"), "split.east#2", "steps after land"),
    "split in a split": (("        - hold: {duration_s: 12}", "        - split: {west: [land]}"), "split.east#2", "unknown field"),
    "no step": (("        - hold: {duration_s: 12}", "        - {}"), "split.east#2", "is not one step"),
    "a group without steps": (("      west:\n        - move: {by: [0, -20]}\n        - barrier: {name: ridge}\n", "      west: []\n"), "split.west", "0 entries"),
    "move after the join": (("  - form: {shape: row}\n  - land", "  - move: {by: [0, 5]}\n  - land"), "step 4", "move without a formation to keep"),
    "time-out": (("hold: {duration_s: 12}", "hold: {duration_s: 12, timeout_s: 5}"), "split.east#2.hold.timeout_s", "5 s is over"),
    "a barrier for one": (("        - move: {by: [0, -20]}\n        - barrier: {name: ridge}", "        - move: {by: [0, -20]}"), "barrier.name", "no other group has a barrier 'ridge'"),
    "a barrier of all": (("  - form: {shape: row}\n  - split", "  - barrier: {name: ridge}\n  - split"), "step 2", "a barrier of the whole swarm"),
    "ends with a split": (("  - form: {shape: row}\n  - land\n", ""), "step 3", "the mission ends with a split, and agents 1, 2, 3, 4, 5 fly on"),
    "begins with a split": (("  - takeoff: {height_m: 4}\n  - form: {shape: row}\n", ""), "step 1", "split before takeoff"),
    "too few slots in a group": (("  row: {kind: line", "  row: {kind: line, count: 5"), "shapes.row.count", "5 slots for 2 agents"),
    "beyond the fence": (("groups:", "fence: {polygon: [[-30, -16], [-30, 60], [60, 60], [60, -16]]}\ngroups:"), "split.west#1.move", "agent 3 would be outside the geofence"),
}  # fmt: skip


@pytest.mark.parametrize("last", ["return", "hold: {duration_s: 2}"])
def test_a_split_is_of_those_that_fly_as_it_begins(last: str) -> None:
    """One group lands, and the other is all that is left: also then it is not the whole swarm."""
    head = TEXT.partition("groups:")[0] + "groups: {a: [1, 2, 3], b: [4, 5]}\n"
    shapes = TEXT.partition("  - split")[0].partition("  east: [2, 4]\n")[2]
    rest = "" if last == "return" else "  - form: {shape: row}\n  - land\n"
    plan = loads(f"{head}{shapes}  - split: {{a: [land], b: [{last}]}}\n{rest}").plan
    assert [g.ids for g in plan.groups[1:]] == [(1, 2, 3), (4, 5), (4, 5)][: 2 + bool(rest)]


@pytest.mark.parametrize("case", MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_told_at_its_place(case: tuple[tuple[str, str], str, str]) -> None:
    edit, field, what = case
    found = problem(edited(edit))
    assert field.removeprefix("steps#3.") in found.field.replace("step 3, ", "")
    assert what in found.what
    assert found.allowed


@given(st.permutations("abcd"), st.permutations("abcd"), st.sets(st.sampled_from("abcd")))
def test_barriers_in_two_orders_are_refused(
    one: list[str], other: list[str], own: set[str]
) -> None:
    """As two groups that wait at each in turn would find: straight from what waiting means."""
    other = [name for name in other if name in own or name in "ab"]
    left = {"one": [n for n in one if n in other], "other": list(other)}
    found = list(_dead_lock(2, {name: list(order) for name, order in left.items()}))
    assert bool(found) == (left["one"] != left["other"])


@pytest.mark.parametrize(
    ("moves", "told"),
    [
        ("{by: [0, -20]}", []),
        ("{by: [0, -2]}", []),  # 7 m from agent 5: inside r_out, and reached
        ("{by: [0, -5]}", [(3, 1, 5, 4.0)]),  # agent 5 is in no group of the split, and stays
        ("{by: [0, 4]}", [(3, 1, 2, 5.0), (3, 3, 5, 5.0)]),  # agent 2 waits at the barrier, too
        # west does not wait beside east, and agent 5 is there all the time
        ("{by: [0, 4]}\n        - move: {by: [0, -24]}", [(3, 3, 5, 5.0)]),
        # where a target leads is not known
        ("{by: [0, 4]}\n        - follow: {target: boat, duration_s: 5}", []),
    ],
)
def test_a_place_beside_an_agent_that_stays_may_not_be_reached(
    moves: str, told: list[tuple[int, int, int, float]]
) -> None:
    plan = loads(edited(("{by: [0, -20]}", moves)) + "targets: {boat: {}}\n").plan
    found = [(at.number, agent, other, apart_m) for at, agent, other, apart_m in crowded(plan)]
    assert found == [(*whom, pytest.approx(apart_m)) for *whom, apart_m in told]


@pytest.mark.parametrize(
    ("height_m", "move", "told"),
    [
        (3, "{to: [8, 21]}", [(3, 3, 4, 2.83)]),
        (3.5, "{to: [8, 21]}", []),  # flown over
        (3, "{by: [0, 30]}", []),  # past agent 4 alone, 2 m beside it
        (3, "{along: [[5, -30], [5, 40]]}", [(3, 1, 2, 5.0)]),  # between two
    ],
)
def test_low_beside_a_group_that_has_come_down_an_agent_may_not_come_on(
    height_m: float, move: str, told: list[tuple[int, int, int, float]]
) -> None:
    """East returns to its starts, (0, 10) and (10, 10)."""
    head, steps = edited(("height_m: 4", f"height_m: {height_m}")).split("      west:\n")
    tail = steps[steps.index("  - form: {shape: row}\n  - land") :]
    text = f"{head}      west: [move: {move}]\n      east: [return]\n{tail}"
    found = [(at.number, i, j, apart_m) for at, i, j, apart_m in crowded(loads(text).plan)]
    assert found == [(*whom, pytest.approx(apart_m, abs=0.01)) for *whom, apart_m in told]


def test_it_is_a_warning() -> None:
    text = edited(("{by: [0, -20]}", "{by: [0, -5]}"))
    words = [each for each in loads(text).warnings if "may not come" in each]
    assert len(words) == 1
    assert "agent 1 is to be 4 m from agent 5" in words[0]


@pytest.mark.parametrize(("waiting", "warned"), [((2,), False), ((2, 4), True)])
def test_a_group_that_waits_as_a_whole_is_warned_of(waiting: tuple[int, ...], warned: bool) -> None:
    """One of it on its way is enough to fly its steps."""
    starts = {2: "{id: 2, start: [0, 10]", 4: "{id: 4, start: [10, 10]"}
    text = edited(*((starts[i], f"{starts[i]}, waits: true") for i in waiting))
    words = [each for each in loads(text).warnings if "waits on the ground" in each]
    assert len(words) == warned
    assert all("groups.east" in each for each in words)
