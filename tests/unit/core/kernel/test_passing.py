"""An aircraft that stays is passed on the side that walls leave."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.kernel.constraints import nearest
from swarm_ctl.core.kernel.decide import NearWall, freer_side
from swarm_ctl.core.kernel.walls import NO_WALL_MARGINS, Wall
from swarm_ctl.core.kernel.wish import PASSES, bent

SOUTH_OF_IT = -3 + 0j
"""From the aircraft to us: we want north."""
EAST, WEST = 1j, -1j


def walls(*normals: complex) -> list[NearWall]:
    """Each points from its wall to us."""
    return [NearWall(Wall(normal, 1.0, 0), NO_WALL_MARGINS) for normal in normals]


def side_flown(near: list[NearWall]) -> float:
    """How far east a wish to the north is bent."""
    side = freer_side(SOUTH_OF_IT, near, len(near))
    return bent(1 + 0j, SOUTH_OF_IT, 0.0, side).imag


def test_on_free_air_all_pass_on_the_same_side() -> None:
    assert side_flown([]) > 0.5
    assert side_flown(walls(-1 + 0j)) > 0.5


def test_a_wall_turns_the_side_round() -> None:
    """A wall in the east, and one in the west that is no hindrance."""
    assert side_flown(walls(WEST)) < -0.5
    assert side_flown(walls(EAST)) > 0.5


def test_between_two_walls_the_one_that_slants_away_decides() -> None:
    slants = (EAST + 1) / abs(EAST + 1)
    assert side_flown(walls(WEST, slants)) < -0.5
    assert side_flown(walls(EAST, slants.conjugate())) > 0.5


def test_only_the_first_walls_are_near() -> None:
    assert freer_side(SOUTH_OF_IT, walls(WEST), 0) == PASSES


NUMBER = st.floats(-10, 10)


@given(NUMBER, NUMBER, NUMBER, NUMBER, st.floats(0, 5), st.floats(0, 1))
def test_no_place_that_it_may_have_flown_to_is_nearer(
    north: float, east: float, flies_north: float, flies_east: float, seconds: float, part: float
) -> None:
    apart, flies = complex(north, east), complex(flies_north, flies_east)
    found = abs(nearest(apart, flies, seconds))
    assert found <= abs(apart - flies * seconds * part) + 1e-6
