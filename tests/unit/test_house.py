"""The house's own rules: imports, types, lint, format. A finding fails the tests like any other
mistake."""

from __future__ import annotations

import ast
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
    loaded = loaded_by("swarm_ctl.engine.agent.agent_process")
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


HOUSES = ("swarm_ctl", "sim/swarm_sim")
BOTH_SIDES = {"KeeperGoneError", "Streams", "TickWord"}
"""The same thing in `swarm_ctl` and in the simulator, which shares no code with it."""
FACES = {"Lifeline"}
"""What a command needs of a class, beside the class."""
INNER_LOOPS = {
    ("swarm_ctl/core/control/controller.py", "Me"),
    ("swarm_ctl/core/kernel/law.py", "Pair"),
    ("swarm_ctl/core/safety/safety_filter.py", "Other"),
    ("swarm_ctl/core/swarm/peers.py", "OtherAircraft"),
    ("swarm_ctl/mesh/payloads.py", "AgentState"),
}
"""Rows that each tick makes for each aircraft: by name they take two and a half times as long, 4 %
of a tick among 32 agents."""


def _trees() -> dict[Path, ast.Module]:
    paths = [path for house in HOUSES for path in (ROOT / house).rglob("*.py")]
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in paths}


def test_a_class_name_stands_for_one_thing() -> None:
    """No two modules have a public class of one name."""
    where: dict[str, list[str]] = {}
    for path, tree in _trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                if path.parent.name == "laws" and node.name == "Parameters":
                    continue  # by this name each law has its own
                where.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    twice = {name for name, paths in where.items() if len(paths) > 1}
    assert twice == BOTH_SIDES | FACES, {n: where[n] for n in twice}


def test_no_constructor_takes_more_than_six_values_by_position() -> None:
    """Two floats that change places pass the type checker; two names do not."""
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno}: {node.func.id}"
        for path, tree in _trees().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id.lstrip("_")[:1].isupper()
        and sum(not isinstance(value, ast.Starred) for value in node.args) > 6
        and (str(path.relative_to(ROOT)), node.func.id) not in INNER_LOOPS
    ]
    assert found == []
