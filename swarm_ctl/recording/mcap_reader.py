"""Reads recordings, whole, damaged or cut off by a kill, and copies the latter for other tools. A
recording itself is never written to again."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Final, Self

from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.writer import MCAP0_MAGIC, Writer
from pydantic import ValidationError

from swarm_ctl.core.model.messages import AgentState, Payload
from swarm_ctl.errors import InputError
from swarm_ctl.files import locked, open_regular, replacing
from swarm_ctl.recording.mcap_records import (
    TORN,
    RecordingDamage,
    mended,
    records_of,
    skip_magic,
    unpacked,
    within,
)
from swarm_ctl.recording.mcap_writer import NANO
from swarm_ctl.recording.topics import TOPICS, adapter

RECORDING: Final = "recording.mcap"
_KINDS: Final = {
    topic.template.rpartition("/")[2]: topic.payload for topic in TOPICS if topic.payload
}
_RENAMED: Final = {
    b'"commanded_mps":': b'"setpoint_mps":',
    b'"command":': b'"override":',
    b'"next_law":': b'"next_gains_tag":',
    b'"law":': b'"gains_tag":',
    b'"deal":': b'"exchange":',
}
"""Fields of a state as recordings before version 0.2 name them."""


@dataclass(frozen=True, slots=True)
class RecordedMessage:
    """One message of the file."""

    topic: str
    time_s: float
    """Mission time."""
    data: bytes


def read(run: Path, damage: RecordingDamage | None = None) -> Iterator[tuple[float, Payload]]:
    """(time, payload) of all messages that the station heard and sent, in its order.

    `run` is a run folder or an MCAP file, whole or not; `damage` notes what could not be read.
    InputError where there is no recording.
    """
    for message in messages(run, damage):
        payload = payload_of(message.topic, message.data)
        if payload is not None:
            yield message.time_s, payload


def payload_of(topic: str, data: bytes) -> Payload | None:
    """The payload of a message; None if it is not from the mesh, or of another version."""
    kind = _KINDS.get(topic.rpartition("/")[2])
    if kind is AgentState and b'"commanded_mps":' in data:
        for old, new in _RENAMED.items():
            data = data.replace(old, new)
    if kind is not None:
        with contextlib.suppress(ValidationError):
            found: Payload = adapter(kind).validate_json(data)
            return found
    return None


def messages(run: Path, damage: RecordingDamage | None = None) -> Iterator[RecordedMessage]:
    """All messages in the order of the file, as far as it can be read, as `read`."""
    with open_recording(run) as file:
        start_ns, topics = 0, dict[int, str]()
        damage = damage or RecordingDamage()
        for record in _readable(file, damage):
            if isinstance(record, Metadata) and record.name == "run":
                start_ns = start_of(record.metadata) or 0
            elif isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message) and record.channel_id in topics:
                time_s = (record.log_time - start_ns) / NANO
                yield RecordedMessage(topics[record.channel_id], time_s, record.data)
            elif isinstance(record, Message):
                damage.used -= 1  # of a topic that no one names any more


def start_of(about: Mapping[str, str]) -> int | None:
    """Mission time 0 in nanoseconds of the file's clock; None where its metadata do not say."""
    text = about.get("start_ns", "")
    return int(text) if text.isdecimal() and len(text) < 20 else None


def is_whole(run: Path) -> bool:
    """Whether the file ends with a footer and the magic bytes."""
    with open_recording(run) as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - len(MCAP0_MAGIC)))
        return size > 2 * len(MCAP0_MAGIC) and file.read() == MCAP0_MAGIC


def recover(run: Path, *, damaged: bool = False) -> Path | None:
    """Copy what can be read of a recording that was cut off, or is `damaged`, into a whole file
    beside it, for other tools; the copy. None: it needs none, or has one.

    The recording itself stays as it is. One that is being written, and one that is not MCAP, are
    not copied; on Windows none is, which can't tell the first.
    """
    path = path_of(run)
    copy = path.with_name(f"{path.stem}.recovered.mcap")
    with open_recording(run) as file:
        head = file.read(len(MCAP0_MAGIC))
        if head != MCAP0_MAGIC[: len(head)]:
            return None
        file.seek(0)
        if not locked(file.fileno(), shared=True) or (is_whole(run) and not damaged):
            return None
        if copy.exists() and copy.stat().st_mtime >= path.stat().st_mtime:
            return None
        with replacing(copy) as whole:
            _copy(file, Writer(whole))
    return copy


def _copy(file: IO[bytes], writer: Writer) -> None:
    writer.start(profile="", library="swarm_ctl")
    schemas, channels = dict[int, int](), dict[int, int]()
    for record in _readable(file, RecordingDamage()):
        match record:
            case Metadata():
                writer.add_metadata(record.name, record.metadata)
            case Schema() if record.id not in schemas:
                schema = writer.register_schema(record.name, record.encoding, record.data)
                schemas[record.id] = schema
            case Channel() if record.id not in channels:
                schema, encoding = schemas.get(record.schema_id, 0), record.message_encoding
                channels[record.id] = writer.register_channel(record.topic, encoding, schema)
            case Message() if record.channel_id in channels:
                channel, times = channels[record.channel_id], (record.log_time, record.publish_time)
                writer.add_message(channel, times[0], record.data, times[1], record.sequence)
    writer.finish()  # type: ignore[no-untyped-call]


def _readable(file: IO[bytes], damage: RecordingDamage) -> Iterator[Any]:
    """All records that can be read. InputError names the file."""
    with contextlib.suppress(*TORN), named(file):
        skip_magic(file)
        yield from unpacked(file, damage)


@contextlib.contextmanager
def named(file: IO[bytes]) -> Iterator[None]:
    """An InputError about what the file has names the file."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{file.name}: {error}") from None


def path_of(run: Path) -> Path:
    """The MCAP file of a run folder, or the file itself."""
    return run / RECORDING if run.is_dir() else run


def open_recording(run: Path) -> IO[bytes]:
    """The file, open for reading; InputError if it can't be opened."""
    path = path_of(run)
    try:
        return open_regular(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None


class IndexedRecording:
    """The payloads of a recording by chunks: `recording[k]` reads the k-th one from the disk,
    in any order. A chunk is about a second of the wall clock.

    `run` is a run folder or an MCAP file, whole, cut off, or still being written; of the latter
    the chunks at the time of opening.

    Raises:
        InputError: it is not a recording of a run.
    """

    def __init__(self, run: Path) -> None:
        self._file = open_recording(run)
        self._offsets: list[int] = []
        self._topics: dict[int, str] = {}
        self._damage = RecordingDamage()
        self.about: dict[str, str] = {}
        """The station's words about the run: mission, plan_hash, manifest and so on."""
        try:
            with named(self._file):
                self._find_chunks()
                self._start_ns = self._start()
                if not self._topics:  # a file without its footer
                    self._find_topics()
        except InputError:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _: type[BaseException] | None, __: BaseException | None, ___: TracebackType | None
    ) -> None:
        self._file.close()

    def __len__(self) -> int:
        return len(self._offsets)

    def __getitem__(self, k: int) -> list[tuple[float, Payload]]:
        """(time heard [s], payload) of the k-th chunk, by time."""
        found = []
        for record in self._within(k):
            if isinstance(record, Message):
                payload = payload_of(self._topics.get(record.channel_id, ""), record.data)
                if payload is not None:
                    found.append(((record.log_time - self._start_ns) / NANO, payload))
        return sorted(found, key=lambda said: said[0])

    def damage(self) -> RecordingDamage:
        """What of the file can't be read: all chunks are looked at."""
        found = self._damage = RecordingDamage(bad=self._damage.bad, said=self._damage.said)
        for k in range(len(self)):
            for _ in self._within(k):
                break
        return found

    def _start(self) -> int:
        found = start_of(self.about)
        if found is None:
            raise InputError("no recording of a run; allowed: a run folder or its recording.mcap")
        return found

    def _find_chunks(self) -> None:
        with contextlib.suppress(*TORN):
            skip_magic(self._file)
            offset = self._file.tell()
            for record in mended(self._file, self._damage):
                match record:
                    case Metadata() if record.name == "run":
                        self.about = dict(record.metadata)
                    case Chunk():
                        self._offsets.append(offset)
                    case Channel():  # again, in front of the footer
                        self._topics[record.id] = record.topic
                offset = self._file.tell()

    def _find_topics(self) -> None:
        for k in range(len(self)):
            for record in self._within(k):
                if isinstance(record, Channel):
                    self._topics[record.id] = record.topic

    def _within(self, k: int) -> Iterator[Any]:
        """The records of the k-th chunk, as far as they can be read; InputError as of a recording
        that is none of ours."""
        self._file.seek(self._offsets[k])
        with contextlib.suppress(*TORN), named(self._file):
            chunk = next(found for found in records_of(self._file) if isinstance(found, Chunk))
            yield from within(chunk, self._damage)
