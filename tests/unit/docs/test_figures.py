"""Figures of the README and of the safety's evidence, from the commands beside them."""

from __future__ import annotations

import csv
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.unit.docs.pages import PAGES, ROOT, commands

SAFETY = (PAGES["safety-evidence"]).read_text()
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


def smallest(rows: Rows) -> float:
    """The distance [units], as documents say it."""
    return round(min(float(row["smallest_units"]) for row in rows), 3)


def test_the_readme_and_the_page_have_one_command() -> None:
    for document in (ROOT / "README.md", PAGES["safety-evidence"]):
        assert MIX in commands(document)


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_the_mix(tmp_path: Path) -> None:
    rows = flown("mix.yaml", tmp_path)
    kept, bare = ([row for row in rows if row["safety"] == level] for level in ("align", "off"))
    text = (ROOT / "README.md").read_text()
    assert (len(kept), collided(kept)) == (800, 0)
    assert f"Without the filter one did in {collided(bare)} of 800 missions" in text
    assert smallest(kept) == min(float(each) for each in re.findall(r"\d / (\d\.\d{3}) \|", SAFETY))


@pytest.mark.long
@pytest.mark.timeout(300)
@pytest.mark.parametrize("name", ["late.yaml", "late-quick.yaml"])
def test_vehicles_unlike_their_model(name: str, tmp_path: Path) -> None:
    rows = flown(name, tmp_path)
    said = re.search(rf"`studies/{name}`.*?has (\d+) of (\d+).*?smallest (\d\.\d+)", SAFETY)
    assert said is not None
    assert (collided(rows), len(rows), smallest(rows)) == (
        int(said[1]),
        int(said[2]),
        float(said[3]),
    )
