"""Flights are the same, byte for byte, as when their hashes were written."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from swarm_ctl.core.law import formation_law
from tests.golden.traces import differences, first_difference, fly, read, rows

SMALL = ("003", "017", "042", "058", "077", "091")
"""Short ones, for each run of the tests; `python -m tests.golden check` flies all."""


def test_no_flight_has_changed() -> None:
    """A change that means to change one writes the hashes anew and names the rows."""
    golden = read()
    if not golden.is_of_here():
        pytest.skip(f"the hashes are of another machine: {golden.made_with}")
    changed = differences(golden.hashes, fly(SMALL, 1))
    assert changed == [], "python -m tests.golden check"


def test_all_rows_have_a_hash() -> None:
    assert read().hashes.keys() == rows().keys()
    assert len(rows()) > 100


def test_a_flight_is_the_same_in_another_process() -> None:
    """Also where sets and dicts of words have another order."""
    code = "from tests.golden.traces import fly; print(fly(['017'], 1)['017'])"
    told = [
        subprocess.run(
            [sys.executable, "-c", code],
            env={"PYTHONHASHSEED": seed, "PATH": ""},
            cwd=Path(__file__).parents[2],
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        ).stdout
        for seed in ("1", "2")
    ]
    assert told[0] == told[1]


def test_the_first_difference_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another gain of the law: the same until it acts, then another setpoint."""
    for name in ("before", "after", "again"):
        (tmp_path / name).mkdir()
    fly(["017"], 1, tmp_path / "before")
    fly(["017"], 1, tmp_path / "again")
    file = "017.jsonl.gz"
    assert first_difference(tmp_path / "before" / file, tmp_path / "again" / file) == ""
    consensus = formation_law.consensus
    monkeypatch.setattr(formation_law, "consensus", lambda *a, **k: 1.001 * consensus(*a, **k))
    fly(["017"], 1, tmp_path / "after")
    told = first_difference(tmp_path / "before" / file, tmp_path / "after" / file)
    assert told.startswith("at ")
    assert "setpoint" in told or "vehicle" in told, told
