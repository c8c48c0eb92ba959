"""The mean-error feedback (`core/kernel/align.py`) for arrays of agents."""

from __future__ import annotations

from swarm_ctl.core.kernel.align import RATE
from swarm_ctl.core.model.arrays import Complex, Ints


def pull_of(own: Complex, total: Complex, count: Ints) -> Complex:
    """The pull of agents with these errors: of the sum of those that count, and their number."""
    found: Complex = RATE * ((total + own) / (count + 1) - own)
    return found
