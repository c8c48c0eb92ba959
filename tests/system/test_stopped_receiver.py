"""A process that was stopped wakes up and finds old news in its sockets: it must not take them for
new ones."""

from __future__ import annotations

import json
import signal
import time
from pathlib import Path

import pytest

from tests.system.running import Running
from tests.system.test_kills import MISSION

pytestmark = pytest.mark.timeout(120)

SPEEDUP = 2.0
ASLEEP_S = 3.5
"""Mission time; shorter than any agent's patience (5 s)."""
LOST = "agent 3 has not been heard for 5 s"


@pytest.mark.long
def test_a_peer_that_died_while_this_agent_was_stopped(tmp_path: Path) -> None:
    """Agent 3 dies just after agent 1 was stopped: agent 1 finds it lost when the others do, not so
    much later."""
    mission = tmp_path / "hold.yaml"
    text = MISSION.read_text().replace(
        "agent_lost_after_s: 5", "agent_lost: hold, agent_lost_after_s: 5"
    )
    mission.write_text(text.replace("duration_s: 5", "duration_s: 30"))
    with Running(
        "run", mission, "--speedup", str(SPEEDUP), "--headless", "--no-report", cwd=tmp_path
    ) as running:
        running.wait_for_event("step 3:", 4)
        running.kill("agent-1", signal.SIGSTOP)
        time.sleep(0.5 / SPEEDUP)
        running.kill("agent-3")
        time.sleep(ASLEEP_S / SPEEDUP)
        running.kill("agent-1", signal.SIGCONT)
        running.wait_for(lambda: len(found_lost(running.folder)) == 3)
        running.interrupt()
        assert running.wait() == 130
        times_s = found_lost(running.folder)
        assert times_s[1] - min(times_s.values()) < ASLEEP_S / 2, times_s


def found_lost(folder: Path) -> dict[int, float]:
    """When each agent has said that 3 is lost."""
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    return {event["agent"]: event["time_s"] for event in events if LOST in event["text"]}
