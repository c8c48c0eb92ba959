"""The planned formation agrees with the frame that flies it, and each step with its own rule."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.model.geometry import mean_of
from swarm_ctl.core.model.planned_formation import Frame, PlannedFormation
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.steps.rotate import RotateStep
from swarm_ctl.core.model.steps.scale import ScaleStep
from swarm_ctl.core.model.steps.takeoff import TakeoffStep

UNIT_M = 5.0
POINT = st.tuples(st.floats(-20, 20), st.floats(-20, 20))
FORMATIONS = st.builds(
    lambda slots, centre, angle, scale: PlannedFormation(
        tuple(slots), UNIT_M, centre, angle, scale, formed=True
    ),
    st.lists(POINT, min_size=2, max_size=6),
    POINT,
    st.floats(-7, 7),
    st.floats(0.2, 4),
)
MOVE = MoveStep(((30.0, 0.0), (30.0, 40.0)), 1.0, 0.5, 2.0, 60.0)
ROTATE = RotateStep(1.0, 1.0, 0.5, 2.0, 60.0)
SCALE = ScaleStep(2.0, 1.0, 0.5, 2.0, 60.0)


@given(FORMATIONS, st.sampled_from([MOVE, ROTATE, SCALE]))
def test_legs_are_as_long_as_the_frame_that_flies_them_says(
    formation: PlannedFormation, step: MoveStep | RotateStep | ScaleStep
) -> None:
    """The plan's checks and time-outs reckon with the way that the reference then flies."""
    frame = Frame(formation.centre_m, formation.angle_rad, formation.scale)
    radius_m = formation.radius_m / formation.scale
    assert step.legs_m(formation)[0] == pytest.approx(step.left_m(frame, radius_m), abs=1e-9)


@given(FORMATIONS)
def test_places_are_the_slots_turned_and_scaled_about_the_centre(
    formation: PlannedFormation,
) -> None:
    places = formation.places_m()
    assert mean_of(places) == pytest.approx(formation.centre_m, abs=1e-9)
    for i, j in ((0, 1), (1, -1)):
        apart = math.dist(formation.slots[i], formation.slots[j]) * formation.scale
        assert math.dist(places[i], places[j]) == pytest.approx(apart * UNIT_M, abs=1e-9)
    assert [north / UNIT_M for north, _ in places] == pytest.approx(
        [north for north, _ in formation.places], abs=1e-9
    )


def test_each_step_changes_what_it_names() -> None:
    """A move takes the centre along, turns and scales are of the form step's slots, and the next
    form step begins anew."""
    start = PlannedFormation.at_start([(0.0, 0.0), (0.0, 2.0)], UNIT_M)
    assert (start.centre_m, start.formed) == ((0.0, 5.0), False)
    form = FormStep("pair", ((1.0, 0.0), (-1.0, 0.0)), 0.5, 5.0, 60.0)
    formation = start
    for step in (TakeoffStep(10.0, 60.0), form, ROTATE, SCALE, MOVE):
        formation = step.after(formation)
    assert formation == PlannedFormation(
        form.slots, UNIT_M, (30.0, 40.0), 1.0, 2.0, height_m=10.0, formed=True
    )
    again = form.after(formation)
    assert (again.angle_rad, again.scale, again.centre_m) == (0.0, 1.0, (30.0, 40.0))
