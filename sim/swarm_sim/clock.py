"""Mission time: the only reader of the system clock in `sim`."""

from __future__ import annotations

import time

_YEAR_2015_S = 1_420_070_400


class SimClock:
    """Mission time is (monotonic - `epoch_s`) * `speedup`;
    all processes of one host share both. In lockstep it stands still between ticks."""

    def __init__(self, epoch_s: float, speedup: float) -> None:
        self._epoch_s = epoch_s
        self._speedup = speedup
        self._stepped_s: float | None = None

    def now(self) -> float:
        """Mission time [s]."""
        if self._stepped_s is not None:
            return self._stepped_s
        return (time.monotonic() - self._epoch_s) * self._speedup

    def stand(self, mission_s: float) -> None:
        """It is so late now, and stays so (lockstep)."""
        self._stepped_s = mission_s

    def run(self) -> None:
        """Goes on by the system clock."""
        if self._stepped_s is not None:
            self._epoch_s = time.monotonic() - self._stepped_s / self._speedup
            self._stepped_s = None

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
