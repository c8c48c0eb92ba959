"""Which walls are near, and at which heights."""

from __future__ import annotations

import math

import pytest

from swarm_ctl.core.kernel.walls import FENCE
from swarm_ctl.core.model.plan import Fence, Response
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.safety.surroundings import Surroundings

TREE = Zone("tree", ((30.0, 0.0),), 2.0, 1.25)
HOUSE = Zone("house", ((-4.0, -4.0), (4.0, -4.0), (4.0, 4.0), (-4.0, 4.0)), 0.0, 1.25, None, 20.0)
BRIDGE = Zone("bridge", ((-4.0, -4.0), (4.0, -4.0), (4.0, 4.0), (-4.0, 4.0)), 0.0, 1.25, 10.0, 20.0)


def around(*zones: Zone, fence: Fence | None = None, scale_m: float = 1.0) -> Surroundings:
    return Surroundings(zones, fence, Response(), 5.0, scale_m)


def test_a_zone_counts_between_its_heights_and_a_little_beyond() -> None:
    for low_m, high_m, counts in (
        (5.0, 5.0, False),
        (9.0, 9.0, True),
        (15.0, 15.0, True),
        (21.0, 21.0, True),
        (22.0, 22.0, False),
        (5.0, 30.0, True),
    ):
        assert bool(around(BRIDGE).near(6 + 0j, low_m, high_m)) is counts


def test_what_is_far_is_looked_for_again_only_when_the_point_has_moved_so_far() -> None:
    """A vehicle that comes near sees the wall, wherever it was asked before."""
    walls = around(TREE)
    assert walls.near(0j, 5.0, 5.0) == []
    for north in range(30):
        near = walls.near(complex(north, 0.0), 5.0, 5.0)
        assert bool(near) is bool(around(TREE).near(complex(north, 0.0), 5.0, 5.0))
    assert near[0].wall.gap == pytest.approx(-1.0)


def test_from_the_wrong_side_the_nearest_wall_alone_leads_out() -> None:
    ((inside, _),) = around(HOUSE).near(3 + 1j, 5.0, 5.0)
    assert (inside.gap, inside.normal) == (pytest.approx(-1.0), pytest.approx(1 + 0j))
    fence = Fence(((-10.0, -10.0), (10.0, -10.0), (10.0, 10.0), (-10.0, 10.0)), 50.0)
    ((out, _),) = around(fence=fence).near(12 + 0j, 5.0, 5.0)
    assert (out.gap, out.normal, out.about) == (pytest.approx(-2.0), pytest.approx(-1 + 0j), FENCE)


def test_the_corner_that_two_edges_share_is_one_wall() -> None:
    ((corner, _),) = around(HOUSE).near(5 + 5j, 5.0, 5.0)
    assert corner.gap == pytest.approx(math.sqrt(2.0))
    assert len(around(HOUSE).near(5 + 2j, 5.0, 5.0)) > 1


def test_units_are_metres_divided() -> None:
    ((one, margins),) = around(TREE).near(25 + 0j, 5.0, 5.0)
    ((other, scaled),) = around(TREE, scale_m=5.0).near(5 + 0j, 5.0, 5.0)
    assert (5.0 * other.gap, 5.0 * scaled.keep) == pytest.approx((one.gap, margins.keep))


def test_a_vehicle_over_a_zone_may_fly_and_not_sink() -> None:
    walls = around(HOUSE)
    assert walls.near(0j, 30.0, 30.0) == []
    assert walls.blocked(walls.near(0j, 0.0, 30.0), 30.0)
    assert not walls.blocked(walls.near(0j, 0.0, 10.0), 10.0)
    assert walls.nearest_zone(walls.near(0j, 0.0, 30.0)) == "zone house"
    assert walls.nearest_zone(walls.near(7 + 0j, 0.0, 30.0)) == ""
