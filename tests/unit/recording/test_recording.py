"""Recordings: what is read is what was written, with any tool, and after a kill at any byte."""

from __future__ import annotations

import json
import random
import re
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import pytest
from mcap.reader import make_reader
from mcap.records import Chunk

from swarm_ctl import recording
from swarm_ctl.core.model.messages import (
    Ack,
    AgentState,
    Command,
    Event,
    Payload,
    Severity,
    SigmaReport,
    StationBeacon,
)
from swarm_ctl.errors import InputError
from swarm_ctl.recording import mcap_reader, mcap_recorder
from swarm_ctl.recording.mcap_reader import is_whole, messages, recover
from swarm_ctl.recording.mcap_recorder import McapRecorder
from swarm_ctl.recording.mcap_records import RecordingDamage, records_of, skip_magic
from swarm_ctl.recording.topics import TOPICS, adapter, rates
from swarm_ctl.station.picture.model import Model
from tests.unit.station.swarm import hexagon_plan, report_of, state_of, status_of

PLAN = hexagon_plan()

START_NS = 1_800_000_000_000_000_000


def flight(seconds: int = 3) -> list[tuple[Payload, float]]:
    """What a station hears of three agents: states at 20 Hz and the rest."""
    said: list[tuple[Payload, float]] = []
    for k in range(seconds * 20):
        now = 10.0 + k / 20
        for agent in (1, 2, 3):
            said.append((state_of(PLAN, agent, now, seq=k), now + 0.01))
            if k % 10 == 0:
                said.append((status_of(PLAN, agent, now), now + 0.02))
    said.append((Event(1, 11.0, Severity.WARNING, "low ± battery"), 11.1))
    said.append((Command("x", "land", (), 12.0), 12.0))
    said.append((Ack(2, "x", True, ""), 12.1))
    said.append((StationBeacon("station-1", 12.0, 7), 12.2))
    said.append((SigmaReport(1, 12.0, (0.1, 0.0), (0.0, 0.2), (report_of(2, 1.0),)), 12.3))
    return said


def counts(run: Path) -> Counter[str]:
    return Counter(message.topic for message in messages(run))


def record(
    folder: Path, said: list[tuple[Payload, float]], rates_hz: dict[str, float] | None = None
) -> McapRecorder:
    made = McapRecorder(folder, START_NS, {"mission": "test"}, rates_hz)
    for payload, heard_s in said:
        made.take(payload, heard_s)
    made.close()
    return made


def test_read_gives_back_what_was_said(tmp_path: Path) -> None:
    """Every payload, in its order, equal in every field; and it folds into a model."""
    said = flight()
    record(tmp_path, said)
    found = list(recording.read(tmp_path))
    assert [payload for _, payload in found] == [payload for payload, _ in said]
    assert [time for time, _ in found] == pytest.approx([heard for _, heard in said], abs=1e-6)
    model = Model(PLAN)
    for time_s, payload in found:
        model.fold(payload, time_s)
    assert model.view(found[-1][0]).event_count == 1


def test_other_tools_count_the_same(tmp_path: Path) -> None:
    """The mcap library's own reader: footer, index, a schema for every channel, counts as sent."""
    said = flight()
    record(tmp_path, said)
    with (tmp_path / recording.RECORDING).open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        by_topic = {
            summary.channels[c].topic: n
            for c, n in summary.statistics.channel_message_counts.items()
        }
        for channel in summary.channels.values():
            assert channel.message_encoding == "json"
            assert summary.schemas[channel.schema_id].encoding == "jsonschema"
    for agent in (1, 2, 3):
        assert by_topic[f"/agent/{agent}/state"] == by_topic[f"/agent/{agent}/setpoint"] == 60
        assert by_topic[f"/agent/{agent}/status"] == 6
    assert by_topic["/command"] == by_topic["/agent/2/ack"] == by_topic["/agent/1/event"] == 1


def test_schemas_are_of_the_plain_kind() -> None:
    """Each node has one type that viewers know: no references, no unions, no lists of several
    kinds."""

    def check(node: dict[str, Any]) -> None:
        assert node["type"] in ("object", "array", "string", "number", "integer", "boolean")
        for field in node.get("properties", {}).values():
            check(field)
        if node["type"] == "array":
            check(node["items"])

    for topic in TOPICS:
        check(dict(topic.schema()))


def test_messages_fit_their_schemas(tmp_path: Path) -> None:
    """Every required field is there, with its type."""
    record(tmp_path, flight(1))
    kinds = {
        "number": (int, float),
        "integer": int,
        "string": str,
        "boolean": bool,
        "array": list,
        "object": dict,
    }
    schemas = {topic.template.rpartition("/")[2]: topic.schema() for topic in TOPICS}
    for message in messages(tmp_path):
        schema, found = schemas[message.topic.rpartition("/")[2]], json.loads(message.data)
        assert set(schema["required"]) <= set(found)
        for name, number in found.items():
            assert number is None or isinstance(
                number, kinds[schema["properties"][name]["type"]]
            ), name


@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.9, 0.99, 0.9999])
def test_cut_anywhere_it_is_recovered(
    tmp_path: Path, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was flushed before the cut is there after, in a copy that has its footer; the file stays
    as it is; twice changes nothing."""
    monkeypatch.setattr(mcap_recorder, "_CHUNK_WALL_S", 0.02)
    made = McapRecorder(tmp_path, START_NS, {}, None)
    said = flight(6)
    for k, (payload, heard_s) in enumerate(said):
        made.take(payload, heard_s)
        if k % 60 == 0:
            _wait_for(lambda: made._queue.empty())
    made.close()
    path = tmp_path / recording.RECORDING
    whole = [message.data for message in messages(tmp_path)]
    data = path.read_bytes()
    path.write_bytes(cut := data[: int(len(data) * share)])
    damage = RecordingDamage()
    before = [message.data for message in messages(tmp_path, damage)]
    assert before == whole[: len(before)]
    assert damage.describe("it") == []
    copy = recover(tmp_path)
    assert copy is not None
    assert path.read_bytes() == cut
    assert is_whole(copy)
    assert [message.data for message in messages(copy)] == before
    with copy.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(before)
    assert not recover(tmp_path)
    assert sorted(tmp_path.iterdir()) == sorted([path, copy])


@pytest.mark.parametrize("lacks", range(1, 13))
def test_a_chunk_that_lacks_its_last_bytes_is_cut_off(
    tmp_path: Path, lacks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And not damaged: its head would fit into a file that is one head longer."""
    monkeypatch.setattr(mcap_recorder, "_CHUNK_WALL_S", 0.02)
    made, path = McapRecorder(tmp_path, START_NS, {}, None), tmp_path / recording.RECORDING
    for half in (flight(1), flight(1)):
        for payload, heard_s in half:
            made.take(payload, heard_s)
        _wait_for_a_chunk(path)
    made.close()
    data, whole = path.read_bytes(), [message.data for message in messages(tmp_path)]
    begin = [found.start() - 37 for found in re.finditer(rb"\x04\x00\x00\x00zstd", data)][1]
    end = begin + 9 + int.from_bytes(data[begin + 1 : begin + 9], "little")
    path.write_bytes(data[: end - lacks])
    damage = RecordingDamage()
    before = [message.data for message in messages(tmp_path, damage)]
    assert damage.describe("it") == []
    assert before
    assert before == whole[: len(before)]


def test_a_flipped_byte_costs_a_chunk_and_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 60 places of a file, and at each byte of the lengths in each chunk's head: all other
    chunks are read, what is lost is said with its numbers, and no byte of the file is written."""
    monkeypatch.setattr(mcap_recorder, "_CHUNK_WALL_S", 0.02)
    made, path = McapRecorder(tmp_path, START_NS, {}, None), tmp_path / recording.RECORDING
    for k, (payload, heard_s) in enumerate(flight(6)):
        made.take(payload, heard_s)
        if k % 40 == 0:
            _wait_for_a_chunk(path)
    made.close()
    data, whole = path.read_bytes(), [message.data for message in messages(tmp_path)]
    with path.open("rb") as file:
        chunks = [r for r in records_of_all(file) if isinstance(r, Chunk)]
    assert len(chunks) >= 5
    last = data.rindex(b"zstd")  # behind it are index and footer
    rng, said = random.Random(5), 0
    packed = [found.start() for found in re.finditer(rb"\x04\x00\x00\x00zstd", data)]
    lengths = (*range(9), *range(37, 41), *range(45, 53))  # of record, word zstd, what is packed
    heads = [start - 37 + k for start in packed[: len(chunks)] for k in lengths]
    places = [rng.randrange(data.index(b"zstd"), last) for _ in range(60)]
    for at in heads + places:
        path.write_bytes(flipped := data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :])
        damage = RecordingDamage()
        found = [message.data for message in messages(tmp_path, damage)]
        assert len(found) == damage.used
        lost = len(whole) - len(found)
        assert lost <= len(whole) * 2 // 5, at
        assert set(found) <= set(whole)
        if lost:
            said += 1
            left_out = f"{damage.bad} of {damage.bad + damage.chunks} chunks left out"
            used = f"{len(found)} of {len(whole)} messages used"
            (words,) = damage.describe("it")
            assert words == f"it: damaged; {left_out}, {used}, the file is left as it is"
            copy = recover(tmp_path, damaged=True)
            assert copy is not None
            assert [message.data for message in messages(copy)] == found
            copy.unlink()
        assert path.read_bytes() == flipped
    assert said > 30  # the others fell into the index


def records_of_all(file: IO[bytes]) -> Iterator[Any]:
    """The records of a whole file."""
    skip_magic(file)
    return records_of(file)


def _wait_for(condition: Any) -> None:
    for _ in range(1000):
        if condition():
            return
        threading.Event().wait(0.005)
    raise AssertionError("not reached in 5 s")


def _wait_for_a_chunk(path: Path) -> None:
    """Written since now."""
    size = path.stat().st_size
    _wait_for(lambda: path.stat().st_size > size)


def test_a_state_of_an_earlier_version_is_read() -> None:
    """Each field that has another name since 0.2 is read by its old name, too."""
    state = state_of(PLAN, 1, 2.5, override=7, gains_tag=3, next_gains_tag=4)
    data = adapter(AgentState).dump_json(state)
    for old, new in mcap_reader._RENAMED.items():
        assert new in data
        data = data.replace(new, old)
    assert mcap_reader.payload_of("/agent/1/state", data) == state


def test_rates_thin_a_topic_out(tmp_path: Path) -> None:
    """State at 5 Hz of 20, each agent for itself; other topics whole."""
    record(tmp_path, flight(4), {"state": 5.0})
    found = counts(tmp_path)
    assert found["/agent/1/state"] == found["/agent/3/state"] == 20
    assert found["/agent/1/setpoint"] == 80
    assert rates("state=5,truth=2") == {"state": 5.0, "truth": 2.0}
    for words in ("state", "state=x", "nothing=3", "state=-1"):
        with pytest.raises(InputError, match="allowed"):
            rates(words)


def test_truth_is_taken_in_as_it_grows(tmp_path: Path) -> None:
    """Whole lines only, each once, with its own time."""
    lines = [{"type": "state", "t": 1.5, "ned": [[0, 0, 0]]}, {"type": "end", "t": 2.5}]
    path = tmp_path / "truth.jsonl"
    tail = mcap_recorder._Tail(path)
    assert tail.lines() == []
    text = "".join(json.dumps(line) + "\n" for line in lines).encode()
    path.write_bytes(text[:-5])
    assert [time for time, _ in tail.lines()] == [1.5]
    path.write_bytes(text)
    assert [time for time, _ in tail.lines()] == [2.5]
    record(tmp_path, [])
    found = [message for message in messages(tmp_path) if message.topic == "/truth"]
    kinds = [(message.time_s, json.loads(message.data)["type"]) for message in found]
    assert kinds == [(1.5, "state"), (2.5, "end")]


class _Stuck(mcap_reader.Writer):  # type: ignore[name-defined]
    """A disk that does not answer until it is let go."""

    gate = threading.Event()

    def add_message(self, *arguments: Any, **names: Any) -> None:
        self.gate.wait()
        super().add_message(*arguments, **names)


def test_a_stuck_disk_costs_messages_not_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`take` returns though nothing is written; what does not fit is counted; later all goes on."""
    monkeypatch.setattr("swarm_ctl.recording.mcap_writer.Writer", _Stuck)
    monkeypatch.setattr(mcap_recorder, "_LIMIT", 50)
    _Stuck.gate.clear()
    made = McapRecorder(tmp_path, START_NS, {}, None)
    said = flight()
    for payload, heard_s in said:
        made.take(payload, heard_s)
    assert made.dropped >= len(said) - 52
    _Stuck.gate.set()
    made.close()
    assert sum(1 for _ in recording.read(tmp_path)) == len(said) - made.dropped


def test_a_full_disk_is_told_and_ends_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    made = McapRecorder(tmp_path, START_NS, {}, None)
    monkeypatch.setattr(made._writer, "flush", full)
    made.take(flight()[0][0], 1.0)
    made.close()
    assert any("No space" in str(trouble) for rim in made.rims for trouble in rim.troubles())
    made.take(flight()[0][0], 1.0)
