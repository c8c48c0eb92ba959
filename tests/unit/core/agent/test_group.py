"""What a mission waits for: the barrier's members, the peers it is flown without, the formation's
error."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from swarm_ctl.core.agent.group import Group
from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import Plan, Policies, Policy
from swarm_ctl.core.swarm.snapshot import OtherAircraft, PeerSnapshot
from tests.unit.core.builders import (
    FORM,
    HOLD,
    LAST,
    SLOTS,
    UNIT_M,
    Own,
    fix,
    peer,
    plan,
    snapshot,
    tick,
)

NEVER = math.inf
NOWHERE = (0.0, 0.0)
GOING_ON = plan(policies=Policies(agent_lost=Policy.CONTINUE))
BLOCKS = (-1, False)


def group(of: Plan | None = None) -> Group:
    return Own(of).group


def compared(peers: PeerSnapshot, of: Plan | None = None) -> list[tuple[int, bool]]:
    heard = replace(tick(), peers=peers)
    return list(group(of).told(heard, airborne=True).values())


# --- members ---

MEMBERS: list[tuple[str, OtherAircraft, tuple[int, bool]]] = [
    ("at work", peer(2, step=HOLD), (HOLD, False)),
    ("done", peer(2, step=HOLD, done=True), (HOLD, True)),
    ("just heard", peer(2, 5.0, step=HOLD, done=True), (HOLD, True)),
    ("silent", peer(2, 5.01, step=HOLD, done=True), BLOCKS),
    ("never heard", peer(2, NEVER), BLOCKS),
    ("silent after its last step", peer(2, 60.0, step=LAST, done=True), (LAST, True)),
    ("silent in its last step", peer(2, 60.0, step=LAST), BLOCKS),
    ("gave up", peer(2, phase=Phase.LAND, step=HOLD, done=True), (HOLD, True)),
]


@pytest.mark.parametrize(("what", "other", "told"), MEMBERS, ids=[row[0] for row in MEMBERS])
def test_what_a_peer_shows(what: str, other: OtherAircraft, told: tuple[int, bool]) -> None:
    """(step, done) while it is heard; a silent peer blocks, but for one that completed."""
    assert compared(snapshot(other, peer(3, step=FORM))) == [told, (FORM, False)]


# --- lost ---


def test_on_the_ground_no_peer_is_left_behind() -> None:
    assert group(GOING_ON).lost(snapshot(peer(2, 60.0), peer(3)), airborne=False) == set()


# --- the formation's error ---


def formed(of: Plan | None = None, step: int = HOLD) -> Group:
    """Its shape is the starts' row."""
    made = Own(of, step).group
    made.reference.form(SLOTS)
    return made


def error_m(
    *peers: OtherAircraft,
    of: Plan | None = None,
    own: OwnFix | None = fix(),  # noqa: B008 - frozen
) -> float | None:
    measured = formed(of)
    measured.measure(tick(*peers, fix=own), NOWHERE, airborne=True)
    return measured.formation_error_m


def beside(agent: int, north_m: float, **changes: Any) -> OtherAircraft:
    """A peer so far north of its slot."""
    east = UNIT_M * SLOTS[agent - 1][1]
    return peer(agent, position_ned_m=(north_m, east, -8.0), **changes)


def test_a_formation_in_its_shape_has_no_error() -> None:
    """Wherever it is: only the shape counts."""
    assert error_m() == pytest.approx(0.0)
    assert error_m(beside(2, 7.0), beside(3, 7.0), own=fix(7.0)) == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("what", "peers", "own"),
    [
        ("no own position", (peer(2), peer(3)), None),
        ("an old own position", (peer(2), peer(3)), fix(age_s=0.51)),
        ("a state that is not fresh", (peer(2), peer(3, 0.51)), fix()),
        ("a peer never heard", (peer(2), peer(3, NEVER)), fix()),
    ],
)
def test_it_is_unknown_unless_all_are_fresh(
    what: str, peers: tuple[OtherAircraft, ...], own: OwnFix | None
) -> None:
    assert error_m(*peers, own=own) is None
