"""A run that is ended from outside, at random moments: Ctrl-C, SIGTERM, a closed terminal, as each
reaches every process of the run. The right word, the right exit code, a summary, no traceback."""

from __future__ import annotations

import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Final

import pytest

from tests.on_demand import on_demand
from tests.system.running import LOW, Running

pytestmark = [pytest.mark.realtime, pytest.mark.timeout(3600)]

RUN: Final = ("run", LOW, "--headless", "--speedup", "5", "--no-report")
SAYS: Final = {
    signal.SIGINT: "Ctrl-C",
    signal.SIGTERM: "SIGTERM",
    signal.SIGHUP: "the terminal was closed",
}
WITHIN_S: Final = 6.0
"""The start takes 1 to 3 s, the flight at this speed another 5 s."""


def end(cwd: Path, number: signal.Signals, after_s: float) -> str:
    """How the run ended that took this signal, in words; AssertionError where it ended badly."""
    cwd.mkdir()
    with Running(*RUN, cwd=cwd) as running:
        time.sleep(after_s)
        os.killpg(running.process.pid, number)
        code = running.wait(120)
        running.assert_nothing_left()
        output = running.output
    if "Traceback" in output and not re.search(r'cli/main\.py", line \d+, in main', output):
        assert code == -number or code == 1, output
        return "Python's own start"  # before our first line
    assert "Traceback" not in output, output
    assert "Aborted!" not in output, output
    folders = list((cwd / "runs").glob("*"))
    for log in (file for folder in folders for file in folder.rglob("*.log")):
        assert "Traceback" not in log.read_text(), log.read_text()
    assert code == 130 or (code == -number and not output), (code, output)
    if not folders:
        said = [line for line in output.splitlines() if not line.startswith("warning: ")]
        assert said in ([f"ended: {SAYS[number]}"], []), output  # Python itself may not be up yet
        return "no folder"
    (folder,) = folders
    assert (folder / "run.json").exists()
    summary = json.loads((folder / "summary.json").read_text())
    reason = summary["reason"]
    assert (summary["outcome"], summary["cause"]) == ("aborted", "order"), (reason, output)
    assert reason in (f"{SAYS[number]} before take-off", f"{SAYS[number]}: all landed"), reason
    if reason.endswith("landed"):
        assert set(summary["exit_codes"].values()) == {0}
    return reason.removeprefix(SAYS[number])


@pytest.mark.parametrize("number", SAYS, ids=lambda number: number.name)
@pytest.mark.parametrize("moments", [1, on_demand(100)])
def test_a_run_ends_in_order_at_any_moment(
    number: signal.Signals, moments: int, tmp_path: Path
) -> None:
    """From the interpreter's start to the flight: all vehicles land, or none took off, and the
    verdict says who ended it."""
    draws = random.Random(f"{number.name} {moments}")  # of one: 0.5, 1.7 and 3.1 s
    found: Counter[str] = Counter()
    bad: list[str] = []
    for k in range(moments):
        after_s = draws.uniform(0.05, WITHIN_S)
        try:
            found[end(tmp_path / str(k), number, after_s)] += 1
        except AssertionError as error:
            bad.append(f"{number.name} after {after_s:.3f} s: {error}")
    print(f"{number.name}: {dict(found)}")
    assert not bad, "\n\n".join(bad)


PROGRAM = """
import sys, swarm_ctl
with swarm_ctl.fly(sys.argv[1], speedup=2) as swarm:
    print("up", flush=True)
    swarm.wait(600)
"""


@pytest.mark.parametrize(
    "number", [on_demand(signal.SIGTERM), on_demand(signal.SIGHUP), signal.SIGKILL]
)
def test_the_swarm_of_a_program_that_is_gone_lands(number: signal.Signals, tmp_path: Path) -> None:
    """Python ends at once by these; `run`, which has lost its starter, lands the swarm."""
    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(LOW)], cwd=tmp_path, stdout=subprocess.PIPE
    )
    assert program.stdout is not None
    assert program.stdout.readline() == b"up\n"
    (processes,) = tmp_path.glob("runs/**/processes.json")
    time.sleep(2.0)
    program.send_signal(number)
    assert program.wait() == -number
    program.stdout.close()
    summary, until = processes.with_name("summary.json"), time.monotonic() + 90
    while not summary.exists():
        assert time.monotonic() < until
        time.sleep(0.1)
    found = json.loads(summary.read_text())
    assert found["reason"] == "the program that started it is gone: all landed"
    assert found["outcome"] == "aborted"
