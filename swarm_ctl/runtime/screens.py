"""Where a station's views go: the dashboard, the compact view, log lines, JSON lines. Heavy ones are imported late."""

from __future__ import annotations

import contextlib
import queue
import sys
import threading
from collections.abc import Callable, Iterator
from enum import StrEnum
from typing import TYPE_CHECKING, Final, Protocol

from rich.console import Console
from rich.live import Live

from swarm_ctl.core.plan import Plan
from swarm_ctl.errors import InputError
from swarm_ctl.runtime import clock as wall
from swarm_ctl.station.json_lines import json_line
from swarm_ctl.station.live import render
from swarm_ctl.station.log_lines import log_lines
from swarm_ctl.station.orders import Order
from swarm_ctl.station.view import SwarmView

if TYPE_CHECKING:
    from swarm_ctl.runtime.metrics import Metrics
    from swarm_ctl.station.dashboard.app import Dashboard

_JSON_WALL_S: Final = 1.0


class Show(StrEnum):
    """What a station shows."""

    DASHBOARD = "dashboard"
    COMPACT = "compact"
    """One screen without keys, drawn in the terminal's own colours: for terminals that can't do more."""
    LOG = "log"
    """Plain lines: what changed."""
    JSON = "json"
    """A line a second for scripts."""


def shown(*, headless: bool, json: bool, compact: bool) -> Show:
    """What a command line's switches ask for; InputError for more than one."""
    asked = [show for show, wanted in ((Show.LOG, headless), (Show.JSON, json), (Show.COMPACT, compact)) if wanted]
    if len(asked) > 1:
        raise InputError("--headless, --json and --compact exclude each other; name one")
    return asked[0] if asked else Show.DASHBOARD


class Screen(Protocol):
    """Where a view is shown, and orders come from."""

    @property
    def left(self) -> bool:
        """The operator has closed it."""

    def show(self, view: SwarmView) -> None:
        """Show it; called a few times a second. OSError: nobody can see it any more."""

    def note(self, text: str) -> None:
        """Say something that is in no view."""

    def orders(self) -> list[Order]:
        """What was ordered since the last call."""

    def close(self) -> None:
        """Give the terminal back: whoever started us is gone. May be called again."""


class Blind:
    """No screen: the base of those that take no orders."""

    left = False

    def show(self, view: SwarmView) -> None:
        """Nobody looks."""

    def note(self, text: str) -> None:
        """Nobody listens."""

    def orders(self) -> list[Order]:
        """Nobody speaks."""
        return []

    def close(self) -> None:
        """Nothing to give back."""


class LogScreen(Blind):
    """Plain lines on stdout, for pipes and CI: what changed since the last view."""

    def __init__(self) -> None:
        self._last: SwarmView | None = None

    def show(self, view: SwarmView) -> None:
        """Print what is new."""
        for line in log_lines(self._last, view):
            sys.stdout.write(line + "\n")
        sys.stdout.flush()
        self._last = view

    def note(self, text: str) -> None:
        """Print it."""
        sys.stdout.write(text + "\n")


class JsonScreen(Blind):
    """One JSON object a line and second of the wall clock, and one when all is over."""

    def __init__(self) -> None:
        self._due = 0.0
        self._unsaid: SwarmView | None = None

    def show(self, view: SwarmView) -> None:
        """Print it, if it is time."""
        self._unsaid = view
        if wall.wall_s() >= self._due:
            self._due = wall.wall_s() + _JSON_WALL_S
            self.finish()

    def finish(self) -> None:
        """Print the last view, unless it is printed already."""
        if self._unsaid is not None:
            sys.stdout.write(json_line(self._unsaid) + "\n")
            sys.stdout.flush()
            self._unsaid = None


class CompactScreen(Blind):
    """The compact live view."""

    def __init__(self, live: Live, console: Console) -> None:
        self._live = live
        self._console = console

    def show(self, view: SwarmView) -> None:
        """Redraw."""
        self._live.update(render(view, self._console.width, self._console.height), refresh=True)


class MeasuredScreen:
    """Another screen, and every view of it for Prometheus too."""

    def __init__(self, screen: Screen, metrics: Metrics) -> None:
        self._screen = screen
        self._metrics = metrics
        self.note, self.orders, self.close = screen.note, screen.orders, screen.close

    @property
    def left(self) -> bool:
        """As `Screen.left`."""
        return self._screen.left

    def show(self, view: SwarmView) -> None:
        """Show it; what can be scraped is as new."""
        self._metrics.view = view
        self._screen.show(view)


@contextlib.contextmanager
def metrics_on(port: int | None) -> Iterator[Callable[[Screen], Screen]]:
    """What puts metrics beside a screen; nothing does where no port was asked for."""
    if port is None:
        yield lambda screen: screen
        return
    from swarm_ctl.runtime.metrics import Metrics

    with Metrics(port) as metrics:
        yield lambda screen: MeasuredScreen(screen, metrics)


class DashboardScreen:
    """The station's side of the dashboard, which runs on the main thread. Views go over by `offer`: the newest wins."""

    def __init__(self, plan: Plan, interrupt: Callable[[], None] | None) -> None:
        from swarm_ctl.station.dashboard.app import Dashboard
        from swarm_ctl.station.dashboard.terminal import TtyDriver

        self._orders: queue.SimpleQueue[Order] = queue.SimpleQueue()
        self.app: Dashboard = Dashboard(plan, self._orders.put, interrupt, driver_class=TtyDriver)
        self.left = False

    def show(self, view: SwarmView) -> None:
        """Hand it over; never waits."""
        self.app.offer(view)

    def note(self, text: str) -> None:
        """Into the log and onto the line above the keys."""
        self.app.tell(text)

    def orders(self) -> list[Order]:
        """Take what was typed."""
        taken = []
        while not self._orders.empty():
            taken.append(self._orders.get())
        return taken

    def close(self) -> None:
        """As `Screen.close`."""
        self.app.leave()


def present(show: Show, plan: Plan, interrupt: Callable[[], None] | None, watch: Callable[[Screen], None]) -> None:
    """Run `watch` with the screen asked for, or with the best that this terminal can do; returns when `watch` does."""
    console = Console()
    show = possible(show, console)
    match show:
        case Show.DASHBOARD:
            _with_dashboard(DashboardScreen(plan, interrupt), watch)
        case Show.COMPACT:
            with Live(console=console, auto_refresh=False, vertical_overflow="crop", redirect_stderr=False) as live:
                watch(CompactScreen(live, console))
        case Show.LOG:
            watch(LogScreen())
        case Show.JSON:
            screen = JsonScreen()
            watch(screen)
            screen.finish()


def possible(show: Show, console: Console) -> Show:
    """What was asked for, or the best that this terminal can do instead."""
    if show is Show.DASHBOARD and not _can_show_dashboard(console):
        show = Show.COMPACT
    if show is Show.COMPACT and not console.is_terminal:
        show = Show.LOG
    return show


def _can_show_dashboard(console: Console) -> bool:
    if not console.is_terminal or console.is_dumb_terminal or "utf" not in console.encoding.lower():
        return False
    from swarm_ctl.station.dashboard.terminal import in_front

    return in_front()


def _with_dashboard(screen: DashboardScreen, watch: Callable[[Screen], None]) -> None:
    """The application wants the main thread (signals), so the station works on another: a terminal that blocks stops
    the pictures and nothing else.
    """
    failed: list[BaseException] = []

    def work() -> None:
        try:
            watch(screen)
        except BaseException as error:
            failed.append(error)
        finally:
            screen.close()

    worker = threading.Thread(target=work, name="station")
    worker.start()
    try:
        screen.app.run()
    finally:
        screen.left = True
        worker.join()
    if failed:
        raise failed[0]
