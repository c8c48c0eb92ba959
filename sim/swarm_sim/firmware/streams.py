"""Which message is due when. Pure; times are mission seconds."""

from __future__ import annotations

import math
from collections.abc import Sequence


class Streams:
    """Message intervals of one vehicle, and when each is due next.

    After its first message a stream keeps to whole multiples of its interval, so that streams meet
    and share packets; one that fell behind goes on at the next multiple instead of sending a burst.
    """

    def __init__(self) -> None:
        self.interval_s: dict[str, float] = {}
        self._due_s: dict[str, float] = {}
        self.next_s = math.inf
        """When the next message is due."""

    def set(self, name: str, interval_s: float | None, now: float) -> None:
        """Streams `name` every `interval_s`, the first at once; None stops it."""
        if interval_s is None:
            self.interval_s.pop(name, None)
            self._due_s.pop(name, None)
        else:
            self.interval_s[name] = interval_s
            self._due_s[name] = now
        self.next_s = min(self._due_s.values(), default=math.inf)

    def take_due(self, now: float) -> Sequence[str]:
        """The names that are due at `now`, each once; moves them on."""
        late = now + _SLACK_S
        if late < self.next_s:
            return ()
        due = [name for name, at in self._due_s.items() if at <= late]
        for name in due:
            self._due_s[name] = next_on_grid(now, self.interval_s[name])
        self.next_s = min(self._due_s.values(), default=math.inf)
        return due


def next_on_grid(now: float, interval_s: float) -> float:
    """The first whole multiple of the interval after `now`."""
    return (math.floor(now / interval_s + _SLACK_S) + 1) * interval_s


_SLACK_S = 1e-6
"""Times are sums of steps: what is due within a microsecond is due."""
