"""The altitude loop stays within the limits and goes the right way."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.control.navigation import climb_rate
from swarm_ctl.core.model.plan import Limits

LIMITS = Limits(speed_mps=5.0, climb_mps=1.0, descent_mps=0.5)


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_climb_rate_within_limits(error: float) -> None:
    """Whatever the height error is."""
    assert -LIMITS.descent_mps <= climb_rate(error, LIMITS) <= LIMITS.climb_mps


def test_too_low_climbs() -> None:
    """A positive error means: too low."""
    assert climb_rate(0.5, LIMITS) > 0 > climb_rate(-0.5, LIMITS)
