"""What sources of constraints ask for, and the velocity that follows."""

from __future__ import annotations

import pytest

from swarm_ctl.core.kernel.constraints import Other, cap, keep_out, margins_of
from swarm_ctl.core.kernel.decide import Link, NearWall, Own, decided
from swarm_ctl.core.kernel.program import Row
from swarm_ctl.core.kernel.walls import Wall, wall_margins_of
from swarm_ctl.core.model.plan import LawParameters, Response

MARGINS = margins_of(LawParameters(), Response(), 5.0, 5.0)
FAR_M = MARGINS.keep_out + MARGINS.firm + 1.0


def other(about: int, apart: complex, *, along: bool = True) -> Other:
    """One that stands, and whose news is of now."""
    return Other(about, True, apart, 0j, 0.0, 0.0, True, 0.0, along)


def test_one_that_forbids_nothing_within_the_speed_limit_asks_for_no_row() -> None:
    others = [other(2, complex(-FAR_M, 0.0)), other(3, complex(0.0, MARGINS.keep_out))]
    rows: list[Row] = []
    found = decided(5 + 0j, others, 2, [], 0, [], 0, Own(0.0, 0.6, 0j), MARGINS, rows)
    assert [row.about for row in rows[: found.used]] == [3]
    alone = decided(5 + 0j, others[1:], 1, [], 0, [], 0, Own(0.0, 0.6, 0j), MARGINS, [])
    assert alone.velocity == found.velocity
    free = decided(5 + 0j, others, 1, [], 0, [], 0, Own(0.0, 0.6, 0j), MARGINS, [])
    assert free == (5 + 0j, 5 + 0j, 0, False, False)


def test_one_that_a_moving_formation_meets_asks_for_its_row_from_farther_away() -> None:
    """Rows are about the difference to the velocity that the formation shares."""
    others = [other(2, complex(-FAR_M, 0.0), along=False)]
    found = decided(5 + 0j, others, 1, [], 0, [], 0, Own(0.0, 0.6, 5 + 0j), MARGINS, [])
    assert found.used == 1


def test_who_is_under_the_keep_out_leaves_as_fast_as_that_asks() -> None:
    """Caution does not hold it there, nor does that near a third one."""
    margins = margins_of(LawParameters(r_in=0.72), Response(), 3.0, 2.0)
    near = other(2, complex(0.5 * margins.keep_out, 0.0))
    third = other(3, complex(0.0, margins.keep_out))
    _, bound, room = keep_out(near, margins)
    assert bound > cap(room, 0.0, margins)
    for others in ([near], [near, third]):
        known = others, len(others), [], 0, [], 0
        found = decided(0j, *known, Own(0.0, 0.6, 0j), margins, [])
        assert abs(found.velocity - bound) < 1e-6
        assert not found.yielded


AWAY = Link(2, complex(MARGINS.r, 0.0), 0j, 0j, along=True)
"""Longer than the guard allows, to one that stands."""


@pytest.mark.parametrize(
    ("moving", "along", "guarded"),
    [(0j, True, True), (0j, False, True), (3 + 0j, True, True), (3 + 0j, False, False)],
)
def test_a_moving_formation_keeps_to_those_that_fly_along(
    moving: complex, along: bool, guarded: bool
) -> None:
    """By the velocity that they share: within it, links hold as in a formation that stands."""
    link = AWAY._replace(along=along, setpoint=moving)
    own = Own(0.0, 0.6, moving)
    found = decided(moving + 1, [], 0, [link], 1, [], 0, own, MARGINS, [])
    assert found.used == int(guarded)
    pulled = (found.velocity - moving).real
    assert pulled < -0.01 if guarded else pulled == 1.0


def test_a_velocity_that_is_shared_is_not_asked_for_twice() -> None:
    others = [other(2, complex(0.0, FAR_M))]
    own = Own(0.0, 0.6, 3 + 0j)
    found = decided(3.5 + 0.5j, others, 1, [], 0, [], 0, own, MARGINS, [])
    assert (found.velocity, found.wish, found.touched) == (3.5 + 0.5j, 0.5 + 0.5j, False)


@pytest.mark.parametrize("gap_m", [0.0, 0.5, 1.5])
def test_no_aircraft_pushes_another_into_a_wall(gap_m: float) -> None:
    walls = wall_margins_of(1.25, Response(), 5.0)
    near = other(2, complex(-0.5 * MARGINS.keep_out, 0.0))
    wall = NearWall(Wall(1 + 0j, gap_m, 3), walls)
    found = decided(-1 + 0j, [near], 1, [], 0, [wall], 1, Own(0.0, 0.6, 0j), MARGINS, [])
    assert found.velocity.real >= -1e-6
