"""The mission clock. The only module of swarm_ctl that reads the system's clock or sleeps."""

from __future__ import annotations

import time
from datetime import datetime
from typing import Final


class Clock:
    """Mission time [s]: from 0 at `epoch_s`, `speedup` times as fast as the wall clock.

    Processes on one host are given the same `epoch_s` (of the monotonic clock), so their times
    compare directly.
    """

    stepped = False
    """It goes by a pace."""

    def __init__(self, epoch_s: float, speedup: float = 1.0) -> None:
        self.epoch_s = epoch_s
        self.speedup: Final = speedup

    @classmethod
    def starting_now(cls, speedup: float = 1.0) -> Clock:
        """A clock whose time is 0 now."""
        return cls(time.monotonic(), speedup)

    def now(self) -> float:
        """Mission time [s]."""
        return (time.monotonic() - self.epoch_s) * self.speedup

    def sleep_until(self, mission_s: float) -> None:
        """Sleep to the mission time `mission_s`; at once when it is past."""
        left = self.epoch_s + mission_s / self.speedup - time.monotonic()
        if left > 0:
            time.sleep(left)


def wall_s() -> float:
    """Seconds on the monotonic clock, for what a person waits for."""
    return time.monotonic()


def cpu_s() -> float:
    """What this process has computed so far [s]."""
    return time.process_time()


def pause(wall_seconds: float) -> None:
    """Sleep on the wall clock."""
    time.sleep(wall_seconds)


def date_and_time(ago_s: float = 0.0) -> datetime:
    """Local date and time with zone, so long ago, for names and records."""
    return datetime.fromtimestamp(time.time() - ago_s).astimezone()


def unix_of(text: str) -> float:
    """The Unix time of a date and time as ISO 8601 has it; ValueError for another text."""
    return datetime.fromisoformat(text).timestamp()


def unix_s() -> float:
    """Seconds of Unix time, for what outlives this process."""
    return time.time()
