"""Commands typed in a second shell beside a run; real time on a machine that is too busy for it."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Generator
from pathlib import Path

import pytest

from swarm_ctl.cli.main import main

Typed = Callable[..., tuple[int, str, str]]
CANNOT_KEEP_UP = "the machine can't keep up with --speedup"
BUSY = 4
"""Runnable processes per core: not this project's own."""


@pytest.fixture
def typed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Typed:
    """`swarm-ctl WORDS` in the test's folder: exit code, stdout, stderr; "n" to every question.

    In this process: the start of a process of its own is a second of work, each time.
    """
    monkeypatch.chdir(tmp_path)

    def run(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["swarm-ctl", *words])
        monkeypatch.setattr(sys, "stdin", io.StringIO("n\n"))
        with pytest.raises(SystemExit) as ended:
            main()
        return int(ended.value.code or 0), *capsys.readouterr()

    return run


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """A row in real time proves nothing where the run itself says that it was not in real time, and
    others have the machine: it is skipped then, and says why."""
    report = yield
    real = isinstance(item, pytest.Function) and "realtime" in item.keywords
    if real and report.failed and call.when == "call" and _too_busy(item.funcargs):
        report.outcome = "skipped"
        reason = f"Skipped: {CANNOT_KEEP_UP}: load {os.getloadavg()[0]:.0f}"
        report.longrepr = (str(item.path), 0, reason)
    return report


def _too_busy(arguments: dict[str, object]) -> bool:
    where = arguments.get("tmp_path")
    if not isinstance(where, Path) or os.getloadavg()[0] < BUSY * (os.cpu_count() or 1):
        return False
    return any(CANNOT_KEEP_UP in path.read_text() for path in where.rglob("output-*.txt"))
