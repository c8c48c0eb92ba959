"""The rare failures among millions of missions: each flies again alone, as the page has it."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarm_ctl.study.parameter_space import study_file
from swarm_ctl.study.rerun import rerun

MILLION = Path(__file__).parents[3] / "studies" / "million.yaml"
RUNS = {1001: "16667", 1002: "38889"}
"""Missions of each cell, by seed."""


@pytest.mark.parametrize(
    ("seed", "row", "column", "found"),
    [
        (1001, 2276703, "smallest_units", 0.462),
        (1001, 2269669, "smallest_units", 0.494),
        (1001, 2894024, "smallest_units", 0.494),
        (1001, 1645828, "smallest_silent_units", 0.467),
        (1002, 2909326, "smallest_silent_units", 0.450),
        (1002, 3367619, "smallest_silent_units", 0.498),
        (1002, 5240878, "smallest_silent_units", 0.480),
    ],
)
def test_a_rare_failure_flies_again(
    seed: int, row: int, column: str, found: float, tmp_path: Path
) -> None:
    given = {"burst_s": "0", "n": "2:16", "seed": seed, "missions": RUNS[seed]}
    study = study_file(MILLION, given).study
    assert rerun(tmp_path / "none.parquet", row, study).row[column] == pytest.approx(
        found, abs=0.0005
    )
