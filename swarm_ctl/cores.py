"""How many cores this process may use."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Final

_QUOTA: Final = Path("/sys/fs/cgroup/cpu.max")
"""Of a container, by cgroup 2: microseconds of all cores in each period, or `max`."""


def cores(quota: Path = _QUOTA) -> int:
    """Those of the machine, or fewer: as many as affinity and a container's quota allow."""
    found = os.cpu_count() or 1
    if hasattr(os, "sched_getaffinity"):  # on Linux
        found = len(os.sched_getaffinity(0))
    try:
        of_all, period = quota.read_text().split()
    except (OSError, ValueError):  # no container, or another system
        return found
    return found if of_all == "max" else min(found, math.ceil(int(of_all) / int(period)))
