"""The truth of a simulator beside the agents, taken into the folder of the run that it is of."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from swarm_ctl.engine.station.judged_flight import take_truth
from swarm_ctl.errors import InputError
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.runfolder.manifest import read_manifest
from swarm_ctl.runfolder.truth import load_truth
from tests.unit.report.run_folders import END, TOUCHDOWN, manifest, truth_lines, write_run

LATER_S = 40.0
"""The simulator's clock began so much later [wall-clock s] than the run's, here at double speed."""


def told(folder: Path, *, drop_end: bool = False, **header: Any) -> Path:
    """What a simulator has written of the usual run, by its own clock."""
    first, *rest = map(json.loads, truth_lines())
    first |= {"epoch_s": 100.0 + LATER_S, "speedup": 2.0} | header
    lines = [first, *rest]
    for line in lines:
        line["t"] -= 2.0 * LATER_S
    lines = [line for line in lines if not (drop_end and line["type"] == "end")]
    path = folder / "told.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run without a truth of its own, which other processes flew."""
    folder = write_run(tmp_path)
    (folder / "truth.jsonl").unlink()
    return folder


OF_RUN = manifest(epoch_s=100.0, speedup=2.0, elsewhere=True, simulated=())


def test_the_run_is_judged_by_it_on_its_own_clock(run: Path, tmp_path: Path) -> None:
    """As by a truth of its own: the same distance at the same time."""
    take_truth(told(tmp_path), run, OF_RUN, END)
    truth = load_truth(run / "truth.jsonl")
    assert truth.complete
    assert truth.time_s[[0, -1]] == pytest.approx([0.0, END])
    assert read_manifest(run).in_truth == {agent.id for agent in OF_RUN.fleet}
    summary = summarise(run)
    assert set(summary.judged_by.values()) == {"truth"}
    assert summary.outcome == "completed", summary.reason


@pytest.mark.parametrize(("now_s", "whole"), [(TOUCHDOWN + 1.0, True), (END + 30.0, False)])
def test_a_simulator_that_still_runs_has_told_all(
    run: Path, tmp_path: Path, now_s: float, whole: bool
) -> None:
    """Its file has no end yet; that of one which died in flight has none either, but its last line
    is old."""
    take_truth(told(tmp_path, drop_end=True), run, OF_RUN, now_s)
    assert load_truth(run / "truth.jsonl").complete is whole


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ({"epoch_s": None}, "when its clock began"),
        ({"speedup": 1.0}, "speed-up 1, this run 2"),
        ({"epoch_s": -5000.0}, "before this flight"),
        ({"sysids": "?"}, "allowed: what sim --truth writes"),
    ],
)
def test_that_of_another_flight_is_refused(
    run: Path, tmp_path: Path, header: dict[str, Any], words: str
) -> None:
    """Nothing of it gets into the folder."""
    with pytest.raises(InputError, match=words):
        take_truth(told(tmp_path, **header), run, OF_RUN, END)
    assert not list(run.glob("*truth*"))
