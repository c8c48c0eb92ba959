"""The slow altitude loop."""

from __future__ import annotations

import math
from typing import Final

from swarm_ctl.core.model.plan import Limits

_GAIN: Final = 0.5
"""[1/s]: well under 1 / (dead time + lag) of any multirotor, so the loop cannot ring."""


def climb_rate(height_error_m: float, limits: Limits) -> float:
    """Climb rate [m/s, up] for a height error [m, positive: too low]. 0 for one that is not
    finite."""
    if not math.isfinite(height_error_m):
        return 0.0
    return max(-limits.descent_mps, min(limits.climb_mps, _GAIN * height_error_m))
