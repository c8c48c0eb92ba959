"""A vehicle's `.tlog`: each MAVLink frame, both ways, behind eight bytes of time, as log tools read
it.

Written by an agent, so nothing here may hold up a control loop: `take` only appends to a list in
memory, a thread takes that to the disk once a second. A disk that does not keep up costs the oldest
frames, which are counted.
"""

from __future__ import annotations

import struct
import threading
from collections import deque
from pathlib import Path
from typing import Final

from swarm_ctl.rim import explained

_TIME: Final = struct.Struct(">Q")
"""Microseconds of Unix time, big-endian."""
_LIMIT: Final = 100_000
"""Frames that may wait: ten minutes of a vehicle's stream."""
_TURN_WALL_S: Final = 1.0


class TlogWriter:
    """Writes the frames of one link to `path`; mission time 0 is `started_us` microseconds of Unix
    time."""

    def __init__(self, path: Path, started_us: int) -> None:
        self._file = path.open("ab", buffering=0)
        self._started_us = started_us
        self._waiting: deque[tuple[float, bytes]] = deque(maxlen=_LIMIT)
        self._taken = self._written = 0
        self._end = threading.Event()
        self.failure = ""
        """Why nothing is written any more (a full disk, above all)."""
        self._thread = threading.Thread(target=self._work, name="tlog", daemon=True)
        self._thread.start()

    def take(self, frame: bytes, now: float) -> None:
        """Keep a frame that passed at mission time `now`; never waits."""
        self._waiting.append((now, frame))
        self._taken += 1

    @property
    def dropped(self) -> int:
        """Frames that were not written because the disk was too slow."""
        return self._taken - self._written - len(self._waiting)

    def close(self, patience_wall_s: float = 2.0) -> None:
        """Write what waits; a disk that does not answer is given up."""
        self._end.set()
        self._thread.join(patience_wall_s)
        if not self._thread.is_alive():
            self._file.close()

    def _work(self) -> None:
        try:
            while not self._end.wait(_TURN_WALL_S):
                self._write_waiting()
            self._write_waiting()
        except Exception as error:
            self.failure = explained(error)

    def _write_waiting(self) -> None:
        count = len(self._waiting)
        frames = [self._waiting.popleft() for _ in range(count)]
        stamped = (_TIME.pack(self._started_us + round(now * 1e6)) + frame for now, frame in frames)
        data = memoryview(b"".join(stamped))
        while data:
            data = data[self._file.write(data) :]
        self._written += count
