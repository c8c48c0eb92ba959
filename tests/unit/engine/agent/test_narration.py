"""What an agent alone tells its terminal, and that no terminal holds it up."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from dataclasses import replace

from swarm_ctl.core.model.messages import AgentStatus, Event, Phase, Severity
from swarm_ctl.engine.agent.narration import Narration
from tests.unit.station.swarm import hexagon_plan, status_of

PLAN = hexagon_plan()


def waiting(time_s: float, reason: str, phase: Phase = Phase.CONNECT) -> AgentStatus:
    return replace(status_of(PLAN, 1, time_s), phase=phase, reason=reason)


def test_what_it_waits_for_is_said_at_once_then_each_five_seconds_and_when_it_changes() -> None:
    """It said "ready", and then nothing for 120 s."""
    lines: list[str] = []
    narration = Narration(lines.append)
    for half_s in range(25):
        narration.tell((), waiting(half_s * 0.5, "no heartbeat yet from sysid 1"))
    narration.tell((), waiting(12.5, "GPS"))
    assert lines == [
        f"[{at:7.1f} s] waits: {why}"
        for at, why in [
            *((at, "no heartbeat yet from sysid 1") for at in (0.0, 5.0, 10.0)),
            (12.5, "GPS"),
        ]
    ]


def test_events_are_said_with_their_weight_and_a_flight_that_goes_on_is_no_waiting() -> None:
    lines: list[str] = []
    narration = Narration(lines.append)
    events = (
        Event(1, 3.0, Severity.INFO, "step 1: takeoff"),
        Event(1, 4.0, Severity.WARNING, "vehicle: \x1b[31mlow"),
    )
    narration.tell(events, waiting(4.0, "why", Phase.FLY))
    assert lines == ["[    3.0 s] step 1: takeoff", "[    4.0 s] WARNING: vehicle: ?[31mlow"]


def test_a_terminal_that_takes_nothing_or_has_gone_holds_no_agent_up() -> None:
    code = (
        "from swarm_ctl.engine.agent.narration import show_on_terminal as show\n"
        "for _ in range(3000): show('x' * 100)\n"
        "print('done', flush=True)"
    )
    for gone in (False, True):
        ours, theirs = os.pipe()
        fcntl.fcntl(theirs, fcntl.F_SETPIPE_SZ, 4096)
        with subprocess.Popen(
            [sys.executable, "-c", code], stderr=theirs, stdout=subprocess.PIPE
        ) as process:
            os.close(theirs)
            if gone:
                os.close(ours)
            assert process.communicate(timeout=60)[0] == b"done\n"
        if not gone:
            os.close(ours)
