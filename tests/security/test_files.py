"""Files of strangers: run folders, recordings, missions and plans that were made to do harm."""

from __future__ import annotations

import os
import stat
import struct
import time
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as Xml

import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.writer import MCAP0_MAGIC, RecordBuilder

from swarm_ctl.core.model.messages import Event, Severity
from swarm_ctl.core.model.vehicle import OwnParameters, OwnValue, VehicleIdentity
from swarm_ctl.engine.flying_runs import make_folder
from swarm_ctl.engine.station.printers import write
from swarm_ctl.engine.vehicle_memory import VehicleMemory
from swarm_ctl.errors import InputError, MissionError
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.mission.compile.plan_file import read_plan
from swarm_ctl.mission.input.yaml_file import MOST_ENTRIES
from swarm_ctl.mission.mission_file import MissionFile
from swarm_ctl.recording import IndexedRecording, recover
from swarm_ctl.recording.mcap_reader import messages
from swarm_ctl.recording.mcap_recorder import McapRecorder
from swarm_ctl.recording.mcap_records import CHUNK_BYTES
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.report.judge.summary import write_summary
from swarm_ctl.report.page.html_page import make_report
from swarm_ctl.report.page.junit import junit
from swarm_ctl.report.page.run_history import read_history
from swarm_ctl.runfolder.files import Damage, read_lines
from swarm_ctl.runfolder.manifest import read_manifest
from swarm_ctl.runfolder.truth import load_truth
from tests.unit.mission.example import TEXT, edited
from tests.unit.report.run_folders import EXIT_CODES, write_run

LINE: Final = "root:$6$salt$hash:20000:0:99999:7:::"
START_NS: Final = 1_800_000_000_000_000_000


@pytest.fixture
def precious(tmp_path: Path) -> Iterator[Path]:
    """A file that no command may change."""
    path = tmp_path / "precious"
    path.write_text("precious")
    yield path
    assert path.read_text() == "precious"


def hostile_run(tmp_path: Path) -> Path:
    """A run folder with a recording that a kill cut off."""
    folder = tmp_path / "run"
    folder.mkdir()
    write_run(folder)
    recorder = McapRecorder(folder, START_NS, {})
    for k in range(50):
        recorder.take(Event(1, float(k), Severity.INFO, "word"), float(k))
    recorder.close()
    path = folder / "recording.mcap"
    path.write_bytes(path.read_bytes()[:-20])
    return folder


def test_nothing_is_written_through_a_link(tmp_path: Path, precious: Path) -> None:
    """Not at the names that were once used for temporary files, nor at the files' own."""
    folder = hostile_run(tmp_path)
    (folder / "figures").mkdir()
    figures = ["figures/trajectories.png", "figures/trajectories.svg"]
    made = ["report.html", "summary.json", "recording.recovered.mcap", *figures]
    parts = [f".{name}.{os.getpid()}" for name in ("recording.mcap", "report.html", "summary.json")]
    for name in made + parts:
        (folder / name).symlink_to(precious)
    write_summary(folder, summarise(folder, EXIT_CODES))
    make_report(folder)
    assert not [name for name in made if (folder / name).is_symlink()]
    assert (folder / "recording.recovered.mcap").read_bytes().endswith(MCAP0_MAGIC)


def test_a_folder_of_figures_elsewhere_is_refused(tmp_path: Path) -> None:
    folder, elsewhere = hostile_run(tmp_path), tmp_path / "elsewhere"
    elsewhere.mkdir()
    (folder / "figures").symlink_to(elsewhere)
    with pytest.raises(InputError, match="is a link to elsewhere"):
        make_report(folder)
    assert not list(elsewhere.iterdir())


@pytest.mark.timeout(20)
def test_a_fifo_in_a_run_folder_keeps_no_command_waiting(tmp_path: Path) -> None:
    folder = hostile_run(tmp_path)
    for name in ("truth.jsonl", "statuses.jsonl", "recording.mcap", "agents/3.json"):
        (folder / name).unlink()
        os.mkfifo(folder / name)
        told = read_history(folder).notes
        assert [note for note in told if "is no regular file" in note], name
    (folder / "run.json").unlink()
    os.mkfifo(folder / "run.json")
    with pytest.raises(InputError, match="is no regular file"):
        read_history(folder)


def test_a_line_without_an_end_takes_no_memory(tmp_path: Path) -> None:
    """The rest of the file is read."""
    path = tmp_path / "lines.jsonl"
    path.write_bytes(b"1\n" + b"x" * 20_000_000 + b"\n2\n")
    damage = Damage()
    tracemalloc.start()
    try:
        assert list(read_lines(path, damage)) == [b"1\n", b"2\n"]
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
    finally:
        tracemalloc.stop()
    assert (damage.bad_lines, damage.torn) == (1, False)


def test_a_run_folder_and_a_memory_are_their_users_alone(tmp_path: Path) -> None:
    def mode(path: Path) -> int:
        return stat.S_IMODE(path.stat().st_mode)

    assert mode(make_folder(tmp_path / "runs", "m")) == 0o700
    memory = VehicleMemory(tmp_path / "state" / "swarm_ctl")
    identity = VehicleIdentity("ardupilot", 3, "")
    memory.write(OwnParameters(identity, {"FS_GCS_ENABLE": OwnValue(1.0, (2.0,))}), "tcp:x:1", "f")
    (entry,) = memory.folder.iterdir()
    assert (mode(memory.folder), mode(entry)) == (0o700, 0o600)


def record(opcode: int, data: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(data)) + data


def chunk(data: bytes, compression: str = "zstd", told: int = CHUNK_BYTES) -> bytes:
    builder = RecordBuilder()
    Chunk(compression, data, 0, 0, 0, told).write(builder)
    made: bytes = builder.end()
    return made


def squeezed(size: int, *, told: bool) -> bytes:
    """A frame of zstd that expands to `size` bytes; `told`: its header says so."""
    packer = zstandard.ZstdCompressor(write_content_size=told).compressobj(
        size=size if told else -1
    )
    block = record(0x80, bytes((1 << 20) - 9))
    return b"".join(packer.compress(block) for _ in range(size >> 20)) + packer.flush()


BOMBS: Final[dict[str, tuple[Callable[[], bytes], str]]] = {
    "a size that is told": (lambda: chunk(squeezed(512 << 20, told=True)), "expands to"),
    "a size that is not": (lambda: chunk(squeezed(512 << 20, told=False)), "expands to"),
    "many small ones": (lambda: 3 * chunk(squeezed(4 << 20, told=True)), "100 times"),
    "a record's length": (lambda: struct.pack("<BQ", Opcode.CHUNK, 1 << 40), "a record has"),
    "another packer": (lambda: chunk(b"x" * 100, "lz4"), "lz4"),
}


@pytest.mark.parametrize("name", BOMBS)
def test_no_recording_takes_more_than_a_few_times_its_size(tmp_path: Path, name: str) -> None:
    """Each reader refuses it, and names the file."""
    made, words = BOMBS[name]
    path = tmp_path / "recording.mcap"
    metadata = RecordBuilder()
    metadata.start_record(Opcode.METADATA)
    metadata.write_prefixed_string("run")
    metadata.write4(8 + 8 + 1)
    metadata.write_prefixed_string("start_ns")
    metadata.write_prefixed_string("1")
    metadata.finish_record()
    path.write_bytes(MCAP0_MAGIC + metadata.end() + made())
    for read in (lambda: list(messages(path)), lambda: recover(path), lambda: _all_of(path)):
        tracemalloc.start()
        try:
            with pytest.raises(InputError, match=f"recording.mcap: .*{words}"):
                read()
            assert tracemalloc.get_traced_memory()[1] < 5 * CHUNK_BYTES
        finally:
            tracemalloc.stop()
    assert [entry.name for entry in tmp_path.iterdir()] == ["recording.mcap"]


def _all_of(path: Path) -> None:
    with IndexedRecording(path) as recording:
        for k in range(len(recording)):
            recording[k]


def test_a_bomb_leaves_the_report_of_a_run(tmp_path: Path) -> None:
    """The page says what was not read."""
    folder = hostile_run(tmp_path)
    (folder / "recording.mcap").write_bytes(MCAP0_MAGIC + chunk(squeezed(512 << 20, told=False)))
    assert [note for note in read_history(folder).notes if "a chunk expands to" in note]


def mission_with(tmp_path: Path, path: str) -> Path:
    """A mission whose shape `row` comes from the CSV file `path`."""
    folder = tmp_path / "missions"
    folder.mkdir(exist_ok=True)
    offsets = TEXT[TEXT.index("    kind: offsets") : TEXT.index("steps:")]
    mission = folder / "m.yaml"
    mission.write_text(edited((offsets, f"    kind: csv\n    path: {path}\n")))
    return mission


@pytest.mark.timeout(20)
@pytest.mark.parametrize(
    ("path", "why"),
    [
        ("../secret.csv", "lies outside of the mission's folder"),
        ("/etc/passwd", "lies outside of the mission's folder"),
        ("/dev/zero", "lies outside of the mission's folder"),
        ("link.csv", "lies outside of the mission's folder"),
        ("fifo.csv", "is no regular file"),
        ("large.csv", "is larger than 1 MB"),
        ("inside.csv", "has 1 cells: not a slot"),
        (".", "Is a directory"),
    ],
)
def test_a_shapes_file_is_a_small_one_beside_the_mission(
    tmp_path: Path, path: str, why: str
) -> None:
    """What is in another file is not shown, and none keeps the reader waiting."""
    mission = mission_with(tmp_path, path)
    (tmp_path / "secret.csv").write_text(f"{LINE}\n")
    (mission.parent / "link.csv").symlink_to(tmp_path / "secret.csv")
    (mission.parent / "inside.csv").write_text(f"{LINE}\n" * 2)
    (mission.parent / "large.csv").write_text("0,1\n" * 300_000)
    os.mkfifo(mission.parent / "fifo.csv")
    with pytest.raises(MissionError) as caught:
        load(mission)
    assert why in str(caught.value)
    assert "salt" not in str(caught.value)


def test_a_fleet_that_is_another_file_is_not_shown(tmp_path: Path) -> None:
    (tmp_path / "shadow").write_text(f"{LINE}\n")
    mission = tmp_path / "m.yaml"
    mission.write_text(f"{TEXT[: TEXT.index('fleet:')]}fleet: shadow\n")
    with pytest.raises(MissionError) as caught:
        load(mission)
    assert "shadow:1: fleet: has a field whose name is no word" in str(caught.value)
    assert "salt" not in str(caught.value)


MANY: Final = {
    "agents": ("agents:\n" + "  - {id: 1, start: [0, 0]}\n" * 60_000, "250"),
    "fields": ("".join(f"f{k}: 1\n" for k in range(100_000)), "31125"),
    "values": ("along: [" + "[0, 1]," * 10_000 + "]\n", "200"),
    "lists of lists": ("a: [" + f"[{'1,' * 999}1]," * 1000 + "]\n", "250000 values"),
}


@pytest.mark.parametrize("name", [name for name in MANY if name in ("agents", "values")])
def test_a_list_that_is_too_long_is_told_before_it_is_read(tmp_path: Path, name: str) -> None:
    """With the most that is allowed."""
    _refused_soon(tmp_path, *MANY[name], seconds=2.0)


@pytest.mark.long
@pytest.mark.parametrize("name", MANY)
def test_no_mission_takes_longer_than_the_largest_one(tmp_path: Path, name: str) -> None:
    _refused_soon(tmp_path, *MANY[name], seconds=60.0)


def _refused_soon(tmp_path: Path, text: str, words: str, seconds: float) -> None:
    mission = tmp_path / "m.yaml"
    mission.write_text(text)
    begun = time.process_time()
    with pytest.raises(MissionError, match=words):
        load(mission)
    assert time.process_time() - begun < seconds


def test_the_longest_lists_are_the_schemas() -> None:
    """Of each field whose list is bounded in one way."""
    bounds: dict[str, set[int]] = {}
    schema = MissionFile.model_json_schema()
    for model in (schema, *schema["$defs"].values()):
        for field, node in model.get("properties", {}).items():
            for each in (node, *node.get("anyOf", ())):
                if "maxItems" in each and "prefixItems" not in each:
                    bounds.setdefault(field, set()).add(each["maxItems"])
    assert {field: {most} for field, most in MOST_ENTRIES.items()} == {
        field: most for field, most in bounds.items() if field not in ("neighbours", "faults")
    }


@pytest.mark.timeout(20)
def test_a_plan_and_a_manifest_are_bounded(tmp_path: Path) -> None:
    large, fifo = tmp_path / "plan.json", tmp_path / "run.json"
    with large.open("wb") as file:
        file.truncate(40_000_000)
    os.mkfifo(fifo)
    with pytest.raises(InputError, match="is larger than 32 MB"):
        read_plan(large)
    with pytest.raises(InputError, match="is no regular file"):
        read_plan(fifo)
    with pytest.raises(InputError, match="is no regular file"):
        read_manifest(tmp_path)
    with pytest.raises(OSError, match="is no regular file"):
        load_truth(fifo)


EVIL: Final = "\x1b]0;owned\x07\x1b[2J\x9b31m‮"


def test_what_is_printed_can_not_command_a_terminal() -> None:
    """Lines of the log, whatever said them."""
    reader, writer = os.pipe()
    write(writer, [f"[  1.0 s] agent 3: {EVIL}", "plain ± text"])
    os.close(writer)
    with os.fdopen(reader, encoding="utf-8") as pipe:
        first, second = pipe.read().splitlines()
    assert first.isprintable()
    assert second == "plain ± text"


def test_a_junit_file_can_be_read_whatever_is_in_a_summary(tmp_path: Path) -> None:
    """XML has no control characters at all."""
    summary = summarise(write_run(tmp_path), {**EXIT_CODES, "sim": 1})
    summary = summary.model_copy(update={"mission": EVIL, "reason": EVIL})
    (suite,) = Xml.fromstring(junit(summary).encode())  # noqa: S314 - what is tested
    assert suite.attrib["name"].isprintable()
