"""Mission time: the only reader of the system clock in `sim`."""

from __future__ import annotations

import time

_YEAR_2015_S = 1_420_070_400


class SimClock:
    """Mission time is (monotonic - `epoch_s`) * `speedup`; all processes of one host share both."""

    def __init__(self, epoch_s: float, speedup: float) -> None:
        self._epoch_s = epoch_s
        self._speedup = speedup

    def now(self) -> float:
        """Mission time [s]."""
        return (time.monotonic() - self._epoch_s) * self._speedup

    def wall_until(self, mission_s: float) -> float:
        """Wall-clock seconds from now until mission time `mission_s`; 0 when it has passed."""
        return max(0.0, (mission_s - self.now()) / self._speedup)

    @staticmethod
    def signing_10us() -> int:
        """The wall clock as MAVLink signing counts it: 10 us since 2015."""
        return int((time.time() - _YEAR_2015_S) * 1e5)

    def rest(self, wall_s: float) -> None:
        """Does nothing for this long."""
        if wall_s > 0.0:
            time.sleep(wall_s)
