"""A control loop's heartbeat. Deadlines are absolute; ticks that are missed are counted, and never
made up for in a burst."""

from __future__ import annotations

from swarm_ctl.core.model.histogram import Histogram
from swarm_ctl.core.model.messages import TickReport
from swarm_ctl.engine.clock import Clock

_MS = 1000.0
_BIN_MS = 0.05


class Ticker:
    """Ticks every `period_s` of mission time; measures its own lateness and the work between ticks
    (wall clock)."""

    def __init__(self, clock: Clock, period_s: float) -> None:
        self.clock = clock
        self._period = period_s
        self._due = clock.now()
        self._started: float | None = None
        self._late = Histogram(_BIN_MS, 2000)
        self._work = Histogram(_BIN_MS, 2000)
        self._overruns = 0

    def wait(self) -> float:
        """Sleep to the next deadline that is still ahead; the mission time [s]."""
        clock, period = self.clock, self._period
        now = clock.now()
        to_ms = _MS / clock.speedup
        if self._started is not None:
            self._work.add((now - self._started) * to_ms)
        self._due += period
        if now >= self._due + period:
            missed = int((now - self._due) / period)
            self._overruns += missed
            self._due += missed * period
        clock.sleep_until(self._due)
        self._started = now = clock.now()
        self._late.add((now - self._due) * to_ms)
        return now

    def report(self) -> TickReport:
        """The figures so far [ms]."""
        return TickReport(
            count=self._late.count,
            overruns=self._overruns,
            late_p50_ms=self._late.percentile(0.5) or 0.0,
            late_p99_ms=self._late.percentile(0.99) or 0.0,
            late_max_ms=self._late.most,
            work_p50_ms=self._work.percentile(0.5) or 0.0,
            work_p99_ms=self._work.percentile(0.99) or 0.0,
        )
