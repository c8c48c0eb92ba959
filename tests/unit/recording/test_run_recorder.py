"""A station's records on a full disk: that file ends, one warning says so, the others go on."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest

from swarm_ctl.core.model.messages import Ack, Event, Payload, Severity
from swarm_ctl.recording import read
from swarm_ctl.recording.mcap_recorder import McapRecorder
from swarm_ctl.recording.run_recorder import RunRecorder
from swarm_ctl.recording.topics import Derived
from swarm_ctl.runfolder.last_statuses import read_troubles
from tests.unit.station.swarm import hexagon_plan, status_of

FULL = Path("/dev/full")


def troubles_of(recorder: RunRecorder) -> list[str]:
    """What is new."""
    return [str(trouble) for rim in recorder.rims for trouble in rim.troubles()]


@pytest.mark.skipif(not FULL.exists(), reason="no /dev/full on this system")
def test_a_full_disk_is_told_once(tmp_path: Path) -> None:
    (tmp_path / "events.jsonl").symlink_to(FULL)
    recorder = RunRecorder(tmp_path, McapRecorder(tmp_path, 0, {}))
    told: list[str] = []
    for _ in range(3):
        recorder.take(Event(1, 0.0, Severity.INFO, "hello"), 0.0)
        recorder.take(Ack(1, "c", True, ""), 0.0)
        told += troubles_of(recorder)
    recorder.close()
    assert told == ["events.jsonl has stopped: No space left on device; the flight goes on"]
    assert (tmp_path / "commands.jsonl").read_bytes().count(b"\n") == 3


@pytest.mark.parametrize(("agents", "lines"), [(4, 4 * 15), (32, 32 * 8)])
def test_the_file_of_statuses_grows_no_faster_with_more_agents(
    tmp_path: Path, agents: int, lines: float
) -> None:
    """In 30 s, of statuses at 2 Hz."""
    plan, recorder = hexagon_plan(agents), RunRecorder(tmp_path, McapRecorder(tmp_path, 0, {}))
    for half_second in range(60):
        for agent in range(1, agents + 1):
            time_s = 0.5 * half_second
            recorder.take(status_of(plan, agent, time_s), time_s)
    recorder.close()
    found = (tmp_path / "statuses.jsonl").read_bytes().count(b"\n")
    assert found == pytest.approx(lines, rel=0.2)


def test_a_status_from_far_ahead_silences_none_that_come_after_it(tmp_path: Path) -> None:
    plan, recorder = hexagon_plan(), RunRecorder(tmp_path, McapRecorder(tmp_path, 0, {}))
    recorder.take(status_of(plan, 3, 1e9), 10.0)
    for second in range(11, 31):
        recorder.take(status_of(plan, 3, float(second)), float(second))
    recorder.close()
    assert (tmp_path / "statuses.jsonl").read_bytes().count(b"\n") == 1 + 10


def test_an_error_in_what_is_derived_does_not_end_the_recording(tmp_path: Path) -> None:
    """It is told once, and all messages are still recorded."""

    def derive(payload: Payload, heard_s: float) -> Iterable[Derived]:
        raise ValueError("no scene")

    recorder = RunRecorder(tmp_path, McapRecorder(tmp_path, 0, {}, derive=derive))
    for k in range(3):
        recorder.take(Event(1, float(k), Severity.INFO, "hello"), float(k))
    recorder.close()
    (trouble,) = read_troubles(tmp_path)
    assert "Foxglove's view in the record stopped at 2.0 s: ValueError: no scene" in trouble
    assert troubles_of(recorder) == []
    assert len(list(read(tmp_path))) == 3


def test_what_fails_as_the_record_is_closed_is_kept_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There is no turn of the station after that."""

    def full(_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("swarm_ctl.recording.mcap_writer.McapWriter.close", full)
    recorder = RunRecorder(tmp_path, McapRecorder(tmp_path, 0, {}))
    recorder.take(Event(1, 12.34, Severity.INFO, "hello"), 12.34)
    recorder.close()
    assert read_troubles(tmp_path) == ["recording.mcap stopped at 12.3 s: No space left on device"]
