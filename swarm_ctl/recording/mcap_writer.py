"""Writes one MCAP file. It waits for the disk: `mcap_recorder.py` runs it in a thread."""

from __future__ import annotations

import contextlib
import errno
import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from mcap.writer import Writer

from swarm_ctl.files import locked
from swarm_ctl.recording.topics import Topic

NANO: Final = 1_000_000_000


class McapWriter:
    """An MCAP file that can be read up to the last `flush`, which ends a chunk."""

    def __init__(self, path: Path, start_ns: int, about: Mapping[str, str]) -> None:
        self._file = path.open("wb")
        if not locked(self._file.fileno()):  # by this `recover` sees that the file is being written
            raise BlockingIOError(errno.EAGAIN, "can't be locked", str(path))
        self._writer = Writer(self._file)
        self._writer.start(profile="", library="swarm_ctl")
        self._writer.add_metadata("run", {"start_ns": str(start_ns)} | dict(about))
        self._file.flush()
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self.counts: Counter[str] = Counter()
        """Messages written, by topic."""

    def write(
        self, topic: Topic, agent: int | None, heard_ns: int, said_ns: int, data: bytes
    ) -> None:
        """Add one JSON message; Unix times of mission time."""
        name = topic.template.format(id=agent)
        channel = self._channels.get(name)
        if channel is None:
            channel = self._channels[name] = self._register(topic, name)
        self.counts[name] += 1
        self._writer.add_message(channel, heard_ns, data, said_ns, sequence=self.counts[name])

    def flush(self) -> None:
        """End the chunk: if this process dies now, all that was written can be read."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._file.flush()

    def close(self) -> None:
        """Write index and footer."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def abandon(self) -> None:
        """Close the file as it is, after an error."""
        with contextlib.suppress(OSError):
            self._file.close()

    def _register(self, topic: Topic, name: str) -> int:
        if topic.name not in self._schemas:
            schema = topic.schema()
            self._schemas[topic.name] = self._writer.register_schema(
                schema["title"], "jsonschema", json.dumps(schema).encode()
            )
        return self._writer.register_channel(name, "json", self._schemas[topic.name])
