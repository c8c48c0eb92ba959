"""Where a station's views go: the dashboard (imported late), log lines, JSON lines."""

from __future__ import annotations

import contextlib
import os
import queue
import select
import sys
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from enum import StrEnum
from typing import TYPE_CHECKING, Final, Protocol

from swarm_ctl.commands.parse import Order
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.engine.station.printers import JsonPrinter, LogPrinter, Printer, write
from swarm_ctl.errors import InputError
from swarm_ctl.rim import Rim, explained
from swarm_ctl.signals import ended_by
from swarm_ctl.station.picture.view import SwarmView

if TYPE_CHECKING:
    from swarm_ctl.station.dashboard.app import Dashboard


_TTY: Final = "/dev/tty"
_WEB_DRIVER: Final = "textual.drivers.web_driver:WebDriver"
_NO_DASHBOARD: Final = (
    "the dashboard ended by an error; the station goes on: log lines from now on, commands by"
    " `swarm-ctl send` or `swarm-ctl station` in another terminal"
)


class Show(StrEnum):
    """What a station shows."""

    DASHBOARD = "dashboard"
    LOG = "log"
    """Plain lines: what changed."""
    JSON = "json"
    """A line a second for scripts."""


def shown(*, headless: bool, json: bool) -> Show:
    """What a command line's switches ask for; InputError for both."""
    if headless and json:
        raise InputError("--headless and --json exclude each other; name one")
    return Show.LOG if headless else Show.JSON if json else Show.DASHBOARD


def possible(show: Show) -> Show:
    """What was asked for, or log lines where this terminal can't show the dashboard."""
    return Show.LOG if show is Show.DASHBOARD and not _can_show_dashboard() else show


def in_browser() -> bool:
    """This process was started for a visitor of `served_dashboard`: its stdout is a browser's."""
    return os.environ.get("TEXTUAL_DRIVER") == _WEB_DRIVER


def _can_show_dashboard() -> bool:
    if in_browser():
        return True
    dumb = os.environ.get("TERM", "").lower() in ("dumb", "unknown")
    if dumb or "utf" not in (sys.stdout.encoding or "").lower():
        return False
    return _in_front()


def _in_front() -> bool:
    """Whether there is a terminal that shows our stdout and would give us its keys now."""
    if not sys.stdout.isatty() or sys.platform == "win32":
        return sys.stdout.isatty()
    try:
        descriptor = os.open(_TTY, os.O_RDWR | os.O_NOCTTY)
    except OSError:
        return False
    try:
        return os.tcgetpgrp(descriptor) == os.getpgrp()
    except OSError:
        return False
    finally:
        os.close(descriptor)


class Screen(Protocol):
    """Where a view is shown, and orders come from."""

    @property
    def left(self) -> bool:
        """The operator has closed it."""

    def show(self, view: SwarmView) -> None:
        """Show it; called a few times a second, never waits."""

    def note(self, text: str) -> None:
        """Say something that is in no view."""

    def orders(self) -> list[Order]:
        """The orders since the last call."""

    def close(self) -> None:
        """Give the terminal back, because `run` has gone. May be called again."""


def present(
    show: Show,
    plan: Plan,
    interrupt: Callable[[], None] | None,
    watch: Callable[[Screen], None],
    out: int = 1,
) -> None:
    """Run `watch` with the screen asked for, or with the best that this terminal can do; returns
    when `watch` does.

    Args:
        show: what is asked for.
        plan: what the swarm flies.
        interrupt: called at Ctrl-C, where the dashboard gets that as a key; None: it only leaves.
        watch: the station's loop.
        out: the descriptor for lines.
    """
    show = possible(show)
    if show is Show.DASHBOARD:
        screen = DashboardScreen(plan, interrupt, out)
        with ended_by(screen.close) if interrupt is None else contextlib.nullcontext():
            _with_dashboard(screen, watch)
        return
    relay = StationRelay(LogPrinter() if show is Show.LOG else JsonPrinter(), out)
    try:
        watch(relay)
    finally:
        relay.finish()


class DashboardScreen:
    """The station's side of the dashboard, which runs on the main thread. When the dashboard ends
    by an error, log lines take its place."""

    def __init__(self, plan: Plan, interrupt: Callable[[], None] | None, out: int = 1) -> None:
        from swarm_ctl.station.dashboard.app import Dashboard
        from swarm_ctl.station.dashboard.driver import TtyDriver

        self._orders: queue.SimpleQueue[Order] = queue.SimpleQueue()
        driver = None if in_browser() else TtyDriver  # None: the one that the environment names
        self.app: Dashboard = Dashboard(plan, self._orders.put, interrupt, driver_class=driver)
        self._left = False
        self._out = out
        self._lines: StationRelay | None = None

    @property
    def left(self) -> bool:
        """The operator has closed it, or the reader of the lines that took its place has gone."""
        lines = self._lines
        return self._left or (lines is not None and (lines.left or _gone(self._out)))

    def show(self, view: SwarmView) -> None:
        """Show it; never waits."""
        (self._lines.show if self._lines is not None else self.app.offer)(view)

    def note(self, text: str) -> None:
        """Say something that is in no view."""
        (self._lines.note if self._lines is not None else self.app.tell)(text)

    def orders(self) -> list[Order]:
        """The orders since the last call."""
        return [self._orders.get() for _ in range(self._orders.qsize())]

    def close(self) -> None:
        """Give the terminal back."""
        self.app.leave()

    def run(self, watched: threading.Event) -> None:
        """The dashboard until it is left; log lines from then on, if an error ended it, until
        `watched` is set."""
        why = ""
        try:
            self.app.run()
        except Exception as error:
            why = explained(error)
        why = why or self.app.failure
        if why or self.app.return_code:
            lines = StationRelay(LogPrinter(), self._out)
            lines.note(f"{_NO_DASHBOARD}{f' ({why})' if why else ''}")
            self._lines = lines
            watched.wait()
            lines.finish()

    def leave(self) -> None:
        """No one looks any more."""
        self._left = True


def _gone(out: int) -> bool:
    """The terminal was closed, or no one reads the pipe: a log with nothing to say would not find
    that out by writing."""
    if sys.platform == "win32":
        return False
    poll = select.poll()
    poll.register(out, 0)
    return bool(poll.poll(0))


def _with_dashboard(screen: DashboardScreen, watch: Callable[[Screen], None]) -> None:
    """The application wants the main thread (signals), so the station works on another: a terminal
    that blocks, or an error in a widget, stops the pictures and nothing else.
    """
    failed: list[BaseException] = []
    watched = threading.Event()

    def work() -> None:
        try:
            watch(screen)
        except BaseException as error:
            failed.append(error)
        finally:
            watched.set()
            screen.close()

    worker = threading.Thread(target=work, name="station")
    worker.start()
    try:
        screen.run(watched)
    finally:
        screen.leave()
        worker.join()
    if failed:
        raise failed[0]


_NOTES: Final = 100
_END_WALL_S: Final = 2.0
"""How long the end waits for the last lines to be read."""


class StationRelay:
    """A `Screen` before a printer that may block (Ctrl-S, a full pipe): a thread of its own writes.

    The station hands the newest view over and goes on; a slow reader misses views and delays no
    other part. Notes wait in a queue. A write that never returns ends with the process.
    """

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
