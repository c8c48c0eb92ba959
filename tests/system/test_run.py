"""`swarm-ctl run` with real processes, each kind of them killed in flight: in lockstep, and in real
time on demand (`test_kills.py` has all phases)."""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path

import pytest

from tests.on_demand import on_demand
from tests.system.running import HELD, HEXAGON, LOW, Running

pytestmark = [pytest.mark.lockstep, pytest.mark.timeout(300)]

Command = tuple[str | Path, ...]
LOCKSTEP = ("run", HELD, "--speedup", "max", "--headless", "--no-report")
PACED = ("run", HELD, "--lockstep", "--speedup", "5", "--headless", "--no-report")
"""Slow enough for two deeds in one landing."""
RUN = ("run", LOW, "--speedup", "3", "--headless", "--no-report")
"""In real time."""
BOTH = pytest.mark.parametrize(
    "run",
    [
        pytest.param(PACED, id="lockstep"),
        pytest.param(RUN, id="3", marks=(pytest.mark.long, pytest.mark.realtime)),
    ],
)


def assert_apart(folder: Path) -> None:
    """No true distance under r_in, from the first lift-off to the last touchdown."""
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["min_true_distance_m"] > summary["r_in_m"]


def assert_truth_ends_on_the_ground(folder: Path) -> None:
    """In the last true state every vehicle is disarmed and down."""
    lines = [json.loads(line) for line in (folder / "truth.jsonl").read_text().splitlines()]
    last = [line for line in lines if line["type"] == "state"][-1]
    assert not any(last["armed"])
    assert not any(last["airborne"])


@pytest.mark.parametrize("step", [on_demand(1), 2])
def test_agent_killed(tmp_path: Path, step: int) -> None:
    """Its vehicle's failsafe lands it, the others hold and land; the run fails and says so."""
    with Running(*LOCKSTEP, cwd=tmp_path) as running:
        running.wait_for_event(f"step {step}:", 3)
        running.kill("agent-3")
        assert running.wait() == 1, running.output
        running.assert_nothing_left()
        summary = running.summary()
        assert summary["outcome"] == "failed"
        assert "agent 3" in summary["reason"]
        assert summary["exit_codes"]["agent-3"] == -signal.SIGKILL
        assert_truth_ends_on_the_ground(running.folder)
        assert_apart(running.folder)


def test_simulator_killed(tmp_path: Path) -> None:
    """The vehicles are gone: every agent ends, the truth up to then is there, the run failed."""
    with Running(*LOCKSTEP, cwd=tmp_path) as running:
        running.wait_for_event("step 2:", 3)
        running.kill("simulator")
        assert running.wait() == 1, running.output
        running.assert_nothing_left()
        summary = running.summary()
        assert summary["outcome"] == "failed"
        assert summary["exit_codes"]["simulator"] == -signal.SIGKILL
        assert_apart(running.folder)


def test_run_itself_killed(tmp_path: Path) -> None:
    """Agents land and end, then the simulator, and the station writes the summary."""
    with Running(*LOCKSTEP, cwd=tmp_path) as running:
        running.wait_for_event("step 2:", 3)
        os.kill(running.process.pid, signal.SIGKILL)
        running.process.wait()
        running.assert_nothing_left(60)
        assert running.summary()["outcome"] == "aborted"
        assert_truth_ends_on_the_ground(running.folder)
        assert_apart(running.folder)


@BOTH
def test_sigterm_lands_without_a_station(tmp_path: Path, run: Command) -> None:
    """A service manager's stop is a landing, too. With no station left to pass the command on,
    `run` cuts the lifelines: the agents land all the same."""
    with Running(*run, cwd=tmp_path) as running:
        running.wait_for_event("step 2:", 3)
        running.kill("station")
        running.process.terminate()
        assert running.wait() == 130, running.output
        running.assert_nothing_left()
        assert_truth_ends_on_the_ground(running.folder)


@BOTH
def test_second_ctrl_c_stops_at_once(tmp_path: Path, run: Command) -> None:
    """Everything ends within a moment, vehicles in the air or not, and nothing is left."""
    with Running(*run, cwd=tmp_path) as running:
        running.wait_for_event("step 2:", 3)
        running.interrupt()
        running.wait_for(lambda: "Ctrl-C again" in running.output)
        running.interrupt()
        assert running.wait(5) == 130, running.output
        running.assert_nothing_left()
        assert running.summary()["outcome"] != "completed"


def test_ctrl_c_on_the_ground(tmp_path: Path) -> None:
    """Before anything arms, Ctrl-C just ends the run."""
    slow = ("run", LOW, "--speedup", "1", "--headless", "--no-report")
    with Running(*slow, cwd=tmp_path) as running:
        running.wait_for(
            lambda: (tmp_path / "runs").exists() and (running.folder / "processes.json").exists()
        )
        running.interrupt()
        assert running.wait(30) == 130, running.output
        running.assert_nothing_left()


# --- what does not start ---


def test_bad_mission_starts_nothing(tmp_path: Path) -> None:
    """Refused with file, line, field and what would be allowed, exit 2; no run folder, no
    process."""
    broken = tmp_path / "broken.yaml"
    broken.write_text(HEXAGON.read_text().replace("r_in: 0.5", "r_in: 1.5"))
    with Running("run", broken, "--headless", cwd=tmp_path) as running:
        assert running.wait(20) == 2
        line = 1 + HEXAGON.read_text().splitlines().index(
            next(line for line in HEXAGON.read_text().splitlines() if "r_in" in line)
        )
        assert f"broken.yaml:{line}" in running.output
        assert "law.r_in" in running.output
        assert "allowed" in running.output
        assert not (tmp_path / "runs").exists()
        running.assert_nothing_left()


def test_missing_simulator(tmp_path: Path) -> None:
    """A simulator that can't be started is named, exit 3, nothing left."""
    hide = tmp_path / "hide" / "swarm_sim"
    hide.mkdir(parents=True)
    (hide / "__init__.py").write_text("raise ImportError('no simulator here')")
    with Running(*RUN, cwd=tmp_path, env={"PYTHONPATH": str(hide.parent)}) as running:
        assert running.wait(30) == 3, running.output
        assert "the simulator did not start" in running.output
        assert "no simulator here" in running.output
        running.assert_nothing_left()


def test_busy_mesh_port(tmp_path: Path) -> None:
    """A mesh port of the fleet that is taken: which one, exit 3, nothing left."""
    import socket

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        mission = tmp_path / "busy.yaml"
        text = HEXAGON.read_text()
        line = "{id: 2, sysid: 2, autopilot: ardupilot}"
        assert line in text
        entry = f"{{id: 2, sysid: 2, autopilot: ardupilot, mesh: tcp/127.0.0.1:{port}}}"
        mission.write_text(text.replace(line, entry))
        with Running("run", mission, "--headless", cwd=tmp_path) as running:
            assert running.wait(30) == 3, running.output
            assert f"127.0.0.1:{port}" in running.output
            assert "agent-2 did not start" in running.output
            running.assert_nothing_left()


def test_agent_that_dies_while_starting(tmp_path: Path) -> None:
    """A bad vehicle endpoint ends the start with the agent's own words, exit 3, nothing left."""
    mission = tmp_path / "dies.yaml"
    line = "{id: 4, sysid: 4, autopilot: ardupilot}"
    entry = "{id: 4, sysid: 4, autopilot: ardupilot, endpoint: 'serial:/dev/does-not-exist'}"
    mission.write_text(HEXAGON.read_text().replace(line, entry))
    with Running("run", mission, "--headless", cwd=tmp_path) as running:
        assert running.wait(30) == 3, running.output
        assert "agent-4 did not start" in running.output
        running.assert_nothing_left()


def test_python_m_entry(tmp_path: Path) -> None:
    """The simulator, too, answers a missing argument with usage, not a traceback."""
    import subprocess

    done = subprocess.run(
        [sys.executable, "-m", "swarm_sim"],
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
