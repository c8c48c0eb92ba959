"""Every file and command of docs/learn/tutorial.md works as the page says."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.unit.docs.pages import PAGES, ROOT, commands, saved_files

TUTORIAL = PAGES["tutorial"]
INSTALL = [
    "python3 -m venv .venv",
    ".venv/bin/pip install -q '.[ground]'",
    ". .venv/bin/activate",
    "pip install pytest",
]
FIRST_FLIGHT = "swarm-ctl run missions/hexagon.yaml --speedup max"
VALIDATE = "swarm-ctl validate patrol.yaml"
RUN = "swarm-ctl run patrol.yaml"
SEND = ["swarm-ctl send hold", "swarm-ctl send resume"]
REPLAY = "swarm-ctl replay --speed 20"
TEST = "python -m pytest -q test_patrol.py"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the files that the tutorial saves."""
    for name, text in saved_files(TUTORIAL).items():
        (tmp_path / name).write_text(text)
    return tmp_path


def typed(command: str) -> list[str]:
    """The command with this environment's Python."""
    name, *rest = shlex.split(command)
    start = ["-m", "swarm_ctl.cli.main"] if name == "swarm-ctl" else []
    return [sys.executable, *start, *rest]


def output(command: str, folder: Path) -> str:
    """What the command prints; it has to succeed."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        typed(command), cwd=folder, capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_no_command_of_the_tutorial_is_without_a_test() -> None:
    """The first flight is one of the missions of tests/scenarios/test_missions.py."""
    tested = [FIRST_FLIGHT, VALIDATE, RUN, *SEND, REPLAY, TEST]
    assert [command for command in commands(TUTORIAL) if command not in INSTALL] == tested
    assert (ROOT / "missions" / "hexagon.yaml").exists()


def test_the_mission_is_valid(folder: Path) -> None:
    assert "patrol can be flown" in output(VALIDATE, folder)


def test_the_readers_own_tests_pass(folder: Path) -> None:
    """On the virtual clock, as the page's test asks."""
    assert "2 passed" in output(f"{TEST} -p no:cacheprovider", folder)


@pytest.mark.realtime
@pytest.mark.long
def test_the_mission_flies_holds_resumes_and_replays(folder: Path) -> None:
    """`run` with the two commands of the second terminal, then `replay`, with real processes (every
    day on the virtual clock, above; the commands in `tests/system`)."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    log = folder / "run.log"
    with log.open("w") as file:
        run = subprocess.Popen(
            typed(f"{RUN} --speedup 4 --no-report"),
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=file,
            env=environment,
        )
        try:
            while "form wing" not in log.read_text() and run.poll() is None:
                time.sleep(0.1)
            for command in SEND:
                assert "refused" not in output(command, folder)
            assert run.wait(100) == 0, log.read_text()
        finally:
            run.terminate()
            run.wait()
    assert "patrol: COMPLETED" in log.read_text()
    assert "form wing" in output(REPLAY, folder)
