"""Moves, letters, CSV files, lengths in metres: what is loaded, and what each mistake is answered
with."""

from __future__ import annotations

import math
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.law import graph
from swarm_ctl.core.law.formation import smallest_distance
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.steps.rotate import RotateStep
from swarm_ctl.core.model.steps.scale import ScaleStep
from swarm_ctl.core.model.steps.table import AnyStep
from swarm_ctl.errors import MissionError
from swarm_ctl.mission.compile.loader import dumps, load, loads
from swarm_ctl.mission.geometry import shapes
from swarm_ctl.mission.steps.table import KINDS
from tests.unit.mission.example import TEXT, edited, in_metres, problems
from tests.unit.plans import steps_of

FORM = "  - form: {shape: ring}\n"


def with_step(step: str) -> str:
    return edited((FORM, FORM + f"  - {step}\n"))


REFUSALS = {
    "no way": ("move: {speed_mps: 1}", "step 3, move", "no way to go", "one of to, along, by"),
    "two ways": (
        "move: {to: [1, 1], by: [1, 1]}",
        "step 3, move",
        "to and by",
        "one of to, along, by",
    ),
    "too fast": (
        "move: {to: [1, 1], speed_mps: 9}",
        "step 3, move.speed_mps",
        "faster",
        "limits.speed_mps = 5",
    ),
    "too far": ("move: {to: [2000, 1]}", "step 3, move", "10000 m from the origin", "5000 m"),
    "too narrow": (
        "scale: {factor: 0.5}",
        "step 3, scale.factor",
        "brings slots to 1 units",
        "law.r_out",
    ),
    "no angle": ("rotate: {speed_mps: 1}", "step 3, rotate.angle_deg", "is missing", "a number"),
    "early return": ("return", "step 3", "steps after return", "as the last step only"),
    "bad policy": (
        "hold: {duration_s: 1, on_timeout: explode}",
        "step 3, hold.on_timeout",
        "explode",
        "land",
    ),
    "bad link": (
        "form: {shape: ring, neighbours: [[1, 9]]}",
        "step 3, form.neighbours#1",
        "is no link",
        "1, 2, 3",
    ),
    "cut graph": (
        "form: {shape: ring, neighbours: [[1, 2]]}",
        "step 3, form.neighbours",
        "{1, 2} and {3}",
        "links",
    ),
}


@pytest.mark.parametrize("case", REFUSALS.values(), ids=REFUSALS)
def test_a_mistake_in_a_step_is_reported(case: tuple[str, str, str, str]) -> None:
    step, field, what, allowed = case
    found = {p.field: p for p in problems(with_step(step))}
    assert field in found, list(found)
    assert found[field].where == "trio.yaml:26"
    assert what in found[field].what
    assert allowed in found[field].allowed


def test_a_move_before_any_shape_is_refused() -> None:
    (problem,) = (
        p
        for p in problems(edited((FORM, "  - move: {to: [1, 1]}\n" + FORM)))
        if p.field == "step 2"
    )
    assert "without a formation to keep" in problem.what


def test_targets_add_up_over_steps() -> None:
    """Rotations add, factors multiply, `by` counts from where the centre is planned to be; a form
    starts anew."""
    text = with_step(
        "rotate: {angle_deg: 30}\n  - rotate: {angle_deg: 60}\n"
        "  - scale: {factor: 2}\n  - scale: {factor: 1.5}"
    )
    steps = steps_of(loads(text).plan)
    assert [s.angle_rad for s in steps if isinstance(s, RotateStep)] == pytest.approx(
        [math.pi / 6, math.pi / 2]
    )
    assert [s.factor for s in steps if isinstance(s, ScaleStep)] == [2, 3]
    moves = steps_of(loads(with_step("move: {to: [4, 2]}\n  - move: {by: [1, -1]}")).plan)
    assert [s.waypoints_m for s in moves if isinstance(s, MoveStep)] == [((20, 10),), ((25, 5),)]


def test_later_slots_are_the_nearest_from_the_turned_shape() -> None:
    """After half a turn of a row, the ends have changed sides."""
    base = steps_of(loads(edited((FORM, "  - form: {shape: row, slots: fixed}\n"))).plan)[3]
    turn = "  - form: {shape: row, slots: fixed}\n  - rotate: {angle_deg: 180}\n"
    turned = steps_of(loads(edited((FORM, turn))).plan)[4]
    assert isinstance(base, FormStep)
    assert isinstance(turned, FormStep)
    assert turned.slots == base.slots[::-1]


def test_neighbours_are_rechosen_from_the_shape_before() -> None:
    text = edited(("form: {shape: row, ", "form: {shape: row, neighbours: rechoose, "))
    step = steps_of(loads(text).plan)[3]
    assert isinstance(step, FormStep)
    assert step.neighbours == ((2, 3), (1, 3), (1, 2))


def test_metres_and_units_are_the_same_mission() -> None:
    """Every length divided by the unit that was given."""
    scaled = in_metres()
    assert loads(scaled).plan == loads(TEXT).plan
    assert loads(dumps(loads(scaled).file)).plan == loads(TEXT).plan
    without = loads(scaled.replace("unit_m: 5\n", ""))
    assert without.plan.unit_m == pytest.approx(5)


@given(st.text("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789", min_size=1, max_size=4), st.integers(2, 40))
def test_letters_have_as_many_slots_as_asked_for_apart(text: str, count: int) -> None:
    slots = shapes.letter_slots(text, 10.0, count)
    assert slots.shape == (count, 2)
    assert np.all(slots >= -1e-9)
    assert slots[:, 0].max() <= 10 + 1e-9
    assert smallest_distance(slots) > 10.0 * len(text) / count / 4


def test_slots_from_csv(tmp_path: Path) -> None:
    """With or without a line of names; written again as offsets, the plan is the same."""
    (tmp_path / "row.csv").write_text("north,east\n0,0\n0,2\n0,4\n")
    path = tmp_path / "m.yaml"
    offsets = TEXT[TEXT.index("    kind: offsets") : TEXT.index("steps:")]
    path.write_text(edited((offsets, "    kind: csv\n    path: row.csv\n")))
    mission = load(path)
    assert mission.plan.hash() == loads(TEXT).plan.hash()
    assert loads(dumps(mission.file)).plan == mission.plan


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (None, "can't be read"),
        ("0,0\n0,x\n", "row.csv:2"),
        ("0,0,0,0\n", "row.csv:1"),
        ("0,0,0\n0,2\n", "row.csv:2"),
        ("0,0,0\n0,2,x\n", "row.csv:2"),
        ("", "no slot"),
        ("a,b\nc,d\n", "row.csv:2"),
    ],
)
def test_bad_csv(tmp_path: Path, content: str | None, what: str) -> None:
    """The mission's line that names the file, and the file's own."""
    if content is not None:
        (tmp_path / "row.csv").write_text(content)
    path = tmp_path / "m.yaml"
    offsets = TEXT[TEXT.index("    kind: offsets") : TEXT.index("steps:")]
    path.write_text(edited((offsets, "    kind: csv\n    path: row.csv\n")))
    with pytest.raises(MissionError) as caught:
        load(path)
    found = [p for p in caught.value.problems if p.field == "shapes.row.path"]
    assert found
    assert found[0].where == f"{path}:19"
    assert what in found[0].what


@given(st.lists(st.integers(1, 8), min_size=0, max_size=3, unique=True))
def test_bridging_keeps_a_connected_graph_connected(lost: list[int]) -> None:
    path = graph.of_links(range(1, 9), [(i, i + 1) for i in range(1, 8)])
    left = graph.bridged(path, lost)
    assert set(left) == set(path) - set(lost)
    assert len(graph.components(left)) <= 1


def test_a_kind_of_step_has_a_half_in_the_core_and_one_in_missions() -> None:
    """Under the same name in both tables."""
    flown = {step.__dataclass_fields__["kind"].default for step in get_args(AnyStep)}
    assert flown == KINDS.keys()
