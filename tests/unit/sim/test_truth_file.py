"""The truth file on a disk that takes no more (`/dev/full`): it ends, and says so once; nothing is
raised."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from swarm_sim.world.truth_file import TruthFile

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
