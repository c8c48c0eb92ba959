"""Where nothing can be written: a disk that is full ends recordings, a reader that is gone the
output. The operator is told, and nothing else changes."""

from __future__ import annotations

import os
import resource
import subprocess
from pathlib import Path

import pytest

from tests.system.running import LOW, SWARM_CTL, Running

pytestmark = [pytest.mark.lockstep, pytest.mark.timeout(300)]

LEFT = 20_000
"""Bytes that a file may have: less than every recording has by then, more than an agent's last
account needs."""


def test_the_disk_is_full_in_flight(tmp_path: Path) -> None:
    """From the form step on no process can write: all agents complete at their pace, and the log
    names every file."""
    with Running(
        "run", LOW, "--lockstep", "--speedup", "8", "--headless", "--no-report", cwd=tmp_path
    ) as running:
        running.wait_for_event("step 2:", 3)
        for pid in running.pids.values():
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (LEFT, LEFT))
        logs = {path: path.stat().st_size for path in running.folder.glob("*.tlog")}
        assert running.wait() == 1, (
            running.output
        )  # flown to its end, but without the truth its safety is not known
        running.assert_nothing_left()
        assert "FAILED: truth.jsonl: no end line, the simulator did not finish it" in running.output
        summary = running.summary()
        assert {agent["outcome"] for agent in summary["agents"]} == {"completed"}
        assert summary["setpoint_rate_hz"] > 9  # of 10
        said = running.output.replace("\n", " ")
        for name in ("statuses.jsonl", "recording.mcap"):
            assert f"{name} has stopped: File too large; the flight goes on" in said
        assert (
            "the truth file ends here: File too large"
            in (running.folder / "simulator.log").read_text()
        )
        assert len(logs) == 3
        assert all(path.stat().st_size <= max(size, LEFT) for path, size in logs.items())


def test_the_disk_is_full_at_the_start(tmp_path: Path) -> None:
    """One line, exit code 3, and no folder that says nothing."""
    done = subprocess.run(
        [SWARM_CTL, "run", LOW, "--headless"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0)),
    )
    assert done.returncode == 3
    said = "can't be written: File too large; choose with --runs\n"
    assert done.stderr.startswith("error: runs/")
    assert done.stderr.endswith(said)
    assert not list((tmp_path / "runs").iterdir())


def test_a_closed_output_does_not_end_the_flight(tmp_path: Path) -> None:
    """`swarm-ctl run ... | head -1`: the reader goes away in flight, the mission goes on to its
    end."""
    read, write = os.pipe()
    process = subprocess.Popen(
        [str(SWARM_CTL), "run", str(LOW), "--speedup", "max", "--headless", "--no-report"],
        cwd=tmp_path,
        stdout=write,
        stderr=subprocess.DEVNULL,
        stdin=subprocess.DEVNULL,
    )
    os.close(write)
    try:
        said = b""
        while b"starting" not in said:
            said += os.read(read, 100)
        os.close(read)
        assert process.wait(240) == 0
        (folder,) = (tmp_path / "runs").iterdir()
        assert '"outcome": "completed"' in (folder / "summary.json").read_text()
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
