"""How long an autopilot takes to go up and to come down by itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

_LOW_M: Final = 10.0


@dataclass(frozen=True, slots=True)
class UpAndDown:
    """How an autopilot takes off and lands by itself."""

    arm_s: float
    """From the order until it climbs, and from its height until it follows setpoints."""
    climb_mps: float
    descent_mps: float
    """To `_LOW_M`."""
    touchdown_mps: float
    """The mean from there."""
    disarm_s: float

    def landing_s(self, height_m: float) -> float:
        """Fast to `_LOW_M`, slowly from there, then disarming."""
        fast_s = max(0.0, height_m - _LOW_M) / self.descent_mps
        return fast_s + min(height_m, _LOW_M) / self.touchdown_mps + self.disarm_s


UP_AND_DOWN: Final = {
    "ardupilot": UpAndDown(5.6, 2.5, 1.2, 0.5, 3.0),
    "px4": UpAndDown(6.4, 1.5, 0.87, 0.53, 2.6),
}
"""Measured on real ones with default parameters, at 10 and 20 m
(docs/pages/figures.md#real-autopilots)."""
