"""`swarm-ctl send` typed in a second shell beside a run."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.system.conftest import Typed
from tests.system.running import LOW, SWARM_CTL, Running

pytestmark = [pytest.mark.lockstep, pytest.mark.timeout(300)]

QUICK = ("--lockstep", "--speedup", "3", "--headless", "--no-report")


def waiting(text: str) -> str:
    """The mission with two steps that end by a command alone."""
    hold = "  - hold: {duration_s: 3000}\n"
    return text.replace("  - hold: {duration_s: 5}\n", hold + hold)


def answers(said: str) -> str:
    """What agents answered, without the question and the line that names order, mission and run."""
    head, _, told = said.rpartition("[y/N]: ")[2].strip().partition("\n")
    assert not head or re.search(r", low \(runs/\d+-\d+-low\):$", head)
    return told


def test_a_dead_agent_holds_no_command_up(tmp_path: Path, typed: Typed) -> None:
    """Not even those for others; the answer names it. Before, each waited ten seconds more."""

    def send(*words: str) -> tuple[int, str, float]:
        begun = time.monotonic()
        code, said, _ = typed("send", *words)
        return code, answers(said), time.monotonic() - begun

    mission = tmp_path / "low.yaml"
    mission.write_text(waiting(LOW.read_text()) + "policies: {agent_lost: continue}\n")
    with Running("run", mission, *QUICK, cwd=tmp_path) as running:
        running.wait_for_event("step 3:", 3)
        alone_s = send("hold", "--agents", "2")[2]
        os.kill(running.pids["agent-3"], signal.SIGKILL)
        code, text, took_s = send("hold")
        assert (code, text) == (1, "agents 1-2: accepted\nagent 3: no answer")
        assert took_s < alone_s + 6.0
        code, text, took_s = send("kill", "--agents", "2", "--yes")
        assert (code, text) == (
            0,
            "agent 2: motors off; agents 1, 3 go on without it (policies.left_by_order)",
        )
        assert took_s < alone_s + 6.0


def test_an_operator_commands_from_the_shell(tmp_path: Path, typed: Typed) -> None:
    """Exit code 0 for accepted, 1 for refused, 2 for an input error; a refused command has no
    effect. The mission waits in its steps, however long this machine takes."""

    def send(*words: str) -> tuple[int, str]:
        code, said, errors = typed("send", *words)
        return code, answers(said) or errors.strip()

    mission = tmp_path / "low.yaml"
    mission.write_text(waiting(LOW.read_text()))
    with Running("run", mission, *QUICK, cwd=tmp_path) as running:
        running.wait_for_event("step 3:", 3)
        assert send("resume") == (1, "agents 1-3: refused: not held; there is nothing to resume")
        command = [str(SWARM_CTL), "send", "hold"]  # one as the shell starts it
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert (done.returncode, answers(done.stdout)) == (0, "agents 1-3: accepted")
        assert send("form", "rwo") == (
            2,
            (
                "error: there is no shape 'rwo' in this mission; did you mean row?; "
                "allowed: hexagon, row"
            ),
        )
        assert send("move", "nan", "0")[0] == 2
        assert send("move", "6000", "0") == (
            1,
            "agents 1-3: refused: (6000, 0) m: outside the geofence",
        )
        assert send("form", "row") == (0, "agents 1-3: accepted")
        assert send("next") == (0, "agents 1-3: accepted")
        running.wait_for_event("step 4:", 3)
        assert send("hold", "--agents", "2-3") == (
            0,
            (
                "agents 2-3: holding; agent 1 waits for them 120 s at most, then goes on"
                " without them (policies.override_pause_s, left_by_order)"
            ),
        )
        assert send("kill")[0] == 1  # "n" to the question
        assert send("kill", "--yes") == (0, "agents 1-3: accepted")
        assert running.wait() == 1, running.output
        running.assert_nothing_left()
        summary = running.summary()
        assert summary["outcome"] == "failed"  # all vehicles fell, although the operator ordered it
        assert {each["kind"] for each in summary["findings"]} == {"disarmed in the air", "fall"}
        assert "killed by the operator" in summary["reason"]
