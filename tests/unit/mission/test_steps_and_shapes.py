"""Moves, CSV files, lengths in metres: what is loaded."""

from __future__ import annotations

import math
from pathlib import Path
from typing import get_args

import pytest

from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.steps.rotate import RotateStep
from swarm_ctl.core.model.steps.scale import ScaleStep
from swarm_ctl.core.model.steps.table import AnyStep
from swarm_ctl.errors import MissionError
from swarm_ctl.mission.compile.loader import dumps, load, loads
from swarm_ctl.mission.steps.table import KINDS
from tests.unit.mission.example import TEXT, edited, in_metres
from tests.unit.plans import steps_of

FORM = "  - form: {shape: ring}\n"


def with_step(step: str) -> str:
    return edited((FORM, FORM + f"  - {step}\n"))


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


def test_metres_and_units_are_the_same_mission() -> None:
    """Every length divided by the unit that was given."""
    scaled = in_metres()
    assert loads(scaled).plan == loads(TEXT).plan
    assert loads(dumps(loads(scaled).file)).plan == loads(TEXT).plan
    without = loads(scaled.replace("unit_m: 5\n", ""))
    assert without.plan.unit_m == pytest.approx(5)


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


def test_a_kind_of_step_has_a_half_in_the_core_and_one_in_missions() -> None:
    """Under the same name in both tables."""
    flown = {step.__dataclass_fields__["kind"].default for step in get_args(AnyStep)}
    assert flown == KINDS.keys()
