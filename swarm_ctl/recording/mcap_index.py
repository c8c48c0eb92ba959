"""A recording read by chunks, in any order; a chunk is about a second of the wall clock."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from mcap.records import Channel, Chunk, Message, Metadata

from swarm_ctl.core.model.messages import Payload
from swarm_ctl.errors import InputError
from swarm_ctl.recording.mcap_reader import named, open_recording, payload_of, start_of
from swarm_ctl.recording.mcap_records import (
    TORN,
    RecordingDamage,
    mended,
    records_of,
    skip_magic,
    within,
)
from swarm_ctl.recording.mcap_writer import NANO


class IndexedRecording:
    """The payloads of a recording by chunks: `recording[k]` reads the k-th one from the disk.

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
