"""An agent's account of itself: what comes from where, and what is None while it is unknown."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from swarm_ctl.core.agent.status_report import RefusalsSaid, status_report
from swarm_ctl.core.agent.steering import KeepClear, SetpointCount
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.model.messages import (
    AgentStatus,
    Echo,
    LinkReport,
    Outcome,
    Phase,
    Refusal,
    RefusalReason,
    TickReport,
)
from tests.unit.core.builders import NOW, OWN, Own, fix, peer, tick

LINKS = {2: LinkReport(0.1, 0.1, 0.2, 30, 1)}
LOOP = TickReport(count=7)


def report(seen: Tick | None = None, own: Own | None = None) -> AgentStatus:
    own = own or Own()
    own.group.formation_error_m = 0.25
    return status_report(
        seen or tick(),
        OWN,
        own.phase,
        own.reason,
        own.vehicle,
        own.group,
        own.interruption,
        own.controller,
        own.steering.setpoints,
        links=LINKS,
        loop=LOOP,
        bad_payloads=3,
    )


def test_what_is_handed_in_is_passed_on() -> None:
    told = report()
    assert (told.agent, told.time_s, told.formation_error_m) == (1, NOW, 0.25)
    assert (told.links, told.tick, told.bad_payloads) == (LINKS, LOOP, 3)


@pytest.mark.parametrize(
    ("what", "seen", "field", "value"),
    [
        ("mode", {"mode": "GUIDED"}, "mode", "GUIDED"),
        ("armed", {"armed": False}, "armed", False),
        ("in the air", {"on_ground": True}, "airborne", False),
        ("battery", {"battery_percent": None}, "battery_percent", None),
        ("height", {"fix": fix(height_m=5.0)}, "height_m", 5.0),
        ("no height", {"fix": None}, "height_m", None),
        ("an old height", {"fix": fix(age_s=99.0)}, "height_m", 8.0),
        ("heartbeat", {"heartbeat_s": NOW - 2.0}, "heartbeat_age_s", 2.0),
        ("no heartbeat", {"heartbeat_s": -math.inf}, "heartbeat_age_s", None),
        ("station", {"station_age_s": 1.5}, "station_age_s", 1.5),
        ("no station", {"station_age_s": None}, "station_age_s", None),
        ("echo", {"station_age_s": 1.5}, "echo", Echo("desk", NOW, 1.5)),
        ("no echo", {"station_age_s": None}, "echo", None),
    ],
)
def test_what_is_seen_in_the_tick(what: str, seen: dict[str, Any], field: str, value: Any) -> None:
    assert getattr(report(tick(**seen)), field) == value


def test_refusals_are_said_at_once_and_again_after_ten_seconds() -> None:
    """By owner and reason; a flood of them is one line in ten seconds."""
    said, refusal = RefusalsSaid(), Refusal("agent 7", RefusalReason.UNREADABLE, "a b", 1, NOW)
    other = replace(refusal, reason=RefusalReason.TOO_MANY, words="c")
    assert said.due((), NOW) == []
    assert said.due((refusal,), NOW) == ["refused on the mesh: a b"]
    assert said.due((refusal, other), NOW + 0.5) == ["refused on the mesh: c"]
    assert said.due((refusal, other), NOW + 9.9) == []
    assert said.due((refusal,), NOW + 10.0) == []  # the same one
    assert said.due((replace(refusal, time_s=NOW + 9.0),), NOW + 10.0) == [
        "refused on the mesh: a b"
    ]


def test_the_height_counts_from_the_take_off_point() -> None:
    assert report(own=Own(ground_m=3.0)).height_m == 5.0


def test_the_nearest_peer_is_a_fresh_one() -> None:
    """Horizontally; without a fresh peer or an own position there is none."""
    near = {"position_ned_m": (3.0, 4.0, -80.0)}
    told = report(tick(peer(2), peer(3, **near)))
    assert (told.nearest_agent, told.nearest_m) == (3, 5.0)
    told = report(tick(peer(2), peer(3, 0.51, **near)))
    assert (told.nearest_agent, told.nearest_m) == (2, 10.0)
    for seen in (tick(peer(2, 9.0), peer(3, 9.0)), tick(fix=None)):
        assert (report(seen).nearest_agent, report(seen).nearest_m) == (None, None)


def test_neighbours_are_the_heard_ones() -> None:
    assert report().neighbours == (2, 3)
    assert report(tick(peer(2), peer(3, 1.01))).neighbours == (2,)


def test_the_flight_so_far() -> None:
    own = Own()
    own.phase, own.reason = Phase.LAND, "why"
    for now in (NOW, NOW + 2.0):
        own.steering.fly(tick(now=now), KeepClear())
    told = report(own=own)
    assert (told.phase, told.step, told.done) == (Phase.LAND, 3, False)
    assert (told.setpoints, told.setpoint_rate_hz) == (2, 0.5)
    assert told.outcome is Outcome.RUNNING
    assert [step.name for step in told.steps] == ["prepare", "takeoff", "form row", "hold"]


def test_the_rate_of_setpoints_needs_two() -> None:
    count = SetpointCount()
    count.add(NOW)
    assert count.rate_hz == 0.0
    for tick_number in range(1, 41):
        count.add(NOW + 0.05 * tick_number)
    assert count.rate_hz == pytest.approx(20.0)
