"""What `run` says while it waits."""

from __future__ import annotations

import pytest

from swarm_ctl.engine.launch import supervisor
from swarm_ctl.engine.launch.supervisor import Waiting


class Clock:
    """The wall clock, moved by hand."""

    now_s = 100.0

    def wall_s(self) -> float:
        return self.now_s


def test_it_says_every_five_seconds_what_it_waits_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing for a short wait; what comes next is counted anew, and not said at once."""
    clock, said = Clock(), list[tuple[float, str]]()
    monkeypatch.setattr(supervisor, "wall", clock)
    told = Waiting(lambda text: said.append((clock.now_s - 100.0, text)))
    for k in range(200):
        clock.now_s = 100.0 + 0.1 * k
        told.tell("" if k < 20 else "agents 1-3 to land" if k < 130 else "agent 3 to land")
    assert [(round(at_s), text) for at_s, text in said] == [
        (7, "waiting for agents 1-3 to land: 5 s so far"),
        (12, "waiting for agents 1-3 to land: 10 s so far"),
        (18, "waiting for agent 3 to land: 5 s so far"),
    ]
