"""`swarm-ctl measure` with real processes and sockets: a simulated vehicle, and what stands in the
fleet file then."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.mission.fleet.fleet_file import read_fleet

SWARM_CTL = str(Path(sys.executable).parent / "swarm-ctl")
FLEET = "agents:\n  - id: 1  # the big one\n    sysid: 11\n  - {id: 2, autopilot: px4}\n"


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    path = tmp_path / "fleet.yaml"
    path.write_text(FLEET)
    return path


def test_ctrl_c_lands_it_and_nothing_is_written(fleet: Path) -> None:
    """In a step; every line that follows is about the way down."""
    command = [
        SWARM_CTL,
        "measure",
        "--fleet",
        str(fleet),
        "--id",
        "1",
        "--speed",
        "2",
        "--speedup",
        "5",
    ]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        try:
            assert running.stdout is not None
            while "north" not in (line := running.stdout.readline()):
                assert line, running.communicate()
            running.send_signal(signal.SIGINT)
            said, errors = running.communicate(timeout=60)
        finally:
            running.kill()
    assert running.returncode == 130, errors
    assert "Ctrl-C: landed" in said
    assert fleet.read_text() == FLEET


@pytest.mark.long
def test_the_whole_fleet(fleet: Path) -> None:
    """Both autopilots, one after another, into the file; its comments stay."""
    command = [SWARM_CTL, "measure", "--fleet", str(fleet), "--id", "all", "--speedup", "4"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=110)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "# the big one" in fleet.read_text()
    for agent in read_fleet(fleet).agents:
        typical = AUTOPILOT_KINDS[agent.autopilot].response
        assert agent.response != typical
        total = agent.response.dead_time_s + agent.response.lag_s
        assert total == pytest.approx(typical.dead_time_s + typical.lag_s, abs=0.25)
