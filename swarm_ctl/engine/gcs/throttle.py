"""Limits how fast frames go on: a token bucket with a short queue. Pure."""

from __future__ import annotations

from collections import deque


class Throttle:
    """Lets `rate_hz` frames a second through, `burst` of them at once; as many may wait. Where more
    come, the oldest are dropped."""

    def __init__(self, rate_hz: float, burst: int) -> None:
        self._rate_hz = rate_hz
        self._burst = burst
        self._tokens = float(burst)
        self._at_s: float | None = None
        self._queue: deque[bytes] = deque(maxlen=burst)
        self.dropped = 0

    def put(self, frame: bytes) -> None:
        """Queue a frame."""
        self.dropped += len(self._queue) == self._burst
        self._queue.append(frame)

    def take(self, now: float) -> list[bytes]:
        """The frames that may go now, oldest first."""
        since_s = 0.0 if self._at_s is None else max(0.0, now - self._at_s)
        self._at_s = now
        self._tokens = min(float(self._burst), self._tokens + since_s * self._rate_hz)
        count = min(int(self._tokens), len(self._queue))
        self._tokens -= count
        return [self._queue.popleft() for _ in range(count)]
