"""A recording chunk by chunk: all that `read` gives, in files whole, torn and foreign."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.writer import Writer

from swarm_ctl import recording
from swarm_ctl.errors import InputError
from swarm_ctl.recording.mcap_reader import IndexedRecording, recover
from swarm_ctl.recording.mcap_writer import NANO, McapWriter
from swarm_ctl.recording.topics import BY_PAYLOAD, adapter
from tests.unit.recording.test_recording import START_NS, flight


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A recording of many chunks."""
    made = McapWriter(tmp_path / recording.RECORDING, START_NS, {"mission": "test"})
    for k, (payload, heard_s) in enumerate(sorted(flight(6), key=lambda said: said[1])):
        data = adapter(type(payload)).dump_json(payload)
        heard_ns = START_NS + round(heard_s * NANO)
        made.write(
            BY_PAYLOAD[type(payload)], getattr(payload, "agent", None), heard_ns, heard_ns, data
        )
        if k % 40 == 0:
            made.flush()
    made.close()
    return tmp_path


@pytest.mark.parametrize("share", [1.0, 0.9, 0.5])
def test_its_chunks_are_what_read_gives(run: Path, share: float) -> None:
    """In any order of asking, also without the footer."""
    path = run / recording.RECORDING
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    wanted = list(recording.read(run))
    with IndexedRecording(run) as tape:
        assert len(tape) > 3
        chunks = {k: tape[k] for k in reversed(range(len(tape)))}
        assert [said for k in range(len(tape)) for said in chunks[k]] == wanted
        assert tape.about["mission"] == "test"


def test_foreign_files_are_refused_and_left_alone(tmp_path: Path) -> None:
    """No MCAP, another tool's MCAP, nothing at all: an error with the name, and not a byte changed
    by `recover`."""
    words, foreign, empty = (
        tmp_path / "words.txt",
        tmp_path / "foreign.mcap",
        tmp_path / "empty.mcap",
    )
    words.write_text("a long story " * 100)
    with foreign.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()  # type: ignore[no-untyped-call]
    empty.touch()
    for path in (words, foreign, empty):
        before = path.read_bytes()
        with pytest.raises(InputError, match=rf"{path.name}: no recording of a run; allowed"):
            IndexedRecording(path)
        if path is not empty:
            assert not recover(path)
        assert path.read_bytes() == before
    with pytest.raises(InputError, match="No such file"):
        IndexedRecording(tmp_path)
