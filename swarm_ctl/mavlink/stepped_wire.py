"""A vehicle's wire in lockstep: each tick reads exactly the datagrams that the simulator has sent
up to it."""

from __future__ import annotations

from collections import deque

from swarm_ctl.mavlink.wires import Wire


class SteppedWire(Wire):
    """Wraps a wire that keeps chunks apart and loses none (UDP on the loopback)."""

    def __init__(self, inner: Wire) -> None:
        self._inner = inner
        self.warning = inner.warning
        self.port = inner.port
        self._waiting: deque[bytes] = deque()
        self._due = self._come = 0
        self._free = False
        self._written = 0

    def expect(self, count: int) -> None:
        """So many more chunks belong to this tick."""
        self._due += count

    def lacks(self, now: float) -> bool:
        """Take in what has come; True while chunks that are expected have not."""
        while self._come < self._due:
            chunk = self._pending(now)
            if chunk is None:
                return True
            self._waiting.append(chunk)
            self._come += 1
        return False

    def give_up(self) -> None:
        """What has not come never will."""
        self._come = self._due

    def restart(self, now: float) -> None:
        """Take in all that waits, and count from here."""
        while (chunk := self._pending(now)) is not None:
            self._waiting.append(chunk)
        self._due = self._come = 0

    def let_run(self) -> None:
        """From now on as without lockstep."""
        self._free = True

    def _pending(self, now: float) -> bytes | None:
        try:
            return self._inner.read(now)
        except OSError:  # an earlier write found no vehicle
            return None

    def read(self, now: float) -> bytes | None:
        if self._waiting:
            return self._waiting.popleft()
        return self._inner.read(now) if self._free else None

    def write(self, data: bytes, now: float, system: int = 0) -> None:
        self._inner.write(data, now, system)
        self._written += 1

    def written(self) -> int:
        """Chunks since the last call."""
        written, self._written = self._written, 0
        return written

    def confirm(self, system: int = 0, *, proven: bool = False) -> None:
        self._inner.confirm(system, proven=proven)

    def close(self) -> None:
        self._inner.close()
