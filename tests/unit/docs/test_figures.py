"""Figures of the README and of docs/pages/safety.md, from the commands that stand beside them."""

from __future__ import annotations

import csv
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.unit.docs.pages import PAGES, ROOT, commands

SAFETY = (PAGES / "safety.md").read_text()
MIX = "swarm-ctl study studies/mix.yaml"
Rows = list[dict[str, str]]


def flown(name: str, folder: Path) -> Rows:
    """The rows of a study file, flown anew."""
    arguments = [sys.executable, "-m", "swarm_ctl.cli.main", "study", ROOT / "studies" / name]
    subprocess.run([*arguments, "--out", "rows.csv"], cwd=folder, check=True, capture_output=True)
    with (folder / "rows.csv").open() as file:
        return list(csv.DictReader(file))


def collided(rows: Rows) -> int:
    return sum(row["collided"] == "1" for row in rows)


def table(after: str) -> list[list[float]]:
    """The numbers of each line of the first table after some words."""
    found = SAFETY.split(after)[1].split("|---", 1)[1].split("\n\n")[0].splitlines()[1:]
    return [[float(n) for n in re.findall(r"-?\d+(?:\.\d+)?", line)] for line in found]


def test_the_readme_and_the_page_have_one_command() -> None:
    for document in (ROOT / "README.md", PAGES / "safety.md"):
        assert MIX in commands(document)


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_the_mix(tmp_path: Path) -> None:
    rows = flown("mix.yaml", tmp_path)
    kept, bare = ([row for row in rows if row["safety"] == level] for level in ("align", "off"))
    text = (ROOT / "README.md").read_text()
    assert (len(kept), collided(kept)) == (800, 0)
    assert f"Without the filter one did in {collided(bare)} of 800 missions" in text
    assert min(float(row["smallest_units"]) for row in kept) == pytest.approx(0.629, abs=1e-3)


@pytest.mark.long
@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    ("name", "words"), [("late.yaml", "answers later than"), ("late-quick.yaml", "little lag")]
)
def test_vehicles_unlike_their_model(name: str, words: str, tmp_path: Path) -> None:
    """Each line of the table: from, to [s], collided, of, smallest."""
    rows = flown(name, tmp_path)
    for low, high, bad, count, smallest in table(words):
        within = [row for row in rows if low <= float(row["least_dead_time_s"]) - 0.5 < high]
        assert (collided(within), len(within)) == (bad, count)
        assert min(float(row["smallest_units"]) for row in within) == pytest.approx(
            smallest, abs=1e-3
        )
