"""Views on their way to a terminal or a pipe that may block (Ctrl-S, a full pipe): a thread of
their own writes them.

The station hands the newest view over and goes on; whoever reads slowly misses views and slows
nobody down. A write that never returns ends with the process.
"""

from __future__ import annotations

import io
import os
import select
import sys
import threading
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Final, Protocol

from swarm_ctl.commands.parse import Order
from swarm_ctl.station.picture.view import SwarmView

_NOTES: Final = 100
_END_WALL_S: Final = 2.0
"""How long the end waits for somebody to read the last words."""


class Printer(Protocol):
    """What writes views; runs on the relay's thread and may block."""

    def draw(self, view: SwarmView) -> None:
        """A newer view; `health.frames_dropped` says how many this output has missed. OSError:
        nobody reads."""

    def say(self, text: str) -> None:
        """Something that is in no view."""

    def end(self) -> None:
        """No more views will come."""


class Descriptor(io.TextIOBase):
    """Text straight to a file descriptor: without a buffer there is no lock that a blocked thread
    could keep."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._encoding = sys.stdout.encoding or "utf-8"

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """That of stdout."""
        return self._encoding

    def fileno(self) -> int:
        """The descriptor."""
        return self._descriptor

    def isatty(self) -> bool:
        """It is a terminal."""
        return os.isatty(self._descriptor)

    def writable(self) -> bool:
        """Always."""
        return True

    def write(self, text: str) -> int:
        """All of it; waits for as long as nobody reads."""
        data = text.encode(self.encoding, "replace")
        while data:
            try:
                data = data[os.write(self._descriptor, data) :]
            except BlockingIOError:
                select.select((), (self._descriptor,), ())
        return len(text)


class Relay:
    """A `Screen` before a printer. Notes wait in a queue, of views only the newest one."""

    def __init__(self, opened: Callable[[], AbstractContextManager[Printer]]) -> None:
        self.left = False
        self.dropped = 0
        """Views and notes that were never written."""
        self._opened = opened
        self._wake = threading.Condition()
        self._view: SwarmView | None = None
        self._notes: deque[str] = deque()
        self._over = False
        self._failed: Exception | None = None
        self._thread = threading.Thread(target=self._work, name="screen", daemon=True)
        self._thread.start()

    def show(self, view: SwarmView) -> None:
        """Hand it over; never waits. Raises what went wrong with a view before."""
        if self._failed is not None:
            raise self._failed
        with self._wake:
            self.dropped += self._view is not None
            self._view = replace(view, health=replace(view.health, frames_dropped=self.dropped))
            self._wake.notify()

    def note(self, text: str) -> None:
        """Hand it over; the oldest ones go when nobody reads."""
        with self._wake:
            if len(self._notes) == _NOTES:
                self._notes.popleft()
                self.dropped += 1
            self._notes.append(text)
            self._wake.notify()

    def orders(self) -> list[Order]:
        """None: these screens have no keys."""
        return []

    def close(self) -> None:
        """There is no terminal to give back."""

    def finish(self) -> None:
        """No more views: wait a little until all is written."""
        with self._wake:
            self._over = True
            self._wake.notify()
        self._thread.join(_END_WALL_S)

    def _work(self) -> None:
        try:
            with self._opened() as printer:
                while self._write(printer):
                    pass
                printer.end()
        except OSError:
            self.left = True  # nobody reads any more: a watching station may go, a run's station goes on without
        except Exception as error:
            self._failed = error

    def _write(self, printer: Printer) -> bool:
        with self._wake:
            self._wake.wait_for(lambda: self._view is not None or self._notes or self._over)
            view, self._view = self._view, None
            notes, over = list(self._notes), self._over
            self._notes.clear()
        for note in notes:
            printer.say(note)
        if view is not None:
            printer.draw(view)
        return not over
