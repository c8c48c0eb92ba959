"""The way back: climb, fly, down; of two in each other's way the higher id makes room."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from swarm_ctl.core.agent.return_to_launch import ReturnToLaunch, deserted, return_height_m
from swarm_ctl.core.model.messages import Phase, ReturnStage
from swarm_ctl.core.model.plan import Fence
from swarm_ctl.core.swarm.snapshot import OtherAircraft
from tests.unit.core.builders import NOW, fix, peer, plan, snapshot

CLIMB, WAIT, FLY, DOWN = ReturnStage
NEVER = math.inf
BESIDE = (40.0, 1.0)
"""A metre from where the agent stands that can't go on."""


def returning(agent: int, stage: ReturnStage, age_s: float = 0.1, **changes: Any) -> OtherAircraft:
    given = {"phase": Phase.RETURN, "stage": int(stage), "stop_point_m": BESIDE} | changes
    return peer(agent, age_s, **given)


def stays(agent: int, phase: Phase) -> OtherAircraft:
    return peer(agent, phase=phase, stop_point_m=BESIDE)


# --- heights ---


@pytest.mark.parametrize(
    ("fence_m", "heights"), [(16.0, [8.0, 11.0, 14.0]), (14.0, [8.0, 10.0, 12.0]), (9.0, [8.0] * 3)]
)
def test_the_heights_stay_two_metres_below_the_fence(fence_m: float, heights: list[float]) -> None:
    """As far as that is possible, with equal separations."""
    fenced = plan(fence=Fence((), fence_m))
    assert [return_height_m(fenced, i) for i in (1, 2, 3)] == heights


# --- in each other's way ---

FAR_OFF = peer(3, stop_point_m=(200.0, 0.0))
BLOCKS: list[tuple[str, list[OtherAircraft], ReturnStage, bool]] = [
    ("nobody", [peer(1, NEVER), peer(3, NEVER)], DOWN, True),
    ("a lower id flies", [returning(1, FLY), peer(3, NEVER)], WAIT, False),
    ("a lower id climbs", [returning(1, CLIMB), peer(3, NEVER)], WAIT, False),
    ("a lower id makes room itself", [returning(1, WAIT), peer(3, NEVER)], WAIT, False),
    ("a lower id lands", [returning(1, DOWN), peer(3, NEVER)], FLY, False),
    ("a lower id lands in place", [stays(1, Phase.LAND), peer(3, NEVER)], FLY, False),
    ("a higher id flies", [peer(1, NEVER), returning(3, FLY)], FLY, False),
    ("a lower id that is silent", [returning(1, FLY, age_s=1.01), FAR_OFF], DOWN, True),
    ("one that hovers for good", [stays(1, Phase.HOLD), peer(3, NEVER)], DOWN, True),
    (
        "a lower id far away",
        [returning(1, FLY, stop_point_m=(200.0, 0.0)), peer(3, NEVER)],
        DOWN,
        True,
    ),
]


@pytest.mark.parametrize(
    ("what", "peers", "stage", "blocked"), BLOCKS, ids=[row[0] for row in BLOCKS]
)
def test_who_is_in_the_way_decides(
    what: str, peers: list[OtherAircraft], stage: ReturnStage, blocked: bool
) -> None:
    """As agent 2 sees it, which has stood still for 8 s away from its start: it makes room for a
    lower id, waits for what comes down, and else lands beside what stays."""
    way, at = ReturnToLaunch(plan(), 2), fix(40.0)
    for now in (NOW, NOW + 1.0, NOW + 2.0, NOW + 10.01):
        way.update(snapshot(*peers, now=now), at, way.height_m)
    assert (way.stage, way.blocked) == (stage, blocked)


def test_an_agent_that_hears_no_peer_knows_no_order() -> None:
    assert deserted(snapshot(peer(2, 2.0), peer(3, NEVER)))
    assert not deserted(snapshot(peer(2, 2.0), peer(3)))
    assert not deserted(snapshot(peer(2, NEVER), peer(3, NEVER)))
    expelled = replace(peer(3, 2.0), expelled=True)
    assert deserted(snapshot(peer(2, 2.0), expelled))
    assert not deserted(snapshot(peer(2, NEVER), expelled))
    ended = peer(3, 10.0, phase=Phase.ENDED)
    assert deserted(snapshot(peer(2, 14.9), ended))
    assert not deserted(snapshot(peer(2, 15.1), ended))  # lost, while the other one was heard
    assert deserted(snapshot(peer(2, 15.1), peer(3, 10.0)))


# --- home ---


def flying() -> ReturnToLaunch:
    way = ReturnToLaunch(plan(), 1)
    for now in (NOW, NOW + 1.0):
        way.update(snapshot(peer(2), peer(3), now=now), fix(), way.height_m)
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


def test_one_slow_word_of_a_vehicle_that_drifts_over_its_start_lands_nobody() -> None:
    """In wind it went on at 0.5 m/s under its landing mode, and was 3.4 m off."""
    way = flying()
    for k in range(20):
        slow = k % 4 == 3
        drifts = fix(0.3, velocity=(0.2 if slow else 0.5, 0.0, 0.0))
        assert way.update(snapshot(now=NOW + 2.0 + 0.05 * k), drifts, way.height_m) is FLY
    for k in range(40):
        way.update(snapshot(now=NOW + 3.0 + 0.05 * k), fix(0.3), way.height_m)
    assert way.stage is DOWN


def test_without_a_position_nothing_changes_and_down_is_final() -> None:
    way = flying()
    assert way.update(snapshot(now=NOW + 99.0), None, 0.0) is FLY
    way.update(snapshot(now=NOW + 99.0), fix(), way.height_m)
    assert way.update(snapshot(now=NOW + 99.1), fix(30.0), 0.0) is DOWN


def test_an_agent_that_hears_no_peer_sets_out_on_no_way_and_stops_on_one() -> None:
    """It goes on where a peer is heard again."""
    silent, way = (peer(2, 2.0), peer(3, 2.0)), ReturnToLaunch(plan(), 1)
    for now in (NOW, NOW + 1.0, NOW + 2.0):
        way.update(snapshot(*silent, now=now), fix(40.0), way.height_m)
    assert way.stage is WAIT
    heard = snapshot(peer(2), peer(3), now=NOW + 3.0)
    assert way.update(heard, fix(40.0), way.height_m) is FLY
    assert way.update(snapshot(*silent, now=NOW + 4.0), fix(40.0), way.height_m) is WAIT
