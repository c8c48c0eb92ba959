"""What is refused of zones, by line; and how a move is led round them."""

from __future__ import annotations

import re

import pytest

from swarm_ctl.errors import MissionError
from swarm_ctl.mission.compile.loader import loads
from swarm_ctl.mission.steps.table import kind_of
from tests.unit.mission.example import TEXT, problems
from tests.unit.plans import steps_of

LINE = 1 + TEXT.count("\n")
"""Of the section `zones`, behind the example."""


WIDE = ("- hold: {duration_s: 10}", "- move: {to: [20, 1], speed_mps: 3}")


def test_each_zone_once() -> None:
    circle = "{circle: [30, 30], radius: 1}"
    (problem,) = problems(f"{TEXT}zones:\n  a: {circle}\n  b: {circle}\n")
    assert (problem.where, problem.what) == (f"trio.yaml:{LINE + 2}", "is where zone a is")


def test_no_start_is_in_a_zone_through_which_it_would_climb() -> None:
    """A zone that ends under the take-off is in its way, one that begins over it is not."""
    start = "{circle: [0, 3], radius: 0.2, "
    (problem,) = problems(f"{TEXT}zones:\n  x: {start}ceiling_m: 4}}\n")
    assert problem.where == "trio.yaml:13"
    assert problem.what == "agent 2 starts in zone x"
    assert problem.allowed == "at least 1.75 m away"
    loads(f"{TEXT}zones:\n  x: {start}floor_m: 15}}\n")


def test_no_place_is_in_a_zone_and_none_lands_in_one() -> None:
    plan = loads(TEXT).plan
    for k, heights, field, does in (
        (2, "floor_m: 5", "step 2, form", "would be"),
        (4, "ceiling_m: 5", "step 5, land", "would land"),
    ):
        north, east = plan.groups[0].formations(plan.unit_m)[k].places[1]
        zone = f"x: {{circle: [{north + 0.3}, {east}], radius: 0.1, {heights}}}"
        found = problems(f"{TEXT}zones:\n  {zone}\n")
        assert found[-1].field == field
        assert found[-1].what.startswith(f"agent 2 {does} 1.00 m from zone x at ")
        assert found[-1].allowed == "at least 1.75 m away"


def test_a_place_is_in_a_zone_at_its_own_height_alone() -> None:
    """The second slot is 20 m above the flight height: a zone there is in its way, and one at the
    others' height is not."""
    flat = loads(TEXT).plan
    north, east = flat.groups[0].formations(flat.unit_m)[2].places[1]
    height_m = flat.groups[0].formations(flat.unit_m)[2].height_m
    shape = TEXT.index("kind: ")
    ups = ", ".join("20" if k == 1 else "0" for k in range(len(flat.agents)))
    text = f"{TEXT[:shape]}up_m: [{ups}], {TEXT[shape:]}wake: {{}}\n".replace("slots: nearest", "")
    for heights, refused in (
        (f"floor_m: {height_m + 15}, ceiling_m: {height_m + 40}", True),
        (f"floor_m: 0, ceiling_m: {height_m + 5}", False),
    ):
        zone = f"x: {{circle: [{north + 0.3}, {east}], radius: 0.1, {heights}}}"
        whole = f"{text}zones:\n  {zone}\n"
        if refused:
            assert problems(whole)[-1].what.startswith("agent 2 would be 1.00 m from zone x at ")
        else:
            assert loads(whole)


def test_no_place_is_so_near_to_the_fence_that_the_filter_would_keep_off_it() -> None:
    fence = "fence: {polygon: [[-5, -0.05], [9, -0.05], [9, 9], [-5, 9]]}\n"
    found = problems(TEXT + fence)
    assert found[0].field == "agents#1.start"
    assert found[0].what == "agent 1 starts 0.25 m from the fence"
    assert found[0].allowed == "at least 0.5 m inside"


def test_without_the_filter_there_are_no_zones() -> None:
    zone = "zones:\n  x: {circle: [30, 30], radius: 1}\n"
    (problem,) = problems(f"{TEXT}safety: {{filter: false}}\n{zone}")
    assert problem.field == "zones"
    assert "without the filter" in problem.what


def test_a_move_goes_round_a_zone_and_straight_where_every_agent_has_room() -> None:
    for zone, corners in (
        ("{circle: [10, 1], radius: 0.5}", 2),
        ("{circle: [10, 9], radius: 0.5}", 1),
        ("{circle: [10, 1], radius: 0.5, ceiling_m: 5}", 1),
    ):
        loaded = loads(f"{TEXT}zones:\n  x: {zone}\n".replace(*WIDE))
        step = steps_of(loaded.plan)[2]
        assert step.way_m[-1] == (100.0, 5.0)
        assert len(step.way_m) >= corners
        assert (len(step.way_m) == 1) is (corners == 1)


def gate(width: float, low: float = 8, high: float = 9) -> str:
    """A wall across the way, from fence to fence, with an opening of so many units."""
    walls = (
        f"w{k}: {{polygon: [[{low}, {a}], [{high}, {a}], [{high}, {b}], [{low}, {b}]]}}"
        for k, (a, b) in enumerate([(-20, 0), (width, 20)])
    )
    zones = "zones:\n  " + "\n  ".join(walls) + "\n"
    fence = "fence: {polygon: [[-9, -19], [40, -19], [40, 19], [-9, 19]]}\n"
    return (TEXT + fence + zones).replace(*WIDE)


def test_a_move_through_a_gate_that_is_too_narrow_goes_in_file() -> None:
    loaded = loads(gate(1.6))
    step, wide = steps_of(loaded.plan)[2], steps_of(loads(gate(6.0)).plan)[2]
    assert step.file is not None
    assert wide.file is None
    assert step.timeout_s > 1.4 * wide.timeout_s
    assert kind_of(step).words(step, loaded.plan).startswith("move in file to ")


def test_a_move_without_a_way_is_refused_with_the_gap_that_there_is() -> None:
    (problem,) = problems(gate(0.5))
    assert problem.field == "step 3, move"
    assert "there is no way past zone w" in problem.what
    assert "the widest gap is 2.2 m too narrow for vehicles in file" in problem.what
    assert problem.allowed.startswith("a gap of 4.7 m between zones, 3.4 m between a zone and")


def test_a_shape_on_both_sides_of_a_wall_is_refused() -> None:
    """The law leads agents round zones, but for one it has to have a way."""
    text = gate(0.5, 3.6, 4.4).replace(WIDE[1], WIDE[0])
    text = text.replace("[0, 2]", "[4, 0]").replace("[0, 4]", "[8, 0]")
    (problem,) = problems(text)
    assert problem.field == "step 4, form"
    place = "25.0 m north, 5.0 m east of the origin"
    assert problem.what == f"agent 3 has no way past zone w1 to {place}"
    assert problem.allowed == "a wider gap, or another place"


WALL = """\
version: 1
name: gate
origin: {{lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}}
lengths: metres
law: {{r: 22.5, r_out: 7.5, r_in: 2.5}}
agents: {agents}
shapes: {{row: {{kind: grid, spacing: 10, columns: 2}}}}
zones:
  west: {{polygon: [[64, -90], [70, -90], [70, 8], [64, 8]]}}
  east: {{polygon: [[64, {east}], [70, {east}], [70, {ends}], [64, {ends}]]}}
steps:
  - takeoff: {{height_m: 8}}
  - form: {{shape: row}}
  - move: {{to: [130, 15], speed_mps: 3}}
  - land
fence: {{polygon: [[-30, -60], [230, -60], [230, 80], [-30, 80]]}}
"""
"""Agents before a wall with a gate."""


def wall(agents: int, width_m: float, ends: float = 90) -> str:
    entries = [f"{{id: {k + 1}, start: [0, {10 * k}]}}" for k in range(agents)]
    return WALL.format(agents=f"[{', '.join(entries)}]", east=8 + width_m, ends=ends)


def refusal(text: str) -> str:
    try:
        loads(text)
    except MissionError as error:
        return " ".join(f"{problem.what}; {problem.allowed}" for problem in error.problems)
    return ""


@pytest.mark.parametrize("width_m", [2.6, 3.51, 3.6, 4.0, 4.5, 4.6])
@pytest.mark.parametrize("agents", [1, 4])
def test_what_a_gap_is_said_to_lack_is_enough(width_m: float, agents: int) -> None:
    """A gate of 3.51 m was said to be 3.5 m wide, and 3.5 m to be needed; one of 4 m, that the way
    begins too near to it, 30 m away."""
    said = refusal(wall(agents, width_m))
    if agents == 1 and width_m > 3.65:
        assert not said
        return
    told = re.search(r"widest gap is ([\d.]+) m too narrow .* a gap of ([\d.]+) m between", said)
    assert told is not None
    lacks_m, needed_m = map(float, told.groups())
    assert not refusal(wall(agents, width_m + lacks_m))
    assert not refusal(wall(agents, needed_m))
    assert lacks_m == pytest.approx(needed_m - width_m, abs=0.2)


def test_a_move_that_begins_too_near_to_a_zone_is_no_matter_of_gaps() -> None:
    """A gap of 13 m was named beside a need of 3.5 m."""
    zones = "zones:\n  oak: {circle: [0, 0], radius: 0.3}\n"
    start, _, move = problems(TEXT.replace(*WIDE) + zones)
    assert "starts in zone oak" in start.what
    assert "the way of the formation begins too near to zone oak" in move.what
    assert move.allowed.startswith("its centre at least ")
