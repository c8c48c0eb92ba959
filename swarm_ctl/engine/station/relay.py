"""Views on their way to a terminal or a pipe that may block (Ctrl-S, a full pipe): a thread of its
own writes them.

The station hands the newest view over and goes on; a slow reader misses views and delays no other
part. A write that never returns ends with the process.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from dataclasses import replace
from typing import Final

from swarm_ctl.commands.parse import Order
from swarm_ctl.engine.station.printers import Printer, write
from swarm_ctl.rim import Rim
from swarm_ctl.station.picture.view import SwarmView

_NOTES: Final = 100
_END_WALL_S: Final = 2.0
"""How long the end waits for the last lines to be read."""


class StationRelay:
    """A `Screen` before a printer. Notes wait in a queue, of views only the newest one."""

    def __init__(self, printer: Printer, descriptor: int) -> None:
        self.left = False
        self._printer = printer
        self._descriptor = os.dup(descriptor)
        """The thread's own: it may still write when the other one is closed and its number is
        another file's."""
        self._wake = threading.Condition()
        self._view: SwarmView | None = None
        self._notes: deque[str] = deque()
        self._dropped = 0
        """Views and notes that were never written."""
        self._over = False
        self._rim = Rim("the lines of this output")
        self._thread = threading.Thread(target=self._work, name="screen", daemon=True)
        self._thread.start()

    def show(self, view: SwarmView) -> None:
        """Hand it over; never waits."""
        with self._wake:
            self._dropped += self._view is not None
            self._view = replace(view, health=replace(view.health, frames_dropped=self._dropped))
            self._wake.notify()

    def note(self, text: str) -> None:
        """Hand it over; the oldest notes go when the output is blocked."""
        with self._wake:
            if len(self._notes) == _NOTES:
                self._notes.popleft()
                self._dropped += 1
            self._notes.append(text)
            self._wake.notify()

    def orders(self) -> list[Order]:
        return []

    def close(self) -> None:
        pass

    def finish(self) -> None:
        """No more views: wait a little until all is written."""
        with self._wake:
            self._over = True
            self._wake.notify()
        self._thread.join(_END_WALL_S)

    def _work(self) -> None:
        try:
            while self._write_next():
                pass
            write(self._descriptor, self._rim.run(self._printer.end) or [])
        except OSError:
            self.left = True  # the reader has gone: this ends a guest, but not a run's station
        finally:
            os.close(self._descriptor)

    def _write_next(self) -> bool:
        with self._wake:
            self._wake.wait_for(lambda: self._view is not None or self._notes or self._over)
            view, self._view = self._view, None
            notes, over = list(self._notes), self._over
            self._notes.clear()
        for note in notes:
            write(self._descriptor, self._rim.run(self._printer.note, note) or [])
        if view is not None:
            write(self._descriptor, self._rim.run(self._printer.lines, view) or [])
        for trouble in self._rim.troubles():
            write(self._descriptor, self._rim.run(self._printer.note, str(trouble)) or [])
        return not over
