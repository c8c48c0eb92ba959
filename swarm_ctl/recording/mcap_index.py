"""A recording read by chunks, in any order; a chunk is about a second of the wall clock."""

from __future__ import annotations

import contextlib
from pathlib import Path
from types import TracebackType
from typing import Self

from mcap.records import Channel, Chunk, Message, Metadata
from mcap.stream_reader import breakup_chunk

from swarm_ctl.core.model.messages import Payload
from swarm_ctl.errors import InputError
from swarm_ctl.recording.mcap_reader import TORN, open_recording, path_of, payload_of, records_of
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
        self._places: list[int] = []
        self._topics: dict[int, str] = {}
        self.about: dict[str, str] = {}
        """The station's words about the run: mission, plan_hash, manifest and so on."""
        self._find_chunks()
        if "start_ns" not in self.about:
            self._file.close()
            allowed = "a run folder or its recording.mcap"
            raise InputError(f"{path_of(run)}: no recording of a run; allowed: {allowed}")
        self._start_ns = int(self.about["start_ns"])
        if not self._topics:  # a file without its footer
            self._find_topics()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _: type[BaseException] | None, __: BaseException | None, ___: TracebackType | None
    ) -> None:
        self._file.close()

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, k: int) -> list[tuple[float, Payload]]:
        """(time heard [s], payload) of the k-th chunk, by time."""
        found = []
        for record in breakup_chunk(self._chunk(k)):
            if isinstance(record, Message):
                payload = payload_of(self._topics.get(record.channel_id, ""), record.data)
                if payload is not None:
                    found.append(((record.log_time - self._start_ns) / NANO, payload))
        return sorted(found, key=lambda said: said[0])

    def _find_chunks(self) -> None:
        with contextlib.suppress(*TORN):
            place = 8
            for record in records_of(self._file, emit_chunks=True):
                match record:
                    case Metadata() if record.name == "run":
                        self.about = dict(record.metadata)
                    case Chunk():
                        self._places.append(place)
                    case Channel():  # again, in front of the footer
                        self._topics[record.id] = record.topic
                place = self._file.tell()

    def _find_topics(self) -> None:
        for k in range(len(self)):
            for record in breakup_chunk(self._chunk(k)):
                if isinstance(record, Channel):
                    self._topics[record.id] = record.topic

    def _chunk(self, k: int) -> Chunk:
        self._file.seek(self._places[k])
        records = records_of(self._file, skip_magic=True, emit_chunks=True)
        return next(record for record in records if isinstance(record, Chunk))
