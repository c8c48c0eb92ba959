"""The geofence: inside, outside, too high."""

from __future__ import annotations

from hypothesis import assume, given
from hypothesis import strategies as st

from swarm_ctl.core.model.plan import Fence
from swarm_ctl.core.safety.fence import area, crossing_edges, inside, leaves, outside

BOX = ((-10.0, -20.0), (10.0, -20.0), (10.0, 20.0), (-10.0, 20.0))
HOOK = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (8.0, 10.0), (8.0, 2.0), (0.0, 2.0))


@given(st.floats(-30, 30), st.floats(-30, 30))
def test_a_box(north: float, east: float) -> None:
    assume(abs(abs(north) - 10) > 1e-6 and abs(abs(east) - 20) > 1e-6)
    assert inside(BOX, (north, east)) == (abs(north) < 10 and abs(east) < 20)


def test_a_concave_one() -> None:
    assert inside(HOOK, (5.0, 1.0))
    assert inside(HOOK, (9.0, 9.0))
    assert not inside(HOOK, (5.0, 5.0))


def test_a_fence_that_crosses_itself_is_found_and_what_it_encloses_known() -> None:
    assert (crossing_edges(BOX), crossing_edges(HOOK), crossing_edges(())) == (None, None, None)
    assert crossing_edges((BOX[0], BOX[2], BOX[1], BOX[3])) == (0, 2)
    assert (area(BOX), area(BOX[::-1]), area(HOOK)) == (800.0, 800.0, 36.0)


def test_what_is_said() -> None:
    fence = Fence(BOX, 40.0)
    assert outside(fence, (0.0, 0.0), 39.0) == ""
    assert outside(fence, (0.0, 0.0), 41.0) == "41.0 m high; the geofence ends at 40 m"
    assert outside(fence, (11.0, 0.0), 5.0) == "outside the geofence"
    assert outside(None, (1e6, 0.0), 1e6) == ""
    assert outside(Fence((), 40.0), (1e6, 0.0), 5.0) == ""


def test_a_way_leaves_a_concave_fence_between_two_places_inside() -> None:
    """An L: both ends are inside, the straight line between them is not; round the corner it is."""
    bend = ((0.0, 0.0), (0.0, 10.0), (4.0, 10.0), (4.0, 4.0), (10.0, 4.0), (10.0, 0.0))
    assert inside(bend, (2.0, 9.0))
    assert inside(bend, (9.0, 2.0))
    assert leaves(bend, (2.0, 9.0), (9.0, 2.0))
    assert not leaves(bend, (2.0, 9.0), (2.0, 2.0))
    assert leaves(bend, (2.0, 9.0), (2.0, 11.0))
