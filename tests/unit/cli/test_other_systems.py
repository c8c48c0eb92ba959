"""What works on macOS and Windows, in a simulation of what those lack (`elsewhere.py`; the project
has no such machines), and what a command says that does not."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from swarm_ctl.recording import RECORDING
from swarm_ctl.recording.mcap_recorder import McapRecorder
from tests.unit.recording.test_recording import START_NS, flight
from tests.unit.report.run_folders import manifest, write_run
from tests.unit.test_house import ROOT

ELSEWHERE = Path(__file__).with_name("elsewhere.py")
LACKING = ("fork", "pipes that do not wait", "SIGHUP", "file locks", "terminals", "owners of files")


def told_elsewhere(platform: str, folder: Path, *commands: str) -> tuple[dict[str, int], str, str]:
    """Exit code by command, stdout and stderr of all."""
    words = json.dumps([command.split() for command in commands])
    done = subprocess.run(
        [sys.executable, str(ELSEWHERE), platform, words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'sim'}"},
    )
    ends = [json.loads(x) for x in done.stdout.splitlines() if x.startswith('{"command"')]
    assert len(ends) == len(commands), done.stderr
    return {" ".join(end["command"]): end["code"] for end in ends}, done.stdout, done.stderr


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A flight to look at, whose recording has lost its end."""
    folder = tmp_path / "flown"
    folder.mkdir()
    write_run(folder)
    made = McapRecorder(folder, START_NS, {"manifest": manifest().model_dump_json()})
    for payload, heard_s in flight():
        made.take(payload, heard_s)
    made.close()
    recording = folder / RECORDING
    recording.write_bytes(recording.read_bytes()[:-200])
    return folder


# macOS lacks less than Windows
@pytest.mark.parametrize("platform", ["win32", pytest.param("darwin", marks=pytest.mark.long)])
def test_what_flies_nothing_works(run: Path, platform: str) -> None:
    commands = (
        "validate hexagon",
        "plan hexagon",
        "missions",
        "study --n 2 --missions 2 --out rows.csv",
        "report flown",
        "compare flown flown",
        "replay flown --headless --speed 50",
        "replay flown --json --speed 50",
        "doctor --json",
    )
    codes, _, errors = told_elsewhere(platform, run.parent, *commands)
    assert {name: code for name, code in codes.items() if code and "doctor" not in name} == {}, (
        errors
    )
    for made in ("plan.json", "rows.csv", "flown/report.html", "compare.html"):
        assert (run.parent / made).stat().st_size > 100


def test_what_flies_says_what_windows_lacks(tmp_path: Path) -> None:
    """By name, before anything is started, with exit code 2."""
    commands = "run hexagon", "agent plan.json --id 1", "send hold", "sim", "trust check keys"
    codes, _, errors = told_elsewhere("win32", tmp_path, *commands)
    assert set(codes.values()) == {2}, (codes, errors)
    for name in ("run", "agent", "send", "sim", "trust"):
        assert f"swarm-ctl {name} does not work on win32, which lacks" in errors
    assert all(errors.count(what) == len(commands) for what in LACKING)
    assert list(tmp_path.iterdir()) == []


def test_lockstep_says_what_macos_lacks(tmp_path: Path) -> None:
    codes, _, errors = told_elsewhere("darwin", tmp_path, "run hexagon --speedup max")
    assert list(codes.values()) == [2]
    assert "lockstep does not work on darwin, which lacks Unix sockets in an abstract" in errors
    assert "SO_PEERCRED" in errors
    assert not (tmp_path / "runs").exists()
