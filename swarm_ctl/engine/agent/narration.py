"""What an agent that was started alone tells its terminal: what it waits for, and what happens."""

from __future__ import annotations

import contextlib
import math
import os
import select
from collections.abc import Callable, Iterable
from typing import Final

from swarm_ctl.core.model.messages import AgentStatus, Event, Phase, Severity
from swarm_ctl.core.model.text import printable

_STDERR: Final = 2
_AGAIN_S: Final = 5.0
"""While it waits for the same thing."""
_WAITS: Final = frozenset({Phase.CONNECT, Phase.PREPARE, Phase.ARM})


def show_on_terminal(line: str) -> None:
    """On standard error, where there is room now: a terminal that is held up (Ctrl-S), or a pipe
    that nobody reads, must not hold up a control loop, and a closed one must not end it."""
    ready = select.poll()
    ready.register(_STDERR, select.POLLOUT)
    if ready.poll(0):
        with contextlib.suppress(OSError):
            os.write(_STDERR, f"agent: {line}\n".encode("ascii", "replace"))


class Narration:
    """`show` gets each line."""

    def __init__(self, show: Callable[[str], None]) -> None:
        self._show = show
        self._why = ""
        self._due_s = -math.inf

    def tell(self, events: Iterable[Event], status: AgentStatus | None) -> None:
        """What is new in a tick."""
        for event in events:
            mark = "" if event.level is Severity.INFO else f"{event.level.upper()}: "
            self._show(f"[{event.time_s:7.1f} s] {mark}{printable(event.text)}")
        if status is None or status.phase not in _WAITS or not status.reason:
            return
        if status.reason != self._why or status.time_s >= self._due_s:
            self._why, self._due_s = status.reason, status.time_s + _AGAIN_S
            self._show(f"[{status.time_s:7.1f} s] waits: {printable(status.reason)}")
