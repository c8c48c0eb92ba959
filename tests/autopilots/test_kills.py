"""Every kind of process killed, stopped for a while and started again, over ArduCopter and PX4
themselves: vehicles come down, the outcome is told, nothing is left behind.

Agent 1 flies ArduCopter, agent 2 PX4.
"""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from tests.autopilots.sitl import Flight
from tests.system.test_kills import again, patient

PAIR = Path(__file__).with_name("pair.yaml")
HOLD = 3
"""The step in which it is done."""

ROWS = [
    ("agent-1", "kill", "failed"),
    ("agent-2", "kill", "failed"),
    ("agent-1", "stop 2", "completed"),
    ("agent-1", "stop 12", "failed"),
    ("agent-2", "stop 12", "failed"),
    ("station", "kill", "failed"),
    ("station", "stop 2", "completed"),
    ("autopilot-1", "kill", "failed"),
    ("autopilot-2", "kill", "failed"),
    ("vehicles", "kill", "failed"),
    ("vehicles", "stop 12", "completed"),
    ("run", "kill", "aborted"),
    ("run", "stop 12", "completed"),
    ("run", "interrupt", "aborted"),
    ("agent-1", "restart", "completed"),
    ("agent-2", "restart", "failed"),  # a PX4 lands a second after its last setpoint
    ("station", "restart", "failed"),
    ("autopilot-1", "stop 2", "completed"),
    ("autopilot-1", "stop 12", "failed"),
    ("autopilot-2", "stop 12", "failed"),
]


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    """The pair, with a hold that is long enough for what happens in it."""
    path = tmp_path / "kills.yaml"
    path.write_text(PAIR.read_text().replace("duration_s: 5", "duration_s: 15"))
    return path


def pid_of(flight: Flight, process: str) -> int:
    kind, _, agent = process.partition("-")
    if kind == "autopilot":
        return flight.started[int(agent)].pid
    return flight.process.pid if kind == "run" else flight.pids[process]


@pytest.mark.long
@pytest.mark.parametrize(("process", "deed", "outcome"), ROWS)
def test_whatever_happens_to_a_process(
    mission: Path, tmp_path: Path, process: str, deed: str, outcome: str
) -> None:
    if deed == "restart":
        mission.write_text(patient(mission.read_text()))
    with Flight(mission, "arducopter,px4", cwd=tmp_path) as flight:
        flight.wait_for_step(HOLD)
        pid = pid_of(flight, process)
        what, _, seconds = deed.partition(" ")
        if what == "stop":
            os.kill(pid, signal.SIGSTOP)
            time.sleep(float(seconds))
            os.kill(pid, signal.SIGCONT)
        elif what == "interrupt":
            flight.interrupt()
        else:
            os.kill(pid, signal.SIGKILL)
        if what == "restart":
            time.sleep(1.0)
            with again(process, flight.folder, tmp_path):
                flight.wait(180)
        else:
            flight.wait(180)
        flight.assert_nothing_left(60)
        assert flight.summary()["outcome"] == outcome, flight.output
        assert "is armed still" not in (flight.folder / "vehicles.log").read_text()
