"""What an agent says of itself beside its state."""

from __future__ import annotations

from dataclasses import replace

from swarm_ctl.core.agent.status_report import RefusalsSaid
from swarm_ctl.core.model.messages import Refusal, RefusalReason
from tests.unit.core.builders import NOW


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
