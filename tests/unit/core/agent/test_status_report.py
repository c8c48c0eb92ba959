"""An agent's account of itself: what comes from where, and what is None while it is unknown."""

from __future__ import annotations

from dataclasses import replace

from swarm_ctl.core.agent.status_report import RefusalsSaid, status_report
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.model.messages import (
    AgentStatus,
    LinkReport,
    Refusal,
    RefusalReason,
    TickReport,
)
from tests.unit.core.builders import NOW, OWN, Own, peer, tick

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


def test_the_nearest_peer_is_a_fresh_one() -> None:
    """Horizontally; without a fresh peer or an own position there is none."""
    near = {"position_ned_m": (3.0, 4.0, -80.0)}
    told = report(tick(peer(2), peer(3, **near)))
    assert (told.nearest_agent, told.nearest_m) == (3, 5.0)
    told = report(tick(peer(2), peer(3, 0.51, **near)))
    assert (told.nearest_agent, told.nearest_m) == (2, 10.0)
    for seen in (tick(peer(2, 9.0), peer(3, 9.0)), tick(fix=None)):
        assert (report(seen).nearest_agent, report(seen).nearest_m) == (None, None)
