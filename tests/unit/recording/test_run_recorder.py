"""A station's records on a full disk: that file ends, one warning says so, the others go on."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarm_ctl.core.model.messages import Ack, Event, Severity
from swarm_ctl.recording.run_recorder import RunRecorder

FULL = Path("/dev/full")


@pytest.mark.skipif(not FULL.exists(), reason="no /dev/full on this system")
def test_a_full_disk_is_told_once(tmp_path: Path) -> None:
    (tmp_path / "events.jsonl").symlink_to(FULL)
    recorder = RunRecorder(tmp_path, 0, {}, {})
    told: list[str] = []
    for _ in range(3):
        recorder.take(Event(1, 0.0, Severity.INFO, "hello"), 0.0)
        recorder.take(Ack(1, "c", True, ""), 0.0)
        told += recorder.troubles()
    recorder.close()
    assert told == [
        "events.jsonl is not written any more: No space left on device; the flight goes on"
    ]
    assert (tmp_path / "commands.jsonl").read_bytes().count(b"\n") == 3
