"""One flight as a user starts it, from the command to the report, that several tests look at from
all sides."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.system.running import HEXAGON, Running


@dataclass(frozen=True)
class Whole:
    """What a flight that went well leaves behind."""

    code: int
    stdout: str
    stderr: str
    cwd: Path
    folder: Path


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    """The hexagon in lockstep, with JSON lines on stdout, all processes gone."""
    cwd = tmp_path_factory.mktemp("whole")
    with Running("run", HEXAGON, "--speedup", "max", "--json", cwd=cwd, stderr=True) as running:
        code = running.wait()
        running.assert_nothing_left()
        return Whole(code, running.output, running.errors, cwd, running.folder)
