"""A move in file: who goes when, where to, and what a lost one changes."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from swarm_ctl.core.control.in_file import InFile, gap_m
from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.swarm.snapshot import OtherAircraft, PeerSnapshot
from tests.unit.core.builders import NOW, UNIT_M, plan

PLAN = plan()
GAP_M = gap_m(PLAN)
SLOTS: dict[int, Point] = {1: (-3.0, 0.0), 2: (0.0, 0.0), 3: (3.0, 0.0)}
"""3 is the front one [units]."""
STEP = MoveStep(((60.0, 0.0), (60.0, 80.0)), 4.0, 0.5, 2.0, 100.0, opens_m=20.0)
MIDDLE = (0.0, 0.0)
PLANNED_M = MIDDLE, STEP.waypoints_m[0]


def at_start() -> dict[int, Point]:
    return {i: (north * UNIT_M, east * UNIT_M) for i, (north, east) in SLOTS.items()}


def heard(places: dict[int, Point], own: int, lost: tuple[int, ...] = ()) -> PeerSnapshot:
    peers = tuple(
        OtherAircraft(i, stop_point=complex(*at), position=complex(*at), followed=i not in lost)
        for i, at in places.items()
        if i != own
    )
    return PeerSnapshot(NOW, peers)


def place(
    places: dict[int, Point],
    own: int,
    *,
    lost: tuple[int, ...] = (),
    departed: tuple[int, ...] = (),
) -> Point | None:
    """Where one of them flies first."""
    peers = heard(places, own, lost)
    return InFile(PLAN, own).place(STEP, PLANNED_M, MIDDLE, SLOTS, places[own], peers, departed)


def fly(files: dict[int, InFile], places: dict[int, Point], step: MoveStep, middle: Point) -> None:
    """A tick of perfect vehicles at 4 m/s."""
    told = dict(places)
    for i, file in files.items():
        to = file.place(step, PLANNED_M, middle, SLOTS, told[i], heard(told, i), ())
        if to is not None:
            way = complex(*to) - complex(*told[i])
            moved = way * min(1.0, 0.2 / max(abs(way), 1e-9))
            places[i] = told[i][0] + moved.real, told[i][1] + moved.imag


def test_one_that_is_lost_or_has_left_is_followed_by_nobody() -> None:
    places = at_start()
    assert place(places, 2, lost=(3,)) is not None
    assert place(places, 2, departed=(3,)) is not None
    assert place(places, 1, lost=(3,)) is None


@pytest.mark.parametrize("ticks", [0, 150, 300, 450])
def test_all_go_over_to_another_way_from_where_they_are_in_the_same_order(ticks: int) -> None:
    """With one that forgets all when it is half through, and the frame gone ahead; and back to the
    first way."""
    round_it = replace(STEP, waypoints_m=((30.0, -10.0), *STEP.waypoints_m))
    files, places = {i: InFile(PLAN, i) for i in SLOTS}, at_start()
    passed, least = dict[int, int](), math.inf
    for tick in range(3000):
        step = round_it if ticks <= tick < ticks + 200 else STEP
        if tick == ticks + 100:
            files[2] = InFile(PLAN, 2)
        fly(files, places, step, MIDDLE if tick < ticks else (60.0, 60.0))
        for i in SLOTS:
            if places[i][0] > 45.0:
                passed.setdefault(i, tick)
        way = [i for i in SLOTS if 0.0 < places[i][0] < 45.0]
        gaps = [math.dist(places[i], places[j]) for i in way for j in way if i < j]
        least = min([least, *gaps])
    assert sorted(passed, key=lambda i: passed[i]) == [3, 2, 1]
    assert least > 0.7 * GAP_M
    for i, slot in SLOTS.items():
        goal = 60.0 + slot[0] * UNIT_M, 80.0 + slot[1] * UNIT_M
        assert math.dist(places[i], goal) < 0.5


def test_a_way_that_comes_back_beside_itself_is_not_taken_for_its_end() -> None:
    hook = MoveStep(((60.0, 0.0), (60.0, 4.0), (0.0, 4.0)), 4.0, 0.5, 2.0, 100.0, opens_m=5.0)
    file, places = InFile(PLAN, 3), at_start()
    to = file.place(hook, PLANNED_M, MIDDLE, SLOTS, places[3], heard(places, 3), ())
    assert to is not None
    assert to[1] == 0.0
