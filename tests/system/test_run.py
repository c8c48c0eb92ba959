"""`swarm-ctl run` with real processes, each kind of them killed in flight: in lockstep, and in real
time on demand (`test_kills.py` has all phases)."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.on_demand import on_demand
from tests.system.conftest import Typed
from tests.system.running import HELD, LOW, Running

pytestmark = [pytest.mark.lockstep, pytest.mark.timeout(300)]

Command = tuple[str | Path, ...]
LOCKSTEP = ("run", HELD, "--speedup", "max", "--headless", "--no-report")
PACED = ("run", HELD, "--lockstep", "--speedup", "5", "--headless", "--no-report")
"""Slow enough for two deeds in one landing."""
RUN = ("run", LOW, "--speedup", "3", "--headless", "--no-report")
"""In real time."""


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


@pytest.mark.parametrize(
    "run",
    [
        pytest.param(PACED, id="lockstep"),
        pytest.param(RUN, id="3", marks=(pytest.mark.long, pytest.mark.realtime)),
    ],
)
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


def test_second_ctrl_c_stops_at_once(tmp_path: Path) -> None:
    """Everything ends, vehicles in the air or not, and nothing is left."""
    slow = ("run", HELD, "--lockstep", "--speedup", "2", "--headless", "--no-report")
    with Running(*slow, cwd=tmp_path) as running:
        running.wait_for_event("step 2:", 3)
        running.interrupt()
        running.wait_for(lambda: "Ctrl-C again" in running.output)
        time.sleep(1.0)  # within 0.7 s it is the same press
        running.interrupt()
        assert running.wait() == 130, running.output
        running.assert_nothing_left()
        assert "ended by a second Ctrl-C" in running.summary()["reason"]


def test_ctrl_c_on_the_ground(tmp_path: Path) -> None:
    """Before anything arms, Ctrl-C just ends the run."""
    with Running(*RUN, cwd=tmp_path) as running:
        running.wait_for(
            lambda: (tmp_path / "runs").exists() and (running.folder / "processes.json").exists()
        )
        running.interrupt()
        assert running.wait() == 130, running.output
        running.assert_nothing_left()


# --- what does not start ---


def test_bad_mission_starts_nothing(tmp_path: Path, typed: Typed) -> None:
    """Refused with file, line, field and what would be allowed, exit 2; no run folder."""
    broken, lines = tmp_path / "broken.yaml", LOW.read_text().splitlines()
    broken.write_text(LOW.read_text().replace("r_in: 0.5", "r_in: 1.5"))
    code, _, errors = typed("run", str(broken), "--headless")
    assert code == 2
    number = next(k for k, line in enumerate(lines, 1) if "r_in" in line)
    for words in (f"broken.yaml:{number}", "law.r_in", "allowed"):
        assert words in errors
    assert not (tmp_path / "runs").exists()


def test_missing_simulator(tmp_path: Path) -> None:
    """A simulator that can't be started is named, exit 3, nothing left."""
    hide = tmp_path / "hide" / "swarm_sim"
    hide.mkdir(parents=True)
    (hide / "__init__.py").write_text("raise ImportError('no simulator here')")
    with Running(*RUN, cwd=tmp_path, env={"PYTHONPATH": str(hide.parent)}) as running:
        assert running.wait() == 3, running.output
        assert "the simulator did not start" in running.output
        assert "no simulator here" in running.output
        running.assert_nothing_left()


def test_busy_mesh_port(tmp_path: Path) -> None:
    """A mesh port of the fleet that is taken: which one, exit 3, nothing left."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        output = does_not_start(tmp_path, f"mesh: tcp/127.0.0.1:{port}")
    assert f"127.0.0.1:{port}" in output


def test_agent_that_dies_while_starting(tmp_path: Path) -> None:
    """A bad vehicle endpoint ends the start, exit 3, nothing left."""
    does_not_start(tmp_path, "endpoint: 'serial:/dev/does-not-exist'")


def does_not_start(folder: Path, where: str) -> str:
    """What `run` says where agent 2 can't start with this in its fleet."""
    mission = folder / "mission.yaml"
    mission.write_text(
        f"{LOW.read_text()}fleet: {{agents: [{{id: 1}}, {{id: 2, {where}}}, {{id: 3}}]}}"
    )
    with Running("run", mission, "--headless", cwd=folder) as running:
        assert running.wait() == 3, running.output
        running.assert_nothing_left()
        assert "agent-2 did not start" in running.output
        return running.output


def test_python_m_entry(tmp_path: Path) -> None:
    """The simulator, too, answers a missing argument with usage, not a traceback."""
    done = subprocess.run(
        [sys.executable, "-m", "swarm_sim"],
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
