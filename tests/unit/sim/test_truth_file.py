"""The truth file on a disk that takes no more (`/dev/full`): it ends, and says so once; nothing is
raised."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from swarm_sim.world.truth_recorder import TruthFile

FULL = Path("/dev/full")


@pytest.mark.skipif(not FULL.exists(), reason="no /dev/full on this system")
def test_a_full_disk_ends_the_file(caplog: pytest.LogCaptureFixture) -> None:
    file = TruthFile(FULL)
    with caplog.at_level(logging.WARNING):
        for k in range(3):
            file.write({"type": "state", "t": k})
    assert file.failure == "No space left on device"
    assert [record.message for record in caplog.records] == [
        "the truth file ends here: No space left on device; flying on"
    ]
    file.close()


def test_an_older_truth_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "truth.jsonl"
    for run in range(3):
        file = TruthFile(path)
        file.write({"run": run})
        file.close()
    names = ("truth.1.jsonl", "truth.2.jsonl", "truth.jsonl")
    assert [(tmp_path / name).read_text() for name in names] == [
        f'{{"run":{run}}}\n' for run in range(3)
    ]
