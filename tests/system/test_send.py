"""`swarm-ctl send` typed in a second shell beside a run."""

from __future__ import annotations

import re
import subprocess
import time
from pathlib import Path

import pytest

from tests.system.conftest import Typed
from tests.system.running import HELD, SWARM_CTL, Running

pytestmark = [pytest.mark.lockstep, pytest.mark.timeout(300)]

BESIDE_A_DEAD_ONE = {
    ("hold",): (1, "agents 1-2: accepted\nagent 3: no answer"),
    ("kill", "--agents", "2", "--yes"): (
        0,
        "agent 2: motors off; agents 1, 3 go on without it (policies.left_by_order)",
    ),
    ("kill", "--yes"): (1, "agent 1: accepted\nagent 3: no answer"),
}
"""Orders and answers, once agent 3 is dead."""
QUICK = ("--lockstep", "--speedup", "3", "--headless", "--no-report")


def answers(said: str) -> str:
    """What agents answered, without the question and the line that names order, mission and run."""
    head, _, told = said.rpartition("[y/N]: ")[2].strip().partition("\n")
    assert not head or re.search(r", held \(runs/\d+-\d+-held\):$", head)
    return told


def test_an_operator_commands_from_the_shell(tmp_path: Path, typed: Typed) -> None:
    """Exit code 0 for accepted, 1 for refused, 2 for an input error; a refused command has no
    effect. The mission waits in its steps, however long this machine takes. A dead agent holds no
    command up, not even those for others; the answer names it (before, each waited ten seconds
    more)."""

    def send(*words: str) -> tuple[int, str]:
        code, said, errors = typed("send", *words)
        return code, answers(said) or errors.strip()

    mission, hold = tmp_path / "held.yaml", "  - hold: {duration_s: 600}\n"
    text = HELD.read_text().replace(hold, hold + hold)
    mission.write_text(text + "policies: {agent_lost: continue}\n")
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
        assert send("land", "--agents", "")[0] == 2  # a script's empty variable is not all
        assert send("move", "6000", "0") == (
            1,
            "agents 1-3: refused: (6000, 0) m: outside the geofence",
        )
        assert send("form", "row") == (0, "agents 1-3: accepted")
        assert send("next") == (0, "agents 1-3: accepted")
        running.wait_for_event("step 4:", 3)
        begun_s = time.monotonic()
        assert send("hold", "--agents", "2-3") == (
            0,
            (
                "agents 2-3: holding; agent 1 waits for them 120 s at most, then goes on"
                " without them (policies.override_pause_s, left_by_order)"
            ),
        )
        alone_s = time.monotonic() - begun_s
        code, asked, _ = typed("send", "kill", "--agents", "1,3")
        assert code == 1  # "n" to the question
        assert asked.startswith("kill: the motors of @1,3 of ")
        running.kill("agent-3")
        for words, answer in BESIDE_A_DEAD_ONE.items():
            begun_s = time.monotonic()
            assert send(*words) == answer
            assert time.monotonic() - begun_s < alone_s + 6.0
        assert running.wait() == 1, running.output
        running.assert_nothing_left()
        summary = running.summary()
        assert summary["outcome"] == "failed"  # all vehicles fell, although the operator ordered it
        assert {each["kind"] for each in summary["findings"]} == {"disarmed in the air", "fall"}
        assert "killed by the operator" in summary["reason"]
