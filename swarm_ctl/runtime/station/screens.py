"""Where a station's views go: the dashboard (imported late), log lines, JSON lines."""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Callable, Iterator
from enum import StrEnum
from typing import TYPE_CHECKING, Final, Protocol, TextIO, cast

from rich.console import Console

from swarm_ctl.commands.parse import Order
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.errors import InputError
from swarm_ctl.runtime import clock as wall
from swarm_ctl.runtime.station.relay import Descriptor, Printer, Relay
from swarm_ctl.station.output.json_lines import json_line
from swarm_ctl.station.output.log_lines import log_lines
from swarm_ctl.station.picture.view import SwarmView

if TYPE_CHECKING:
    from swarm_ctl.runtime.station.prometheus import Metrics
    from swarm_ctl.station.dashboard.app import Dashboard

_JSON_WALL_S: Final = 1.0
_TOLD_VIEWS: Final = 4
"""So many skipped views are a second in which nobody read."""


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
        """What was ordered since the last call."""

    def close(self) -> None:
        """Give the terminal back: whoever started us is gone. May be called again."""


class LogPrinter:
    """Plain lines, for pipes and CI: what changed since the last view that was written."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._last: SwarmView | None = None

    def draw(self, view: SwarmView) -> None:
        """Write what is new."""
        lines = log_lines(self._last, view)
        missed = view.health.frames_dropped - (
            self._last.health.frames_dropped if self._last else 0
        )
        if missed >= _TOLD_VIEWS:
            words = f"station: this output was blocked; {missed} views were skipped"
            lines.insert(0, f"[{view.time_s:7.1f} s] {words}")
        self._last = view
        self._out.write("".join(line + "\n" for line in lines))

    def say(self, text: str) -> None:
        """Write it."""
        self._out.write(text + "\n")

    def end(self) -> None:
        """All is written."""


class JsonPrinter:
    """One JSON object a line and second of the wall clock; one once all agents were heard, one when
    all is over."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._due = 0.0
        self._whole = False
        self._open: SwarmView | None = None

    def draw(self, view: SwarmView) -> None:
        """Write it, if it is time."""
        self._open = view
        whole = all(
            agent.state is not None and agent.status is not None
            for agent in view.agents
            if agent.in_plan
        )
        if wall.wall_s() >= self._due or (whole and not self._whole):
            self._due = wall.wall_s() + _JSON_WALL_S
            self._whole |= whole
            self.end()

    def say(self, text: str) -> None:
        """Lines are for views alone."""

    def end(self) -> None:
        """The last view, if it is not written yet."""
        if self._open is not None:
            self._out.write(json_line(self._open) + "\n")
            self._open = None


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
    from swarm_ctl.runtime.station.prometheus import Metrics

    with Metrics(port) as metrics:
        yield lambda screen: MeasuredScreen(screen, metrics)


class DashboardScreen:
    """The station's side of the dashboard, which runs on the main thread. Views go over by `offer`:
    the newest wins."""

    def __init__(self, plan: Plan, interrupt: Callable[[], None] | None) -> None:
        from swarm_ctl.station.dashboard.app import Dashboard
        from swarm_ctl.station.dashboard.driver import TtyDriver

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


def present(
    show: Show,
    plan: Plan,
    interrupt: Callable[[], None] | None,
    watch: Callable[[Screen], None],
    out: int = 1,
) -> None:
    """Run `watch` with the screen asked for, or with the best that this terminal can do; returns
    when `watch` does.

    All but the dashboard write to the descriptor `out`.
    """
    file = Descriptor(out)
    console = Console(file=cast("TextIO", file))
    show = possible(show, console)
    match show:
        case Show.DASHBOARD:
            _with_dashboard(DashboardScreen(plan, interrupt), watch)
        case Show.LOG:
            _relayed(lambda: contextlib.nullcontext(LogPrinter(cast("TextIO", file))), watch)
        case Show.JSON:
            _relayed(lambda: contextlib.nullcontext(JsonPrinter(cast("TextIO", file))), watch)


def _relayed(
    opened: Callable[[], contextlib.AbstractContextManager[Printer]],
    watch: Callable[[Screen], None],
) -> None:
    relay = Relay(opened)
    try:
        watch(relay)
    finally:
        relay.finish()


def possible(show: Show, console: Console) -> Show:
    """What was asked for, or the best that this terminal can do instead."""
    return Show.LOG if show is Show.DASHBOARD and not _can_show_dashboard(console) else show


def _can_show_dashboard(console: Console) -> bool:
    if not console.is_terminal or console.is_dumb_terminal or "utf" not in console.encoding.lower():
        return False
    from swarm_ctl.station.dashboard.driver import in_front

    return in_front()


def _with_dashboard(screen: DashboardScreen, watch: Callable[[Screen], None]) -> None:
    """The application wants the main thread (signals), so the station works on another: a terminal
    that blocks stops the pictures and nothing else.
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
