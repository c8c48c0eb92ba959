"""Views as lines of text, for pipes and CI."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Iterable
from typing import Final, Protocol

from swarm_ctl.core.model.text import escaped
from swarm_ctl.engine import clock as wall
from swarm_ctl.station.output.json_lines import json_line
from swarm_ctl.station.output.log_lines import log_lines
from swarm_ctl.station.picture.view import SwarmView

_JSON_WALL_S: Final = 1.0
_TOLD_VIEWS: Final = 4
"""So many skipped views are a second in which the output was blocked."""


class Printer(Protocol):
    """Makes lines of views and notes."""

    def lines(self, view: SwarmView) -> list[str]:
        """Of a newer view; `health.frames_dropped` says how many views this output has missed."""

    def note(self, text: str) -> list[str]:
        """Of something that is in no view."""

    def end(self) -> list[str]:
        """The last lines."""


class LogPrinter:
    """Plain lines: what has changed since the last view."""

    def __init__(self) -> None:
        self._last: SwarmView | None = None

    def lines(self, view: SwarmView) -> list[str]:
        last, self._last = self._last, view  # first: a view that can't be told is not told again
        lines = log_lines(last, view)
        before = last.health.frames_dropped if last else 0
        missed = view.health.frames_dropped - before
        if missed >= _TOLD_VIEWS:
            words = f"station: this output was blocked; {missed} views were skipped"
            lines.insert(0, f"[{view.time_s:7.1f} s] {words}")
        return lines

    def note(self, text: str) -> list[str]:
        return [text]

    def end(self) -> list[str]:
        return []


class JsonPrinter:
    """A JSON object a line: one a second of the wall clock, one once all agents are heard, one at
    the end."""

    def __init__(self) -> None:
        self._due = 0.0
        self._whole = False
        self._waiting: SwarmView | None = None

    def lines(self, view: SwarmView) -> list[str]:
        self._waiting = view
        whole = all(agent.state and agent.status for agent in view.agents if agent.in_plan)
        if wall.wall_s() < self._due and (self._whole or not whole):
            return []
        self._due = wall.wall_s() + _JSON_WALL_S
        self._whole |= whole
        return self.end()

    def note(self, text: str) -> list[str]:  # noqa: ARG002
        return []

    def end(self) -> list[str]:
        """The last view, if it is not written yet."""
        view, self._waiting = self._waiting, None
        return [json_line(view)] if view is not None else []


def write(descriptor: int, lines: Iterable[str]) -> None:
    """Write whole lines straight to a descriptor, however long it blocks: without a buffer there is
    no lock that a blocked thread could keep. What agents and stations say can't command a terminal.
    """
    text = "".join(escaped(line) + "\n" for line in lines)
    data = text.encode(sys.stdout.encoding or "utf-8", "replace")
    while data:
        try:
            data = data[os.write(descriptor, data) :]
        except BlockingIOError:
            select.select((), (descriptor,), ())
