"""Records messages without a wait: a thread encodes and writes them.

A disk that can't keep up fills the queue; then messages are dropped and counted.
"""

from __future__ import annotations

import queue
import threading
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from swarm_ctl.core.model.messages import AgentState, Payload
from swarm_ctl.recording.mcap_reader import RECORDING
from swarm_ctl.recording.mcap_writer import McapWriter
from swarm_ctl.recording.topics import ADAPTERS, BY_NAME, BY_PAYLOAD, SetpointRecord, Topic

_LIMIT: Final = 20_000
"""Messages that may wait: ten seconds of a hundred agents."""
_CHUNK_WALL_S: Final = 1.0


class McapRecorder:
    """Records payloads, and the lines of the truth file as it grows, into `folder`.

    `rates_hz` limits the messages of a topic from each agent; others are recorded whole.
    """

    def __init__(
        self,
        folder: Path,
        start_ns: int,
        about: Mapping[str, str],
        rates_hz: Mapping[str, float] | None = None,
    ) -> None:
        self._queue: queue.SimpleQueue[tuple[Payload, float] | None] = queue.SimpleQueue()
        self._writer = McapWriter(folder / RECORDING, start_ns, about)
        self._rates_hz = dict(rates_hz or {})
        self._due: dict[tuple[str, Any], float] = {}
        self._truth = _Tail(folder / "truth.jsonl")
        self.dropped = 0
        self.failure = ""
        """Why the recording ended (a full disk); '' as long as it goes on."""
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    @property
    def counts(self) -> Counter[str]:
        """Messages written so far, by topic."""
        return self._writer.counts

    def take(self, payload: Payload, heard_s: float) -> None:
        """Record a payload heard at `heard_s`; returns at once."""
        if self.failure or self._queue.qsize() >= _LIMIT:
            self.dropped += 1
        else:
            self._queue.put((payload, heard_s))

    def close(self, patience_wall_s: float = 5.0) -> None:
        """Write the queue, index and footer; gives up if the disk does not answer."""
        self._queue.put(None)
        self._thread.join(patience_wall_s)

    def _work(self) -> None:
        try:
            while self._write_chunk():
                pass
            self._writer.close()
        except OSError as error:
            self.failure = error.strerror or str(error)
            self._writer.abandon()

    def _write_chunk(self) -> bool:
        """Write the messages of a second and flush; False after the last one."""
        going = True
        alarm = threading.Event()
        timer = threading.Timer(_CHUNK_WALL_S, alarm.set)
        timer.daemon = True
        timer.start()
        while going and not alarm.is_set():
            try:
                item = self._queue.get(timeout=_CHUNK_WALL_S / 4)
            except queue.Empty:
                continue
            if item is None:
                going = False
            else:
                self._record(*item)
        timer.cancel()
        for time_s, line in self._truth.lines():
            self._write(BY_NAME["truth"], None, time_s, time_s, line)
        self._writer.flush()
        return going

    def _record(self, payload: Payload, heard_s: float) -> None:
        topic = BY_PAYLOAD.get(type(payload))
        if topic is None:
            self.dropped += 1
            return
        agent = getattr(payload, "agent", None)
        said_s = getattr(payload, "time_s", heard_s)
        self._write(topic, agent, heard_s, said_s, ADAPTERS[type(payload)].dump_json(payload))
        if isinstance(payload, AgentState):
            (north, east), (vn, ve, _) = payload.setpoint_mps, payload.velocity_ned_mps
            point = SetpointRecord(payload.time_s, north, east, vn, ve)
            self._write(
                BY_NAME["setpoint"],
                agent,
                heard_s,
                said_s,
                ADAPTERS[SetpointRecord].dump_json(point),
            )

    def _write(
        self, topic: Topic, agent: int | None, time_s: float, said_s: float, data: bytes
    ) -> None:
        rate_hz = self._rates_hz.get(topic.name, 0.0)
        key = (topic.name, agent)
        if rate_hz > 0 and said_s < self._due.get(key, 0.0):
            return
        self._due[key] = said_s + (1.0 / rate_hz - 1e-9 if rate_hz > 0 else 0.0)
        self._writer.write(topic, agent, time_s, said_s, data)


class _Tail:
    """Reads the new lines of a growing file of JSON objects with a time `t`."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._read = 0

    def lines(self) -> list[tuple[float, bytes]]:
        """(time, line) of each whole line since the last call."""
        try:
            with self._path.open("rb") as file:
                file.seek(self._read)
                data = file.read()
        except OSError:
            return []
        whole = data[: data.rfind(b"\n") + 1]
        self._read += len(whole)
        return [(_time_of(line), line) for line in whole.splitlines()]


def _time_of(line: bytes) -> float:
    """The value of `"t":`, without parsing the whole line."""
    _, _, rest = line.partition(b'"t":')
    number = rest.lstrip().split(b",", 1)[0].rstrip(b"}")
    try:
        return float(number)
    except ValueError:
        return 0.0
