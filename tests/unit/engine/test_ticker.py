"""The ticker on a clock that the test moves: absolute deadlines, skipped ticks counted, none made
up for."""

from __future__ import annotations

import pytest

from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.ticker import Ticker


class FakeClock(Clock):
    """Time passes by sleeping and by `work`."""

    def __init__(self, speedup: float = 1.0, oversleep_s: float = 0.0) -> None:
        super().__init__(0.0, speedup)
        self.time = 0.0
        self.oversleep_s = oversleep_s

    def now(self) -> float:
        return self.time

    def sleep_until(self, mission_s: float) -> None:
        self.time = max(self.time, mission_s) + self.oversleep_s

    def work(self, mission_s: float) -> None:
        self.time += mission_s


def test_ticks_do_not_drift() -> None:
    """Late wake-ups and work do not add up: the n-th tick is due at n periods."""
    clock = FakeClock(oversleep_s=0.003)
    ticker = Ticker(clock, 0.05)
    for n in range(1, 200):
        assert ticker.wait() == pytest.approx(n * 0.05 + 0.003)
        clock.work(0.02)
    report = ticker.report()
    assert report.overruns == 0
    assert report.late_p50_ms == pytest.approx(3.0, abs=0.06)
    assert report.work_p50_ms == pytest.approx(20.0, abs=0.06)


def test_missed_ticks_are_skipped_and_counted() -> None:
    """After a stall of 0.26 s the loop goes on at the next deadline, not with a burst."""
    clock = FakeClock()
    ticker = Ticker(clock, 0.05)
    ticker.wait()
    clock.work(0.26)
    first, second = ticker.wait(), ticker.wait()
    assert second - first == pytest.approx(0.05, abs=0.011)
    assert ticker.report().overruns == 4
    assert ticker.report().count == 3
