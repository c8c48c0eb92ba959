"""The way back: climb, wait for the turn, fly, down; at most one agent flies at a time."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.agent.return_to_launch import (
    HEIGHT_TOLERANCE_M,
    ReturnStage,
    ReturnToLaunch,
    deserted,
    return_height_m,
)
from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import Fence, Policies
from swarm_ctl.core.swarm.snapshot import OtherAircraft
from tests.unit.core.builders import HEIGHT_M, NOW, fix, peer, plan, snapshot

CLIMB, WAIT, FLY, DOWN = ReturnStage
NEVER = math.inf


def returning(agent: int, stage: ReturnStage, age_s: float = 0.1, **changes: Any) -> OtherAircraft:
    return peer(agent, age_s, phase=Phase.RETURN, stage=int(stage), **changes)


def way_back(agent: int, *peers: OtherAircraft) -> ReturnToLaunch:
    """Of an agent that has been at its height for a second."""
    way = ReturnToLaunch(plan(), agent)
    for now in (NOW, NOW + 1.0):
        way.update(snapshot(*peers, now=now), fix(), way.height_m)
    return way


# --- heights ---


def test_each_agent_has_a_height_of_its_own() -> None:
    assert [return_height_m(plan(), i) for i in (1, 2, 3)] == [HEIGHT_M, 11.0, 14.0]


@pytest.mark.parametrize(
    ("fence_m", "heights"), [(16.0, [8.0, 11.0, 14.0]), (14.0, [8.0, 10.0, 12.0]), (9.0, [8.0] * 3)]
)
def test_the_heights_stay_two_metres_below_the_fence(fence_m: float, heights: list[float]) -> None:
    """As far as that is possible, with equal separations."""
    fenced = plan(fence=Fence((), fence_m))
    assert [return_height_m(fenced, i) for i in (1, 2, 3)] == heights


def test_the_separation_is_the_missions() -> None:
    wide = plan(policies=Policies(return_separation_m=5.0))
    assert return_height_m(wide, 3) == HEIGHT_M + 10.0


# --- up ---


@pytest.mark.parametrize("off_m", [HEIGHT_TOLERANCE_M + 0.01, -HEIGHT_TOLERANCE_M - 0.01])
def test_it_climbs_until_it_is_at_its_height(off_m: float) -> None:
    way = ReturnToLaunch(plan(), 1)
    for second in range(5):
        way.update(snapshot(now=NOW + second), fix(), way.height_m + off_m)
    assert way.stage is CLIMB


def test_it_stays_a_second_at_its_height_first() -> None:
    """Meanwhile the states of its peers arrive. Off the height, the second begins anew."""
    way = ReturnToLaunch(plan(), 1)

    def after(seconds: float, off_m: float = 0.0) -> ReturnStage:
        return way.update(snapshot(now=NOW + seconds), fix(), way.height_m + off_m)

    assert [after(0.0), after(0.9)] == [CLIMB, CLIMB]
    assert after(0.95, off_m=1.0) is CLIMB
    assert [after(1.0), after(1.95)] == [CLIMB, CLIMB]
    assert after(2.0) is FLY


# --- whose turn ---

TURNS: list[tuple[str, list[OtherAircraft], ReturnStage]] = [
    ("the peers fly the mission", [peer(1), peer(3)], FLY),
    ("a lower id climbs", [returning(1, CLIMB), peer(3)], WAIT),
    ("a lower id waits", [returning(1, WAIT), peer(3)], WAIT),
    ("a lower id flies", [returning(1, FLY), peer(3)], WAIT),
    ("a lower id lands", [returning(1, DOWN), returning(3, WAIT)], FLY),
    ("a higher id waits", [returning(1, DOWN), returning(3, WAIT)], FLY),
    ("a higher id flies", [returning(1, DOWN), returning(3, FLY)], WAIT),
    ("a lower id is not heard", [returning(1, WAIT, age_s=1.01), peer(3)], FLY),
    ("a lower id is just heard", [returning(1, WAIT, age_s=1.0), peer(3)], WAIT),
    ("a lower id was never heard", [peer(1, NEVER), peer(3)], FLY),
    ("no peer is heard", [peer(1, 2.0), peer(3, 2.0)], WAIT),
    ("the silent peers are on the ground", [peer(i, 9.0, airborne=False) for i in (1, 3)], FLY),
    ("the silent peers have ended", [peer(i, 9.0, phase=Phase.ENDED) for i in (1, 3)], FLY),
]


@pytest.mark.parametrize(("what", "peers", "stage"), TURNS, ids=[row[0] for row in TURNS])
def test_whose_turn_it_is(what: str, peers: list[OtherAircraft], stage: ReturnStage) -> None:
    """As agent 2 sees it, at its height."""
    assert way_back(2, *peers).stage is stage


@given(st.lists(st.sampled_from([CLIMB, WAIT, FLY, DOWN]), min_size=3, max_size=3))
def test_at_most_one_agent_sets_out(stages: list[ReturnStage]) -> None:
    """If all hear each other, of those that wait at most one sets out; none while a peer flies."""
    out = []
    for agent, stage in zip((1, 2, 3), stages, strict=True):
        others = [returning(i, s) for i, s in zip((1, 2, 3), stages, strict=True) if i != agent]
        if stage is WAIT and way_back(agent, *others).stage is FLY:
            out.append(agent)
    assert len(out) <= (0 if FLY in stages else 1)


def test_an_agent_that_hears_no_peer_knows_no_order() -> None:
    assert deserted(snapshot(peer(2, 2.0), peer(3, NEVER)))
    assert not deserted(snapshot(peer(2, 2.0), peer(3)))
    assert not deserted(snapshot(peer(2, NEVER), peer(3, NEVER)))


# --- home ---


def flying() -> ReturnToLaunch:
    way = way_back(1, peer(2), peer(3))
    assert way.stage is FLY
    return way


@pytest.mark.parametrize(
    ("what", "north", "speed", "seconds", "stage"),
    [
        ("over its start", 0.4, 0.0, 0.0, DOWN),
        ("beside its start", 0.6, 0.0, 0.0, FLY),
        ("over its start, still moving", 0.4, 0.31, 0.0, FLY),
        ("stands on the way", 20.0, 0.0, 8.0, FLY),
        ("blocked on the way", 20.0, 0.0, 8.01, DOWN),
        ("on its way", 20.0, 1.0, 60.0, FLY),
    ],
)
def test_when_it_goes_down(
    what: str, north: float, speed: float, seconds: float, stage: ReturnStage
) -> None:
    """Slow over its start, or after standing still for more than 8 s."""
    way, at = flying(), fix(north, velocity=(speed, 0.0, 0.0))
    for now in (NOW + 2.0, NOW + 2.0 + seconds):
        way.update(snapshot(now=now), at, way.height_m)
    assert way.stage is stage


def test_a_move_begins_the_wait_anew() -> None:
    way = flying()
    for second in range(40):
        speed = 1.0 if second % 7 == 0 else 0.0
        way.update(snapshot(now=NOW + 2 + second), fix(20, velocity=(speed, 0, 0)), way.height_m)
    assert way.stage is FLY


def test_without_a_position_nothing_changes_and_down_is_final() -> None:
    way = flying()
    assert way.update(snapshot(now=NOW + 99.0), None, 0.0) is FLY
    way.update(snapshot(now=NOW + 99.0), fix(), way.height_m)
    assert way.update(snapshot(now=NOW + 99.1), fix(30.0), 0.0) is DOWN


def test_home_is_the_own_start() -> None:
    assert ReturnToLaunch(plan(), 3).home_m == (0.0, 20.0)
    moved = replace(plan(), unit_m=1.0)
    assert ReturnToLaunch(moved, 3).home_m == (0.0, 10.0)
