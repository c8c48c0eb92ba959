"""Records messages without a wait: a thread encodes and writes them.

A disk that can't keep up fills the queue; then messages are dropped and counted.
"""

from __future__ import annotations

import contextlib
import queue
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Protocol, TypeAlias

from swarm_ctl.core.model.messages import AgentState, Payload
from swarm_ctl.recording.mcap_reader import RECORDING
from swarm_ctl.recording.mcap_writer import NANO, McapWriter
from swarm_ctl.recording.topics import BY_NAME, BY_PAYLOAD, Derived, SetpointRecord, Topic, adapter
from swarm_ctl.rim import Rim

_LIMIT: Final = 20_000
"""Messages that may wait: ten seconds of a hundred agents."""
_CHUNK_WALL_S: Final = 1.0
_PAUSES: Final = 4
"""In the time of a chunk. Messages are written together: a thread that wakes for each one costs the
loop beside it its place in the processor's caches."""
_PAUSES_LIVE: Final = 20
"""What is shown live is shown soon."""


Derive: TypeAlias = Callable[[Payload, float], Iterable[Derived]]
"""Gets each payload and when it was heard; what is recorded beside it."""


def _name_of(sink: Sink) -> str:
    return RECORDING if isinstance(sink, McapWriter) else "the live view"


def _nothing(_: Payload, __: float) -> Iterable[Derived]:
    return ()


class Sink(Protocol):
    """Where messages go."""

    def write(
        self, topic: Topic, agent: int | None, heard_ns: int, said_ns: int, data: bytes
    ) -> None:
        """Take one JSON message; Unix times of mission time."""

    def flush(self) -> None:
        """About once a second."""

    def close(self) -> None:
        """After the last message."""

    def abandon(self) -> None:
        """Instead of `close`, after an error."""


class Recorder:
    """Gives payloads, what is derived from them, and the lines of the truth file as it grows, to
    all sinks, in a thread of its own.

    `start_ns` is the Unix time of mission time 0. `rates_hz` limits the messages of a topic from
    each agent; others are given whole.
    """

    def __init__(
        self,
        start_ns: int,
        *sinks: Sink,
        truth: Path | None = None,
        rates_hz: Mapping[str, float] | None = None,
        derive: Derive = _nothing,
    ) -> None:
        self._queue: queue.SimpleQueue[tuple[Payload, float] | None] = queue.SimpleQueue()
        self._start_ns = start_ns
        self._sinks = [(sink, Rim(_name_of(sink), most=1)) for sink in sinks]
        self._messages = Rim("the record of a message")
        self._derives = Rim("Foxglove's view in the record", most=1)
        self.rims = (self._messages, self._derives, *(rim for _, rim in self._sinks))
        """Of what may fail here; a sink that failed once gets no more messages."""
        self._rates_hz = dict(rates_hz or {})
        self._derive = derive
        self._due: dict[tuple[str, Any], float] = {}
        self._truth = _Tail(truth) if truth else None
        self.dropped = 0
        live = any(not isinstance(sink, McapWriter) for sink in sinks)
        self._pauses = _PAUSES_LIVE if live else _PAUSES
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    def take(self, payload: Payload, heard_s: float) -> None:
        """Record a payload heard at `heard_s`; returns at once."""
        if all(rim.off for _, rim in self._sinks) or self._queue.qsize() >= _LIMIT:
            self.dropped += 1
        else:
            self._queue.put((payload, heard_s))

    def close(self, patience_wall_s: float = 5.0) -> None:
        """Write the queue, index and footer; gives up if the disk does not answer."""
        self._queue.put(None)
        self._closing.set()
        self._thread.join(patience_wall_s)

    def _work(self) -> None:
        while self._write_chunk():
            pass
        self._to_sinks(lambda sink: sink.close())

    def _to_sinks(self, call: Callable[[Sink], None]) -> None:
        """An error in one of them ends that one alone: its file is no longer in order."""
        for sink, rim in self._sinks:
            if not rim.off:
                rim.run(call, sink)
                if rim.off:
                    with contextlib.suppress(Exception):
                        sink.abandon()

    def _write_chunk(self) -> bool:
        """Write the messages of a second and flush; False after the last one."""
        going = True
        alarm = threading.Event()
        timer = threading.Timer(_CHUNK_WALL_S, alarm.set)
        timer.daemon = True
        timer.start()
        while going and not alarm.is_set():
            if self._queue.empty():
                self._closing.wait(_CHUNK_WALL_S / self._pauses)
                continue
            item = self._queue.get()
            if item is None:
                going = False
            else:
                self._messages.run(self._record, *item)
        timer.cancel()
        self._messages.run(self._record_truth)
        self._to_sinks(lambda sink: sink.flush())
        return going

    def _record_truth(self) -> None:
        for time_s, line in self._truth.lines() if self._truth else ():
            self._write(BY_NAME["truth"], None, time_s, time_s, line)

    def _record(self, payload: Payload, heard_s: float) -> None:
        topic = BY_PAYLOAD.get(type(payload))
        if topic is None:
            self.dropped += 1
            return
        agent = getattr(payload, "agent", None)
        said_s = getattr(payload, "time_s", heard_s)
        self._write(topic, agent, heard_s, said_s, adapter(type(payload)).dump_json(payload))
        if isinstance(payload, AgentState):
            (north, east), (vn, ve, _) = payload.setpoint_mps, payload.velocity_ned_mps
            point = SetpointRecord(payload.time_s, north, east, vn, ve)
            self._write(
                BY_NAME["setpoint"],
                agent,
                heard_s,
                said_s,
                adapter(SetpointRecord).dump_json(point),
            )
        for made in self._derives.run(lambda: tuple(self._derive(payload, heard_s))) or ():
            self._give(made.topic, made.agent, made.time_s, made.time_s, made.data)

    def _write(
        self, topic: Topic, agent: int | None, time_s: float, said_s: float, data: bytes
    ) -> None:
        rate_hz = self._rates_hz.get(topic.name, 0.0)
        key = (topic.name, agent)
        if rate_hz > 0 and 0.0 < self._due.get(key, 0.0) - said_s <= 1.0 / rate_hz:
            return  # farther ahead, the one before was said by no clock that goes on
        self._due[key] = said_s + (1.0 / rate_hz - 1e-9 if rate_hz > 0 else 0.0)
        self._give(topic, agent, time_s, said_s, data)

    def _give(
        self, topic: Topic, agent: int | None, time_s: float, said_s: float, data: bytes
    ) -> None:
        heard_ns, said_ns = self._nanoseconds(time_s), self._nanoseconds(said_s)
        self._to_sinks(lambda sink: sink.write(topic, agent, heard_ns, said_ns, data))

    def _nanoseconds(self, time_s: float) -> int:
        return min(max(0, self._start_ns + round(time_s * NANO)), _LAST_NS)


_LAST_NS: Final = 2**63 - 1
"""A time that an agent says may be any; the file's have 64 bits, and many readers' a sign."""


class McapRecorder(Recorder):
    """Records into `folder`; `live`: sinks beside the file."""

    def __init__(
        self,
        folder: Path,
        start_ns: int,
        about: Mapping[str, str],
        rates_hz: Mapping[str, float] | None = None,
        derive: Derive = _nothing,
        live: Sequence[Sink] = (),
    ) -> None:
        self._writer = McapWriter(folder / RECORDING, start_ns, about)
        truth = folder / "truth.jsonl"
        super().__init__(
            start_ns, self._writer, *live, truth=truth, rates_hz=rates_hz, derive=derive
        )

    @property
    def counts(self) -> Counter[str]:
        """Messages written so far, by topic."""
        return self._writer.counts


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
