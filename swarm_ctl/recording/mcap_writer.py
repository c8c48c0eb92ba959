"""Writes one MCAP file. Not for a control loop: it works with the disk; `recorder.Recorder` keeps
it off the caller."""

from __future__ import annotations

import contextlib
import fcntl
import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from mcap.writer import Writer

from swarm_ctl.recording.topics import Topic

NANO: Final = 1_000_000_000


class McapWriter:
    """An MCAP file that is whole up to the last `flush`: each one ends a chunk and hands it to the
    system."""

    def __init__(self, path: Path, start_ns: int, about: Mapping[str, str]) -> None:
        self._file = path.open("wb")
        fcntl.flock(
            self._file, fcntl.LOCK_EX | fcntl.LOCK_NB
        )  # `recover` sees by it that the file is being written
        self._start_ns = start_ns
        self._writer = Writer(self._file)
        self._writer.start(profile="", library="swarm_ctl")
        self._writer.add_metadata("run", {"start_ns": str(start_ns)} | dict(about))
        self._file.flush()
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self.counts: Counter[str] = Counter()
        """Messages written, by topic."""

    def write(
        self, topic: Topic, agent: int | None, time_s: float, said_s: float, data: bytes
    ) -> None:
        """Add one JSON message: heard at `time_s`, said at `said_s` (mission time)."""
        name = topic.template.format(id=agent)
        channel = self._channels.get(name)
        if channel is None:
            channel = self._channels[name] = self._register(topic, name)
        self.counts[name] += 1
        self._writer.add_message(
            channel,
            self._nanoseconds(time_s),
            data,
            self._nanoseconds(said_s),
            sequence=self.counts[name],
        )

    def flush(self) -> None:
        """End the chunk: whatever happens to this process now, all that was written so far can be
        read."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._file.flush()

    def close(self) -> None:
        """Write index and footer."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def abandon(self) -> None:
        """Give the file up as it is, after an error."""
        with contextlib.suppress(OSError):
            self._file.close()

    def _register(self, topic: Topic, name: str) -> int:
        if topic.name not in self._schemas:
            text = json.dumps(topic.schema).encode()
            self._schemas[topic.name] = self._writer.register_schema(
                topic.schema["title"], "jsonschema", text
            )
        return self._writer.register_channel(name, "json", self._schemas[topic.name])

    def _nanoseconds(self, time_s: float) -> int:
        return max(0, self._start_ns + round(time_s * NANO))
