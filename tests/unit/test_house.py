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


def test_agent_process_stays_small() -> None:
    """What an agent imports does not reach the screen, the mission reader or the simulator, seen at
    run time."""
    names = "sorted({m.split('.')[0] for m in sys.modules})"
    code = f"import swarm_ctl.runtime.agent.agent_process, sys; print(*{names})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert "zenoh" in loaded
    assert not loaded & {"rich", "typer", "scipy", "yaml", "sim", "textual", "matplotlib", "mcap"}
