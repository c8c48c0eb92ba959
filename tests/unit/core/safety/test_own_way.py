"""One vehicle's way to its place: straight where it can, else from corner to corner."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest

from swarm_ctl.core.model.plan import Fence
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.safety.own_way import OwnWay, WayLeg, wish_on
from swarm_ctl.core.safety.ways import WayMap

CORNERS = ((20.0, -15.0), (21.0, -15.0), (21.0, 15.0), (20.0, 15.0))
WALL = Zone("wall", CORNERS, 0.0, 1.25, None, 20.0)
FAR = 40 + 2j


def way(*zones: Zone, fence: Fence | None = None) -> OwnWay:
    return OwnWay(zones, fence, 0.05)


def found(of: OwnWay, goal: complex, own: complex = 0j) -> WayLeg:
    """The leg, once the search is over."""
    for _ in range(200):
        leg = of.leg(own, goal, 4.0, 4.0)
    return leg


def test_without_zones_in_a_convex_fence_each_line_is_free() -> None:
    box = ((-10.0, -10.0), (90.0, -10.0), (90.0, 90.0), (-10.0, 90.0))
    hook = ((0.0, 0.0), (90.0, 0.0), (90.0, 90.0), (80.0, 90.0), (80.0, 10.0), (0.0, 10.0))
    assert way(fence=Fence(box, 50.0)).free
    assert way(fence=Fence(box[::-1], 50.0)).free
    assert way(fence=Fence((), 50.0)).free
    assert not way(fence=Fence(hook, 50.0)).free
    leg = found(way(fence=Fence(hook, 50.0)), 85 + 80j, 5 + 5j)
    assert (leg.round, leg.exists) == ("the fence", True)


def test_a_zone_at_other_heights_cuts_nothing() -> None:
    leg = way(WALL).leg(0j, FAR, 30.0, 30.0)
    assert (leg.to, leg.round) == (FAR, "")


def test_a_vehicle_that_flies_the_legs_comes_to_its_place() -> None:
    """Perfect vehicles, 0.05 s a tick: off the wall all the way, and hardly longer than the
    shortest way."""
    of, at, flown_m, nearest = way(WALL), 0j, 0.0, math.inf
    for _ in range(2000):
        leg = of.leg(at, FAR, 4.0, 4.0)
        wish = wish_on(leg, at, 4.0, 5.0) if leg.round else FAR - at
        step = wish * min(1.0, 5.0 / max(abs(wish), 1e-9)) * 0.05
        at, flown_m = at + step, flown_m + abs(step)
        off = complex(max(20 - at.real, 0.0, at.real - 21), max(abs(at.imag) - 15, 0.0))
        nearest = min(nearest, abs(off))
    assert abs(at - FAR) < 0.1
    shortest_m = abs(complex(20 - 1.75, 15)) + 4 + abs(FAR - complex(22.75, 15))
    assert flown_m < 1.1 * shortest_m
    assert nearest > 1.5


def test_where_there_is_no_way_none_is_flown() -> None:
    box = ((-10.0, -14.0), (90.0, -14.0), (90.0, 14.0), (-10.0, 14.0))
    leg = found(way(WALL, fence=Fence(box, 50.0)), FAR)
    assert (leg.exists, leg.round) == (False, "zone wall")
    assert wish_on(leg, 0j, 4.0, 5.0) == 0j


def test_no_call_does_more_than_its_part_of_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Among fifty trees a whole search takes a second: an agent has 50 ms for a tick."""
    looks = 0
    sees = WayMap.sees

    def counted(self: WayMap, point: complex, others: Any) -> Any:
        nonlocal looks
        looks += 1
        return sees(self, point, others)

    monkeypatch.setattr(WayMap, "sees", counted)
    dice, trees = random.Random(3), list[Zone]()
    while len(trees) < 50:
        at, r = (dice.uniform(5, 95), dice.uniform(-50, 50)), dice.uniform(0.5, 3)
        if all(math.dist(at, t.corners_m[0]) > r + t.radius_m + 4 for t in trees):
            trees.append(Zone(f"tree-{len(trees)}", (at,), r, 1.25))
    of, most = way(*trees), 0
    for _ in range(300):
        looks = 0
        leg = of.leg(0j, 100 + 0j, 4.0, 4.0)
        most = max(most, looks)
    assert leg.exists
    assert abs(leg.to) > 1.0
    assert most <= 12
