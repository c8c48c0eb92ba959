"""The house's own rules: imports, types, lint, format. A finding fails the tests like any other
mistake."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BIN = Path(sys.executable).parent

CHECKS = {
    "imports": [str(BIN / "lint-imports"), "--no-cache"],
    "types": [sys.executable, "-m", "mypy"],
    "lint": [sys.executable, "-m", "ruff", "check", "--no-cache", "."],
    "format": [sys.executable, "-m", "ruff", "format", "--no-cache", "--check", "."],
}


@pytest.mark.parametrize("name", CHECKS)
@pytest.mark.timeout(300)
def test_house_rule(name: str) -> None:
    """The check ends with 0."""
    done = subprocess.run(CHECKS[name], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def loaded_by(module: str) -> set[str]:
    """The packages that a process has loaded which imports this module."""
    names = "sorted({m.split('.')[0] for m in sys.modules})"
    code = f"import {module}, sys; print(*{names})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_agent_process_stays_small() -> None:
    """What an agent imports does not reach the screen, the mission reader or the simulator, seen at
    run time."""
    loaded = loaded_by("swarm_ctl.runtime.agent.agent_process")
    assert "zenoh" in loaded
    assert not loaded & {
        "rich",
        "typer",
        "scipy",
        "yaml",
        "swarm_sim",
        "textual",
        "matplotlib",
        "mcap",
    }


def test_no_command_waits_for_what_another_one_needs() -> None:
    """Every command loads all of their options, and no more."""
    loaded = loaded_by("swarm_ctl.cli.main")
    assert not loaded & {
        "numpy",
        "zenoh",
        "pymavlink",
        "yaml",
        "scipy",
        "textual",
        "matplotlib",
        "mcap",
    }
