"""Ctrl-C as a count: it does not end the process."""

from __future__ import annotations

import signal
from typing import Self


class Interrupts:
    """Counts SIGINT, SIGTERM and SIGHUP while it is entered."""

    def __init__(self) -> None:
        self.count = 0

    def __enter__(self) -> Self:
        self._before = {
            number: signal.signal(number, self._take)
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        }
        return self

    def _take(self, *_: object) -> None:
        self.count += 1

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
