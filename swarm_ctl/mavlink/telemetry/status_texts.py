"""A vehicle's STATUSTEXTs between two snapshots: joined from chunks, printable, bounded."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

MAX_TEXTS = 32
CHUNK = 50
"""Characters in a STATUSTEXT; a shorter chunk is the last one."""
MAX_CHUNKS = 8
COMPLETE_S = 1.0
"""A text whose last chunk has not come after this time is passed on without it."""


@dataclass(slots=True)
class StatusTexts:
    """The newest `MAX_TEXTS` texts, and at most one incomplete text."""

    _done: deque[str] = field(default_factory=lambda: deque(maxlen=MAX_TEXTS))
    _chunks: list[str] = field(default_factory=list)
    _number: int = 0
    _heard_s: float = 0.0

    def add(self, text: str) -> None:
        """Store a whole text."""
        self._done.append(_printable(text))

    def add_chunk(self, text: str, number: int, now: float) -> None:
        """Store a chunk of the long text `number` (> 0)."""
        if self._chunks and self._number != number:
            self._finish()
        self._number, self._heard_s = number, now
        self._chunks.append(text)
        if len(text) < CHUNK or len(self._chunks) >= MAX_CHUNKS:
            self._finish()

    def take(self, now: float) -> tuple[str, ...]:
        """The texts since the last call."""
        if self._chunks and now - self._heard_s > COMPLETE_S:
            self._finish()
        taken = tuple(self._done)
        self._done.clear()
        return taken

    def _finish(self) -> None:
        self.add("".join(self._chunks))
        self._chunks.clear()


def _printable(text: str) -> str:
    """Control characters could change an operator's terminal."""
    return "".join(c if c.isprintable() else "?" for c in text)
