"""An operator's commands to agents of ArduCopter itself."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import pytest

from tests.autopilots.sitl import PAIR, Flight
from tests.system.running import Running

MOVE = 3
COMMANDED_S, STANDS_S = 2.0, 8.0
"""From the command to the agent's hold; to the vehicle's standstill, from 3 m/s."""


@pytest.mark.long
def test_hold_leaves_at_once_beside_a_dead_agent(tmp_path: Path) -> None:
    """The other vehicle is in the middle of a move, and stops."""
    mission = tmp_path / "move.yaml"
    text = PAIR.read_text().replace("hold: {duration_s: 5}", "move: {to: [90, 0], speed_mps: 3}")
    mission.write_text(f"{text}policies: {{agent_lost: continue}}\n")
    with Flight(mission, "arducopter", cwd=tmp_path) as flight:
        flight.wait_for_step(MOVE)
        with flight.client(1) as seen:
            seen.wait_for(lambda: seen.speed_mps > 2.0, seconds=30.0)
            flight.kill("agent-2", signal.SIGKILL)
            begun_s = time.monotonic()
            with Running("send", "hold", cwd=tmp_path) as send:
                flight.wait_for_event("the operator commands: hold")
                held_s = time.monotonic() - begun_s
                seen.wait_for(lambda: seen.speed_mps < 0.3)
                stood_s = time.monotonic() - begun_s
                assert send.wait(20.0) == 1
                assert "agent 1: accepted\nagent 2: no answer" in send.output
            print(f"commanded after {held_s:.1f} s, stands after {stood_s:.1f} s")
            assert held_s < COMMANDED_S
            assert stood_s < STANDS_S
        flight.interrupt()
        flight.wait(120.0)
        flight.assert_nothing_left(60.0)
